"""Dynamic accuracy, source 1 section 4.3 and table 2: a target moved by hand, its errors switched on one by one.

One flight of the full simulation (`handheld.toml`), cut into runs. Beside it stand several lighthouses and on-board
computers, a rung each, that see the very same motion and draw the very same noise, so that rungs differ by one cause:

    noise only        the craft stands still within every period, at its pose of the epoch
    + motion          it moves as it moves; the solver takes a period for an instant, as the paper's does
    + fan errors      of a real Lighthouse 1.0
    + mounting        photodiodes 0.5 mm off: all of the paper's errors, nothing done about them
    compensation      the last, with motion compensation;  calibration: the last, calibrated from a survey;  both

Errors (25): e_rot = angle of R_l R_m^T, e_trans = |t_l - t_m|, of PnP, as the paper has no filter. Beforehand the frame
of the truth ("motion capture") is aligned with each rung's own lighthouse, from poses at rest all over the volume
(`swarm.studies.papers.alignment`).
"""

from pathlib import Path
from typing import NamedTuple
from zlib import crc32

import numpy as np

from estimators import rotation as rot
from estimators.arrays import Bools, Floats
from swarm import figures
from swarm.flight.flight import Flight
from swarm.scenario import Scenario, load
from swarm.sensors.sight import Sight
from swarm.studies.papers.alignment import Alignment
from swarm.studies.papers.experiment import (
    Columns,
    Grid,
    Line,
    Outcome,
    Request,
    data,
    span,
    under,
)
from swarm.studies.papers.rungs import BOTH, FULL, LADDER, NOISE, Computer, Track, alignment, calibrated

SCENARIO = Path(__file__).with_name("handheld.toml")
PAPER = {
    "rotation_rms_deg": (0.18, 1.07),
    "rotation_max_deg": (0.82, 5.76),
    "translation_rms_mm": (3.5, 19.0),
    "translation_max_mm": (11.6, 45.4),
}
"""Table 2: smallest and largest of the ten runs."""
TARGET = {"rotation_rms_deg": (0.2, 1.1), "translation_rms_mm": (3.0, 20.0)}
REDUCTION, NEAR_STATIC = (5.0, None), (None, 1.2)


class Errors(NamedTuple):
    """RMS and largest of (25) of each run (N,); NaN for a run without a pose."""

    rotation_rms_deg: Floats
    rotation_max_deg: Floats
    translation_rms_mm: Floats
    translation_max_mm: Floats


class Flown(NamedTuple):
    """One flight of N periods: true track, speeds (N,) [m/s], rates (N,) [rad/s]; per rung its poses and its frame."""

    true: Track
    speed: Floats
    rate: Floats
    pnp: list[Track]
    filtered: list[Track]
    frames: list[Alignment]


def run(request: Request) -> Outcome:
    """Fly, measure on every rung, compare."""
    runs, seconds = request.sizes["runs"], request.sizes["seconds"]
    scenario = load(SCENARIO, [f"duration_s={float(runs * seconds)}"], request.seed)
    length = round(seconds * scenario.lighthouse.rate_hz)
    flown = _fly(request, scenario, runs, length)
    pnp, filtered = (
        [_errors(track, flown.true, length, frame) for track, frame in zip(tracks, flown.frames, strict=True)]
        for tracks in (flown.pnp, flown.filtered)
    )
    motion = np.stack([_rms(flown.speed, length), np.rad2deg(_rms(flown.rate, length))], axis=-1)
    solved = [np.isfinite(track.position[:, 0]).reshape(-1, length).mean(axis=1) for track in flown.pnp]
    notes = (
        f"{runs} runs of {seconds} s at {_words(motion[:, 0], 2)} m/s and {_words(motion[:, 1], 0)} deg/s RMS, "
        f"{100 * min(float(share.min()) for share in solved):.1f} % of the periods solved or more.",
        "Poses are PnP's, as the paper's: it has no filter. Calibrated: by `swarm calibrate` "
        "from a survey of 60 s with known poses.",
    )
    named = [*zip((rung.name for rung in LADDER), pnp, strict=True), ("both, filtered", filtered[-1])]
    ladder = Grid(
        "RMS errors of the runs, least to most",
        ("rotation, deg", "translation, mm"),
        [(name, (span(each.rotation_rms_deg), span(each.translation_rms_mm))) for name, each in named],
    )
    table = data(_columns(pnp, filtered, solved, motion))
    return Outcome(_compare(pnp), table, _draw(pnp, filtered[-1]), notes, (ladder,))


def _fly(request: Request, scenario: Scenario, runs: int, length: int) -> Flown:
    """Fly `runs` times `length` periods, and let every rung measure them."""
    flight = Flight(scenario)
    request.progress(0.0, "the survey, and the calibration from it")
    known = calibrated(scenario, flight.world.photodiodes)
    key = crc32(flight.world.names[0].encode())
    computers = [Computer(rung, scenario, flight.world.photodiodes, key, known) for rung in LADDER]
    request.progress(0.0, "aligning the frames")
    frames = [alignment(rung, scenario, flight.sensors.lighthouse.photodiodes, known) for rung in LADDER]
    count = runs * length
    rotation, position, (speed, rate) = np.empty((count, 3, 3)), np.empty((count, 3)), np.empty((2, count))
    for frame in range(count):
        truth, sight = flight.move(frame)
        epoch = len(truth.time_s) // 2
        rotation[frame] = rot.matrix_from_quaternion(truth.quaternion[epoch, 0])
        position[frame] = truth.position[epoch, 0]
        speed[frame] = np.linalg.norm(truth.velocity[epoch, 0])
        rate[frame] = np.linalg.norm(truth.angular_rate[epoch, 0])
        for computer in computers:
            computer.step(truth, frame, sight == Sight.LIT)
        if frame % 60 == 0:
            request.progress(frame / count, f"run {frame // length + 1} of {runs}")
    pnp, filtered = [c.pnp for c in computers], [c.filtered for c in computers]
    return Flown(Track(rotation, position), speed, rate, pnp, filtered, frames)


def _errors(measured: Track, true: Track, length: int, frame: Alignment) -> Errors:
    """Return (25) of every run of `length` periods, in the aligned frame."""
    known: Bools = np.isfinite(measured.position[:, 0])
    angle, distance = np.full(len(known), np.nan), np.full(len(known), np.nan)
    angle[known] = np.rad2deg(rot.angle_between(frame.rotations(measured.rotation[known]), true.rotation[known]))
    distance[known] = 1e3 * np.linalg.norm(frame.positions(measured.position[known]) - true.position[known], axis=1)
    return Errors(_rms(angle, length), _largest(angle, length), _rms(distance, length), _largest(distance, length))


def _rms(values: Floats, length: int) -> Floats:
    """Return the RMS of every run of `length` periods; NaN where it has no value."""
    runs = values.reshape(-1, length)
    some = np.isfinite(runs).any(axis=1)
    out = np.full(len(runs), np.nan)
    out[some] = np.sqrt(np.nanmean(runs[some] ** 2, axis=1))
    return out


def _largest(values: Floats, length: int) -> Floats:
    runs = values.reshape(-1, length)
    out: Floats = np.fmax.reduce(runs, axis=1)
    return out


def _compare(pnp: list[Errors]) -> list[Line]:
    """Return table 2, and what compensation and calibration bring; ours are the least and most of the runs."""
    by_name = {rung.name: each for rung, each in zip(LADDER, pnp, strict=True)}
    full, both, noise = by_name[FULL], by_name[BOTH], by_name[NOISE]
    found = []
    for name, paper in PAPER.items():
        what, statistic, unit = name.split("_")
        quantity = f"{what}, {statistic.upper() if statistic == 'rms' else 'largest'}"
        found.append(Line(quantity, unit, paper, span(getattr(full, name)), TARGET.get(name)))
    lines = under("All errors, raw PnP, by run", *found)
    for what, unit in (("rotation", "deg"), ("translation", "mm")):
        key = f"{what}_rms_{unit}"
        raw, done, still = (float(np.nanmedian(getattr(each, key))) for each in (full, both, noise))
        lines += under(
            f"{what.capitalize()}, by medians",
            Line("raw / noise only", "", "about 10", raw / still),
            Line("raw / both", "", None, raw / done, REDUCTION),
            Line("both / noise only", "", None, done / still, NEAR_STATIC),
        )
    return lines


def _columns(pnp: list[Errors], filtered: list[Errors], solved: list[Floats], motion: Floats) -> Columns:
    """Return the data, a row per rung and run."""
    runs, rungs = len(motion), len(LADDER)
    columns: Columns = {
        "rung": (np.repeat([rung.name for rung in LADDER], runs), "which causes are at work"),
        "run": (np.tile(np.arange(1, runs + 1), rungs), "number of the run"),
        "speed_rms_m_s": (np.tile(motion[:, 0], rungs), "RMS speed of the run"),
        "rate_rms_deg_s": (np.tile(motion[:, 1], rungs), "RMS angular rate of the run"),
        "solved_share": (np.concatenate(solved), "share of the periods with a PnP pose"),
    }
    for source, each in (("pnp", pnp), ("filter", filtered)):
        for name in Errors._fields:
            values = np.concatenate([getattr(errors, name) for errors in each])
            columns[f"{source}_{name}"] = values, f"error (25) of the {source}"
    return columns


def _draw(pnp: list[Errors], filtered: Errors) -> figures.Figure:
    """Draw table 2: every run a dot, rung by rung, with the paper's runs as a band."""
    page, axes = figures.page(1, 2, 3.6)
    number = np.arange(len(LADDER))
    for place, key, label in zip(
        axes[0], ("rotation_rms_deg", "translation_rms_mm"), ("rotation RMS, deg", "translation RMS, mm"), strict=True
    ):
        place.axhspan(*PAPER[key], color="#e6e6e6", zorder=0)
        place.text(-0.4, PAPER[key][1] * 0.97, "table 2, ten runs", va="top", color="#555555", size=8)
        for x, each in zip(number, pnp, strict=True):
            values = getattr(each, key)
            colour = figures.BLUE if LADDER[x].compensated or LADDER[x].calibrated else figures.VERMILLION
            spread = np.linspace(-0.15, 0.15, len(values)) if len(values) > 1 else np.zeros(1)
            place.plot(x + spread, values, "o", ms=3, color=colour, label="ours, PnP" if x == 0 else None)
            place.plot([x - 0.3, x + 0.3], [np.nanmedian(values)] * 2, "-", lw=1.5, color=colour)
        values = getattr(filtered, key)
        place.plot(np.full(len(values), number[-1] + 0.35), values, "x", ms=4, color=figures.GREEN, label="ours, EKF")
        place.set_yscale("log")
        place.set_ylabel(label)
        place.set_xticks(number, [rung.name for rung in LADDER], rotation=40, ha="right")
    figures.legend(axes[0, 0], place="lower center")
    return page


def _words(values: Floats, decimals: int) -> str:
    return f"{values.min():.{decimals}f} to {values.max():.{decimals}f}"
