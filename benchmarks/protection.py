"""Protection levels of the filter by separation of solutions against errors: Monte Carlo of craft as their filter has
them.

    python benchmarks/protection.py [--craft 210] [--batches 4] [--only CASE ...] [--false-photodiodes 2]
    python benchmarks/protection.py --plan FOLDER [--parts N]

Mockups about 3 m before the lighthouse, each pushed by white accelerations as its filter assumes, by the compiled bank.
A batch is so many craft for 240 periods. Per case prints, in JSON: craft-periods with an estimate, those with an error
beyond the level, the largest error as a share of its level, the RMS error, the level (root mean square over time and
craft, and median) and the ratio of the former to the RMS error, all after the first second.

`--plan` flies 10^6 craft-periods of all cases, in parts of a few minutes, each of which leaves a file in the folder:
called again it goes on with those that are missing, N of them at most, and prints the figures of all that are there.

Poses of one lighthouse, with two photodiodes that may be false: `clean`; `reflections` and `small reflections`, 5 % of
all sweeps off by up to 5 degrees or 0.03; `two false`, two photodiodes of every craft off all the time by angles of any
size from a tenth of the noise to a thousand times; `dark`, a second without light, in which a constant push of up to
0.2 m/s^2 and 20 deg/s^2 per axis comes on top, which the craft are told to allow for; `dark, harder`, the same with
pushes of four times of what they are told.

Row by row, by filters of one model of motion: `tight` and `tight, one false`, one photodiode that may be false;
before two stations whose lines of sight cross at 90 degrees, one of which may be false: `stations`, `stations, biased`,
all angles of one off by any size from a tenth of the noise to a thousand times, `stations, moved`, one of them not
where it is taken to be, by 0.1 to 100 mm and up to 10 mrad, and `stations, reflections`, as above. `three stations`
likewise, the third 60 degrees from either.

A level that holds whatever one station does rests on the others alone. `bound` is the least that it can be, K times the
root of the trace of what the others know where the station is missing which tells most (`benchmarks/filter_theory.py`),
root mean square over the craft where they are at the end; `over_bound` the level's over it. A level by solution
separation has on top how far both estimates are apart, of which one standard deviation in K or so is a good filter's.
"""

import argparse
import json
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from filter_theory import Model, Seen, separate
from numpy.typing import NDArray
from pushed_motion import pushed
from scipy.special import ndtri

from estimators import rotation as rot
from estimators.arrays import Bools, Floats
from estimators.lighthouse.innovation import gathered
from estimators.lighthouse.rows import Rows, Station, linearise, packed
from estimators.lighthouse.sweep import HALF_PI, LIGHTHOUSE_1, measured_angles
from estimators.rotation import angle_between
from estimators.state import State
from swarm.flight import builders
from swarm.flight.builders.stations import station_noise
from swarm.flight.flight import Flight
from swarm.hardware import Photodiodes
from swarm.onboard.decoder import SweepAngles
from swarm.onboard.navigation import Estimate, Navigator
from swarm.onboard.stations import RowLight, StationNavigator
from swarm.scenario import load

PERIODS, SETTLED = 240, 60
DARK = range(120, 180)
QUIET_OFF = ["navigation.quiet.craft=none"]
PUSH_M_S2, PUSH_RAD_S2 = 0.2, np.radians(20.0)
PLACES_M = ((-3.0, 0.0, 0.0), (3.0, 0.0, 0.0), (0.0, -3.0, 0.0))
"""Where stations stand, which all look at the middle of the craft."""
MIDDLE_M = np.array([0.0, 0.0, 3.0])


class Case(NamedTuple):
    """share, spread_rad: of sweeps that are reflections, and how far off. false: number of false photodiodes. dark:
    whether there is a second without light, and a push in it; harder: that much harder than craft are told. coupling:
    of the navigation. stations: 0 before the one lighthouse; wrong: what is wrong with one of them.
    """

    share: float = 0.0
    spread_rad: float = 0.0
    false: int = 0
    dark: bool = False
    harder: float = 1.0
    coupling: str = "auto"
    stations: int = 0
    wrong: str = ""
    points: bool = False


CASES = {
    "clean": Case(),
    "reflections": Case(share=0.05, spread_rad=np.radians(5.0)),
    "small reflections": Case(share=0.05, spread_rad=np.radians(0.03)),
    "two false": Case(false=2),
    "dark": Case(dark=True),
    "dark, harder": Case(dark=True, harder=4.0),
    "tight": Case(coupling="tight"),
    "tight, one false": Case(coupling="tight", false=1),
    **{
        f"{name}{what}": Case(stations=number, **wrong)
        for name, number in (("stations", 2), ("three stations", 3))
        for what, wrong in (
            ("", {}),
            (", biased", {"wrong": "biased"}),
            (", moved", {"wrong": "moved"}),
            (", reflections", {"share": 0.05, "spread_rad": np.radians(5.0)}),
            (", or a photodiode", {"points": True}),
        )
    },
}
PLAN: dict[str, tuple[int, int]] = {
    **dict.fromkeys(("clean", "reflections", "small reflections", "two false", "dark"), (2, 210)),
    **dict.fromkeys(("tight", "tight, one false"), (5, 100)),
    **dict.fromkeys((name for name, case in CASES.items() if case.stations), (2, 60)),
}
"""Batches of a case, and craft of a batch: 10^6 craft-periods in all."""


class Batch:
    """Craft of one batch."""

    def __init__(self, craft: int, seed: int, case: Case, false_photodiodes: int) -> None:
        """Place them."""
        if case.coupling == "tight":
            false_photodiodes = min(false_photodiodes, 1)
        changes = [
            f"navigation.integrity.false_photodiodes={false_photodiodes}",
            f"navigation.coupling={case.coupling}",
        ]
        scenario = load("drift", [*changes, *(QUIET_OFF if case.coupling == "tight" else [])])
        flight = Flight(scenario)
        self.case, self.rng = case, np.random.default_rng(seed)
        rng, settings = self.rng, replace(builders.navigation(scenario), filter="compiled")
        if case.dark and false_photodiodes:
            told = replace(
                settings.integrity,
                unseen_acceleration_m_s2=PUSH_M_S2 * np.sqrt(3),
                unseen_angular_acceleration_rad_s2=PUSH_RAD_S2 * np.sqrt(3),
            )
            settings = replace(settings, integrity=told)
        self.settings = settings
        self.layout = Photodiodes._make(np.repeat(part[:1], craft, axis=0) for part in flight.world.photodiodes)
        facing = rot.matrix_from_quaternion(flight.motions.start().quaternion[:1])
        at = rng.uniform([-0.6, -0.6, 2.0], [0.6, 0.6, 4.0], (craft, 3))
        turn = rot.exp(rng.uniform(-0.4, 0.4, (craft, 3))) @ facing
        self.truth = State(turn, at, np.zeros((craft, 3)), np.zeros((craft, 3)))
        self.navigator = Navigator(self.layout, settings)
        present = self.layout.present
        self._bias = np.zeros((craft, present.shape[1], 2))
        for c in range(craft):
            who = rng.choice(np.flatnonzero(present[c]), case.false, replace=False)
            size = settings.angle_noise_rad * 10 ** rng.uniform(-1, 3, case.false)
            angle = rng.uniform(0, 2 * np.pi, case.false)
            self._bias[c, who] = size[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        self._push = rng.uniform(-1, 1, (2, craft, 3)) * np.array([PUSH_M_S2, PUSH_RAD_S2])[:, None, None]
        self._push *= case.harder

    def period(self, number: int) -> Estimate:
        """Move on by one period, measure and navigate."""
        s, rng, truth, dark = self.settings, self.rng, self.truth, self.case.dark and number in DARK
        dt, shape = s.frame_s, truth.position.shape
        push = s.acceleration_noise_m_s2 * rng.standard_normal(shape) + dark * self._push[0]
        twist = s.angular_acceleration_noise_rad_s2 * rng.standard_normal(shape) + dark * self._push[1]
        self.truth = pushed(truth, push, twist, dt)
        return self.navigator.step(self._angles(dark))

    def _angles(self, dark: bool) -> SweepAngles:
        truth, rng, case, rate = self.truth, self.rng, self.case, 1 / self.settings.frame_s
        craft, most = self.layout.present.shape
        theta, offset = np.full((craft, most, 2), np.nan), np.zeros((craft, most, 2))
        toward = -truth.position / np.linalg.norm(truth.position, axis=1, keepdims=True)
        normal = np.einsum("cij,ckj->cki", truth.rotation, self.layout.normal)
        lit = self.layout.present & (np.einsum("cki,ci->ck", normal, toward) > np.cos(np.radians(80))) & (not dark)
        noise = self.settings.noise
        for fan, quarter in enumerate((-0.25, 0.25)):
            tau = np.full((craft, most), quarter / rate)
            for _ in range(2):  # the instant at which the fan reaches the photodiode
                turn = rot.exp(truth.angular_rate[:, None] * tau[..., None])
                arm = (turn @ (truth.rotation[:, None] @ self.layout.point_m[..., None]))[..., 0]
                where = truth.position[:, None] + truth.velocity[:, None] * tau[..., None] + arm
                a = measured_angles(where, LIGHTHOUSE_1[fan : fan + 1])[..., 0]
                tau = quarter / rate + a / (2 * np.pi * rate)
            off = noise.shared_rad * rng.standard_normal((craft, 1)) + noise.own_rad * rng.standard_normal(a.shape)
            struck = rng.random(a.shape) < case.share
            off += struck * rng.uniform(-case.spread_rad, case.spread_rad, a.shape) + self._bias[..., fan]
            theta[..., fan], offset[..., fan] = HALF_PI + a + off, tau
        theta[~lit], offset[~lit] = np.nan, 0.0
        none = np.zeros(craft, dtype=np.int64)
        return SweepAngles(theta, offset, lit, none, none, none)


class StationBatch:
    """Craft of one batch before several stations, in whose noise each sweep has a draw, and each photodiode."""

    def __init__(self, craft: int, seed: int, case: Case) -> None:
        """Place them."""
        asked = [f"navigation.integrity.false_{name}=1" for name in ("stations", "photodiodes")[: 1 + case.points]]
        scenario = load("two-stations", [*asked, *QUIET_OFF])
        flight = Flight(load("drift"))
        self.rng, self.craft = np.random.default_rng(seed), craft
        rng = self.rng
        self.settings = replace(builders.navigation(scenario), filter="compiled")
        self.layout = Photodiodes._make(np.repeat(part[:1], craft, axis=0) for part in flight.world.photodiodes)
        facing = rot.matrix_from_quaternion(flight.motions.start().quaternion[:1])
        at = rng.uniform([-0.5, -0.5, 2.5], [0.5, 0.5, 3.5], (craft, 3))
        turn = rot.exp(rng.uniform(-0.3, 0.3, (craft, 3))) @ facing
        self.truth = State(turn, at, np.zeros((craft, 3)), np.zeros((craft, 3)))
        self.noise, self.case = [station_noise(scenario)[0]] * case.stations, case
        known, up = [], np.array([0.0, 1.0, 0.0])
        for place in np.array(PLACES_M[: case.stations]):
            ahead = (MIDDLE_M - place) / np.linalg.norm(MIDDLE_M - place)
            across = np.cross(up, ahead) / np.linalg.norm(np.cross(up, ahead))
            known.append(Station(np.stack([across, np.cross(ahead, across), ahead], axis=1), place, LIGHTHOUSE_1))
        count = len(known)
        turns = (0.0,) * count, (self.settings.frame_s,) * count
        relations = replace(self.settings.relations, common_rad=turns[0], turn_s=turns[1])
        self.settings = replace(self.settings, relations=relations)
        self.navigator = StationNavigator(self.layout, self.settings, known, self.noise)
        self.known, self.bias = known, np.zeros((craft, 2))
        self.moved = np.zeros((craft, 3)), np.tile(np.eye(3), (craft, 1, 1))
        self.wrong = rng.integers(0, count, craft)
        direction = rng.standard_normal((2, craft, 3))
        direction /= np.linalg.norm(direction, axis=2, keepdims=True)
        if case.wrong == "biased":
            angle = rng.uniform(0, 2 * np.pi, craft)
            size = np.hypot(*self.noise[0]) * 10 ** rng.uniform(-1, 3, craft)
            self.bias = size[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        elif case.wrong == "moved":
            shift = direction[0] * 10 ** rng.uniform(-4, -1, craft)[:, None]
            self.moved = shift, rot.exp(direction[1] * 10 ** rng.uniform(-5, -2, craft)[:, None])

    def period(self, number: int) -> Estimate:
        """Move on by one period, measure and navigate."""
        s, rng, shape = self.settings, self.rng, self.truth.position.shape
        push = s.acceleration_noise_m_s2 * rng.standard_normal(shape)
        twist = s.angular_acceleration_noise_rad_s2 * rng.standard_normal(shape)
        self.truth = pushed(self.truth, push, twist, s.frame_s)
        none = np.zeros(self.craft, dtype=np.int64)
        parts = [self._rows(station, fan, number) for station in range(len(self.known)) for fan in (0, 1)]
        craft = np.concatenate([part[0] for part in parts])
        rows = Rows._make(np.concatenate(column) for column in zip(*(part[1] for part in parts), strict=True))
        return self.navigator.step(RowLight(gathered(craft, rows, self.craft), none, none))

    def _rows(self, station: int, fan: int, number: int) -> tuple[Any, Rows]:
        """The craft and the rows of one sweep."""
        truth, known, rng = self.truth, self.known[station], self.rng
        wrong = self.wrong == station
        shift, turn = np.where(wrong[:, None], self.moved[0], 0.0), self.moved[1].copy()
        turn[~wrong] = np.eye(3)
        tau = -self.settings.frame_s * (2 * station + fan + 0.5) / (2 * len(self.known))
        at = truth.position + tau * truth.velocity
        now = rot.exp(truth.angular_rate * tau) @ truth.rotation
        where = at[:, None] + np.einsum("cij,ckj->cki", now, self.layout.point_m)
        normal = np.einsum("cij,ckj->cki", now, self.layout.normal)
        away = where - (known.position + shift)[:, None]
        toward = -away / np.linalg.norm(away, axis=2, keepdims=True)
        seen = self.layout.present & (np.einsum("cki,cki->ck", normal, toward) > np.cos(np.radians(80)))
        there = np.einsum("cki,cij->ckj", away, turn @ known.rotation)
        angle = measured_angles(there, known.fans[fan : fan + 1])[..., 0]
        own, shared = self.noise[station]
        angle += own * rng.standard_normal(angle.shape) + shared * rng.standard_normal((len(angle), 1))
        angle += np.where(wrong, self.bias[:, fan], 0.0)[:, None]
        struck = rng.random(angle.shape) < self.case.share
        angle += struck * rng.uniform(-self.case.spread_rad, self.case.spread_rad, angle.shape)
        craft, photodiode = np.nonzero(seen & np.isfinite(angle))
        every = np.ones(len(craft), dtype=np.int64)
        sweep = number * every
        return craft, Rows(
            station * every, fan * every, photodiode, sweep, np.full(len(craft), tau), angle[craft, photodiode]
        )

    def bound(self, number: int) -> NDArray[np.float64]:
        """Squares of the least levels, position [m] and attitude [deg], that hold whatever a station does, (2, C)."""
        s, stations, light = self.settings, len(self.known), packed(self.known)
        parts = [self._rows(station, fan, number) for station in range(stations) for fan in (0, 1)]
        out = np.zeros((2, self.craft))
        own, shared = self.noise[0]
        push = s.acceleration_noise_m_s2, s.angular_acceleration_noise_rad_s2
        asked = Model(own, shared, np.zeros(0), *push, s.frame_s, SETTLED)
        quantile = -float(ndtri(s.integrity.risk / 2))
        for c in range(self.craft):
            rows = Rows._make(
                np.concatenate([column[part[0] == c] for part, column in zip(parts, columns, strict=True)])
                for columns in zip(*(part[1] for part in parts), strict=True)
            )
            _, h = linearise(rows, light, self.layout.point_m[c], *self.truth.of(c))
            for missing in range(stations):
                left = rows.station != missing
                fan = (2 * rows.station + rows.fan)[left]
                covariance = separate([Seen(h[left], np.zeros((len(fan), 0)), fan)], asked)
                for i, (first, unit) in enumerate(((6, 1.0), (0, 180 / np.pi))):
                    part = covariance[first : first + 3, first : first + 3]
                    out[i, c] = max(out[i, c], (quantile * unit) ** 2 * float(np.trace(part)))
        return out


class Tally:
    """Errors and levels of a case."""

    def __init__(self) -> None:
        self.samples = self.beyond = 0
        self.worst = np.zeros(2)
        self.error: list[Floats] = []
        self.level: list[Floats] = []
        self.bound: list[Floats] = []
        self.beyond_by: list[list[float]] = []

    def add(self, batch: Batch | StationBatch) -> None:
        """Fly it."""
        for number in range(PERIODS):
            estimate, truth = batch.period(number), batch.truth
            known: Bools = np.asarray(np.isfinite(estimate.position).all(axis=1))
            error = np.zeros((2, len(known)))
            error[0] = np.linalg.norm(truth.position - estimate.position, axis=1)
            error[1, known] = np.rad2deg(angle_between(truth.rotation[known], estimate.rotation[known]))
            level = np.stack([estimate.integrity.position_m, estimate.integrity.attitude_deg])
            share = (error / level)[:, known]
            self.samples += int(known.sum())
            over = known & ~(error <= level).all(axis=0)
            self.beyond += int(over.sum())
            for c in np.flatnonzero(over)[:5]:
                self.beyond_by.append([number, int(c), *error[:, c].tolist(), *level[:, c].tolist()])
            self.worst = np.maximum(self.worst, share.max(axis=1, initial=0.0))
            if number >= SETTLED:
                self.error.append(error[:, known])
                self.level.append(level[:, known])
        if isinstance(batch, StationBatch):
            self.bound.append(batch.bound(PERIODS))

    def sums(self) -> dict[str, Any]:
        """Sums over all samples, JSON-able, of which `figures` makes those of several tallies."""
        error, level = (np.concatenate(part, axis=1) for part in (self.error, self.level))
        known = np.isfinite(level)
        bound = np.concatenate(self.bound, axis=1) if self.bound else np.zeros((2, 0))
        return {
            "craft_periods": self.samples,
            "beyond_level": self.beyond,
            "examples": self.beyond_by[:10],
            "worst": self.worst.tolist(),
            "settled": error.shape[1],
            "without_level": int(np.count_nonzero(~known.all(axis=0))),
            "with_level": known.sum(axis=1).tolist(),
            "error": np.sum(error**2, axis=1).tolist(),
            "level": np.sum(np.where(known, level, 0.0) ** 2, axis=1).tolist(),
            "median": np.median(level, axis=1).tolist(),
            "bounds": bound.shape[1],
            "bound": bound.sum(axis=1).tolist(),
        }


def figures(parts: list[dict[str, Any]]) -> dict[str, Any]:
    """The figures of a case from the sums of its parts, JSON-able; medians are means of those of the parts."""

    def total(name: str) -> Any:
        return np.sum([part[name] for part in parts], axis=0)

    rms = np.sqrt(total("error") / total("settled"))
    level = np.sqrt(total("level") / np.maximum(total("with_level"), 1))
    worst, middle = (
        np.max([part["worst"] for part in parts], axis=0),
        np.mean([part["median"] for part in parts], axis=0),
    )
    bound = np.sqrt(total("bound") / total("bounds")) if total("bounds") else None
    out = {
        "craft_periods": int(total("craft_periods")),
        "beyond_level": int(total("beyond_level")),
        "examples": [one for part in parts for one in part["examples"]][:10],
        "without_level": int(total("without_level")),
    }
    for i, (name, unit, scale) in enumerate((("position", "mm", 1e3), ("attitude", "deg", 1.0))):
        out[f"{name}_worst_share_of_level"] = float(worst[i])
        out[f"{name}_rms_{unit}"] = scale * float(rms[i])
        out[f"{name}_level_median_{unit}"] = scale * float(middle[i])
        out[f"{name}_level_rms_{unit}"] = scale * float(level[i])
        out[f"{name}_ratio"] = float(level[i] / rms[i])
        if bound is not None:
            out[f"{name}_bound_{unit}"] = scale * float(bound[i])
            out[f"{name}_bound_over_rms"] = float(bound[i] / rms[i])
            out[f"{name}_over_bound"] = float(level[i] / bound[i])
    return out


def flown(name: str, craft: int, seed: int, false_photodiodes: int = 2) -> dict[str, Any]:
    """The sums of one batch of a case."""
    case, tally = CASES[name], Tally()
    tally.add(StationBatch(craft, seed, case) if case.stations else Batch(craft, seed, case, false_photodiodes))
    return tally.sums()


def planned(folder: Path, most: int, only: list[str]) -> dict[str, list[dict[str, Any]]]:
    """The sums of the parts of the plan that are in a folder, after `most` of those that were missing were flown."""
    folder.mkdir(parents=True, exist_ok=True)
    out: dict[str, list[dict[str, Any]]] = {name: [] for name in PLAN if name in only}
    for seed in range(max(batches for batches, _ in PLAN.values())):
        for name in out:
            batches, craft = PLAN[name]
            path = folder / f"{name.replace(', ', '-').replace(' ', '-')}-{seed}.json"
            if seed >= batches or (most <= 0 and not path.exists()):
                continue
            if not path.exists():
                most -= 1
                path.write_text(json.dumps(flown(name, craft, seed)), encoding="utf-8")
            out[name].append(json.loads(path.read_text(encoding="utf-8")))
    return {name: parts for name, parts in out.items() if parts}


def main() -> None:
    """Fly, and print JSON."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--craft", type=int, default=210)
    parser.add_argument("--batches", type=int, default=4)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", nargs="+", choices=CASES, default=list(CASES), help="cases")
    parser.add_argument("--false-photodiodes", type=int, default=2, help="0: levels by slope")
    parser.add_argument("--plan", type=Path, help="folder of the parts of the plan")
    parser.add_argument("--parts", type=int, default=1000, help="parts of the plan to fly now")
    asked = parser.parse_args()
    if asked.plan is not None:
        found = planned(asked.plan, asked.parts, asked.only)
        print(json.dumps({name: figures(parts) for name, parts in found.items()}, indent=2))
        print(json.dumps({"craft_periods": sum(part["craft_periods"] for of in found.values() for part in of)}))
        return
    out = {}
    for name in asked.only:
        seeds = range(asked.seed, asked.seed + asked.batches)
        out[name] = figures([flown(name, asked.craft, seed, asked.false_photodiodes) for seed in seeds])
    print(json.dumps(out, indent=2))


if __name__ == "__main__":
    main()
