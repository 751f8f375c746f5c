"""Beside flight and papers: the lighthouse's precision at the ranges of other relative navigation, and what they
report.

The precision is the Cramer-Rao bound of one period's angles of a craft at rest, turned 20 degrees from the station's
boresight on which it is, in lighthouse noise (19): of the rows' H (`estimators.lighthouse.rows`) and their covariance
R,

    P = (H^T R^-1 H)^-1        over (attitude, position);   along: the line of sight, across: per axis beside it

and, where PnP is solved from the simulator's own pulses, the RMS of its errors over the bound. Across grows with the
range r as s r, along as s r^2 / b with the craft's size b. Filters average over periods, by a factor that the motion
decides, and are left out here; so are the station's systematic errors.
"""

from typing import NamedTuple

import numpy as np

from estimators import rotation as rot
from estimators.arrays import Bools, Floats
from estimators.lighthouse.integrity import AngleNoise
from estimators.lighthouse.rows import AT_ORIGIN, Rows, Station, linearise, packed
from estimators.lighthouse.sweep import lighthouse_2
from estimators.lighthouse.tilted import TiltedErrors
from swarm import figures
from swarm.flight.builders.stations import LIGHTHOUSE_2_CORRELATION, LIGHTHOUSE_2_NOISE_RAD
from swarm.studies.papers.bench import Bench, Motion
from swarm.studies.papers.experiment import Columns, Grid, Line, Outcome, Request, data, under

POSE = np.array([0, 1, 2, 6, 7, 8])
TURN_RAD = np.deg2rad(20)
SEEN_M = 3.0
"""Range at which a ray cast tells the photodiodes that face the station."""
RANGES_M = np.geomspace(2.0, 1000.0, 60)
TABLE_M = (2.0, 5.0, 10.0, 20.0, 50.0, 150.0)
SOLVED_M = (3.0, 5.0, 10.0)
NEAR_ONE = (0.9, 1.1)
FEWEST = 50
CRAFT = {"inspector": "a free-flyer, 0.3 m", "cubesat6u": "a 6U CubeSat, 0.7 m", "chaser": "a chaser, 3.2 m"}
DECK_M = np.array([[x, y, 0.0] for x in (-0.015, 0.015) for y in (-0.0075, 0.0075)])
"""Photodiodes of the lighthouse deck of the Crazyflie: four in a plane, 30 mm x 15 mm."""
ROOM = (
    (np.array([-1.5, 1.5, 0.0]), np.array([1.0, -1.0, 1.5])),
    (np.array([1.5, 1.5, 0.0]), np.array([-1.0, -1.0, 1.5])),
)
"""Positions and directions of two stations, 2.9 m from a deck at (0, 0, 2) m."""


class Bound(NamedTuple):
    """Precision of a craft at one range. across_m, along_m: standard deviations. attitude_rad: of all three
    together.
    """

    across_m: float
    along_m: float
    attitude_rad: float


def run(request: Request) -> Outcome:
    """Compute the bounds, solve poses beside them, compare."""
    request.refuse_below(FEWEST, "a ratio to 10 %", "draws")
    found, ratios = {}, {}
    for name in request.each(list(CRAFT), "craft"):
        bench = Bench(name)
        rotation = rot.exp(np.array([TURN_RAD, 0.0, 0.0])) @ np.diag([1.0, -1.0, -1.0])
        if not bench.lit(rotation[None], np.array([[0.0, 0.0, SEEN_M]]))[0].any():
            rotation = rot.exp(np.array([TURN_RAD, 0.0, 0.0]))
        lit = bench.lit(rotation[None], np.array([[0.0, 0.0, SEEN_M]]))[0]
        found[name] = [bound(bench, lit, rotation, float(r)) for r in RANGES_M]
        ratios[name] = [solved(bench, lit, rotation, r, request) for r in SOLVED_M]
    return Outcome(
        _compare(found, ratios),
        data(_columns(found)),
        _draw(found),
        (
            "One period of 1/60 s, at rest, without the station's systematic errors; angle noise 8.8 arcsec, of "
            "Lighthouse 2.0 2.6 arcsec. The lighthouse needs its photodiodes on the other craft, and its light there: "
            "beyond some 20 m the table says what its geometry would give, not what its power reaches.",
            "Sources: docs/beside.md.",
        ),
        (_table(found),),
    )


def bound(bench: Bench, lit: Bools, rotation: Floats, range_m: float) -> Bound:
    """Return the precision of a craft on the boresight.

    Args:
        bench: the craft.
        lit: photodiodes that face the station, (K,).
        rotation: its attitude, (3, 3).
        range_m: its range [m].
    """
    s = bench.settings
    own, rotor = (s.angle_noise_rad * np.sqrt(share) for share in (1 - s.rotor_correlation, s.rotor_correlation))
    place = np.array([0.0, 0.0, range_m])
    covariance = pose_covariance(bench.point_m[lit], rotation, place, [AT_ORIGIN], AngleNoise(own, rotor))
    across, along = np.sqrt(np.trace(covariance[3:5, 3:5]) / 2), np.sqrt(covariance[5, 5])
    return Bound(float(across), float(along), float(np.sqrt(np.trace(covariance[:3, :3]))))


def pose_covariance(
    point_m: Floats, rotation: Floats, position: Floats, stations: list[Station], noise: AngleNoise
) -> Floats:
    """Return the Cramer-Rao bound (6, 6) of (attitude, position) of a craft at rest, all of whose photodiodes are lit.

    Args:
        point_m: photodiodes, (K, 3) [m].
        rotation: (3, 3).
        position: (3,) [m].
        stations: whose light it sees.
        noise: of an angle.
    """
    station, fan, photodiode = (
        part.ravel() for part in np.meshgrid(range(len(stations)), range(2), range(len(point_m)), indexing="ij")
    )
    none = np.zeros(len(fan))
    rows = Rows(station, fan, photodiode, np.zeros_like(fan), none, none)
    still = np.zeros(3)
    h = linearise(rows, packed(stations), point_m, rotation, position, still, still).matrix[:, POSE]
    sweep = 2 * station + fan
    r = noise.own_rad**2 * np.eye(len(fan)) + noise.shared_rad**2 * (sweep[:, None] == sweep)
    return np.asarray(np.linalg.inv(h.T @ np.linalg.solve(r, h)), dtype=np.float64)


def solved(bench: Bench, lit: Bools, rotation: Floats, range_m: float, request: Request) -> float:
    """Return the RMS position error of PnP on simulated periods over the bound.

    Args:
        bench: the craft.
        lit: photodiodes that face the station, (K,).
        rotation: its attitude, (3, 3).
        range_m: its range [m].
        request: number and seed of the draws.
    """
    draws, rng, s = request.sizes["draws"], np.random.default_rng([request.seed, round(range_m)]), bench.settings
    true = Motion.rest(rotation[None], np.array([[0.0, 0.0, range_m]])).repeat(draws)
    error = bench.noise(draws, rng, s.angle_noise_rad, s.rotor_correlation)
    pose = bench.solve(bench.angles(true, np.repeat(lit[None], draws, axis=0), error, rng), true)
    square = np.sum((pose.position[pose.solved] - true.position[pose.solved]) ** 2, axis=1)
    best = bound(bench, lit, rotation, range_m)
    return float(np.sqrt(square.mean() / (2 * best.across_m**2 + best.along_m**2)))


def deck() -> float:
    """Return the bound of the position [m] of a Crazyflie's deck between two stations of Lighthouse 2.0, all axes."""
    stations = []
    for position, ahead in ROOM:
        z = ahead / np.linalg.norm(ahead)
        x = np.cross([0.0, 1.0, 0.0], z)
        x /= np.linalg.norm(x)
        axes = np.stack([x, np.cross(z, x), z], axis=1)
        stations.append(Station(axes, position, lighthouse_2(TiltedErrors(), TiltedErrors())))
    rho, sigma = LIGHTHOUSE_2_CORRELATION, LIGHTHOUSE_2_NOISE_RAD
    noise = AngleNoise(float(sigma * np.sqrt(1 - rho)), float(sigma * np.sqrt(rho)))
    covariance = pose_covariance(DECK_M, np.eye(3), np.array([0.0, 0.0, 2.0]), stations, noise)
    return float(np.sqrt(np.trace(covariance[3:, 3:])))


def _at(found: list[Bound], range_m: float, what: str) -> float:
    """Return a precision at a range; it is a power of the range nearly."""
    values = np.log([getattr(each, what) for each in found])
    return float(np.exp(np.interp(np.log(range_m), np.log(RANGES_M), values)))


def _range_of(found: list[Bound], value: float, per_range: bool = False) -> float:
    """Return the range [m] at which the precision along the line of sight is a value, in metres or as a share."""
    along = np.array([each.along_m for each in found]) / (RANGES_M if per_range else 1.0)
    return float(np.exp(np.interp(np.log(value), np.log(along), np.log(RANGES_M))))


def _compare(found: dict[str, list[Bound]], ratios: dict[str, list[float]]) -> list[Line]:
    flyer, cubesat, chaser = (found[name] for name in CRAFT)
    return [
        *under(
            "StarFOX: cameras on 6U CubeSats, 1 sigma along the line of sight",
            Line("share of the range, one observer", "%", 1.3, 100 * _at(cubesat, 10.0, "along_m") / 10.0),
            Line("share of the range, several observers", "%", 0.6, None),
            Line("range at which ours is 1.3 %", "m", None, _range_of(cubesat, 0.013, per_range=True)),
        ),
        *under(
            "Proba-3: laser and retroreflector at 150 m",
            Line("displacement across, 1 axis", "mm", 0.3, 1e3 * _at(chaser, 150.0, "across_m")),
            Line("displacement along", "mm", 0.3, 1e3 * _at(chaser, 150.0, "along_m")),
            Line("range at which ours along is 0.3 mm", "m", None, _range_of(chaser, 0.3e-3)),
        ),
        *under(
            "Borges et al.: Vive before a free-flyer, one station",
            Line("precision at 2 m, across and along", "mm", "millimetres", _pair(flyer, 2.0)),
        ),
        *under(
            "Taffanel et al.: a deck of four photodiodes, two stations",
            Line("position, all axes, at 2.9 m", "mm", None, 1e3 * deck()),
        ),
        *under(
            "Greiff et al.: Cramer-Rao bound of the lighthouse",
            Line("position of a small vehicle at 2 m", "mm", "below 10", _pair(flyer, 2.0)),
            *(
                Line(f"PnP over the bound, {CRAFT[name]}", "", None, (min(each), max(each)), NEAR_ONE)
                for name, each in ratios.items()
            ),
        ),
    ]


def _pair(found: list[Bound], range_m: float) -> tuple[float, float]:
    return 1e3 * _at(found, range_m, "across_m"), 1e3 * _at(found, range_m, "along_m")


def _table(found: dict[str, list[Bound]]) -> Grid:
    columns = tuple(f"{name}, {what}" for name in found for what in ("across, mm", "along, mm"))
    rows = [(f"{r:g} m", tuple(value for each in found.values() for value in _pair(each, r))) for r in TABLE_M]
    return Grid("Precision of one period, 1 sigma", columns, rows)


def _columns(found: dict[str, list[Bound]]) -> Columns:
    every = [(name, float(r), each) for name, row in found.items() for r, each in zip(RANGES_M, row, strict=True)]
    return {
        "craft": ([name for name, _, _ in every], "model of the craft"),
        "range_m": ([r for _, r, _ in every], "range on the boresight"),
        "across_m": ([each.across_m for _, _, each in every], "precision per axis across the line of sight"),
        "along_m": ([each.along_m for _, _, each in every], "precision along the line of sight"),
        "attitude_deg": ([np.degrees(each.attitude_rad) for _, _, each in every], "precision of the attitude"),
    }


def _draw(found: dict[str, list[Bound]]) -> figures.Figure:
    page, axes = figures.page(1, 1, 4.2)
    place = axes[0, 0]
    inks = (figures.GREEN, figures.BLUE, figures.ORANGE)
    for (name, each), ink in zip(found.items(), inks, strict=True):
        place.plot(RANGES_M, [1e3 * one.along_m for one in each], color=ink, label=f"{CRAFT[name]}: along")
        place.plot(RANGES_M, [1e3 * one.across_m for one in each], color=ink, linestyle="--", label="across")
    place.plot(RANGES_M, 13.0 * RANGES_M, color="#777777", linestyle=":", label="1.3 % of the range (StarFOX)")
    place.plot([150.0], [0.3], "k*", label="0.3 mm at 150 m (Proba-3)")
    place.set_xscale("log")
    place.set_yscale("log")
    place.set_ylim(1e-2, 1e6)
    place.set_xlabel("range, m")
    place.set_ylabel("precision of one period, mm")
    figures.legend(place, place="upper left")
    return page
