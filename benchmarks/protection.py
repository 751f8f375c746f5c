"""Protection levels of the filter by separation of solutions against errors: Monte Carlo of craft as their filter has
them.

    python benchmarks/protection.py [--craft 210] [--batches 4] [--only CASE ...] [--false-photodiodes 2]

Mockups about 3 m before the lighthouse, each pushed by white accelerations as its filter assumes, by the compiled bank.
A batch is so many craft for 240 periods. Per case prints, in JSON: craft-periods with an estimate, those with an error
beyond the level, the largest error as a share of its level, the RMS error, the level (root mean square over time and
craft, and median) and the ratio of the former to the RMS error, all after the first second.

Poses of one lighthouse, with two photodiodes that may be false: `clean`; `reflections` and `small reflections`, 5 % of
all sweeps off by up to 5 degrees or 0.03; `two false`, two photodiodes of every craft off all the time by angles of any
size from a tenth of the noise to a thousand times; `dark`, a second without light, in which a constant push of up to
0.2 m/s^2 and 20 deg/s^2 per axis comes on top, which the craft are told to allow for.

Row by row, by filters of one model of motion: `tight` and `tight, one false`, one photodiode that may be false;
before two stations whose lines of sight cross at 90 degrees, one of which may be false: `stations`, `stations, biased`,
all angles of one off by any size from a tenth of the noise to a thousand times, and `stations, moved`, one of them not
where it is taken to be, by 0.1 to 100 mm and up to 10 mrad.
"""

import argparse
import json
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from pushed_motion import pushed

from estimators import rotation as rot
from estimators.arrays import Bools, Floats
from estimators.lighthouse.innovation import gathered
from estimators.lighthouse.rows import Rows, Station
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


class Case(NamedTuple):
    """share, spread_rad: of sweeps that are reflections, and how far off. false: number of false photodiodes. dark:
    whether there is a second without light, and a push in it. coupling: of the navigation. station: "" before the one
    lighthouse; before two, what is wrong with one of them.
    """

    share: float = 0.0
    spread_rad: float = 0.0
    false: int = 0
    dark: bool = False
    coupling: str = "auto"
    station: str = ""


CASES = {
    "clean": Case(),
    "reflections": Case(share=0.05, spread_rad=np.radians(5.0)),
    "small reflections": Case(share=0.05, spread_rad=np.radians(0.03)),
    "two false": Case(false=2),
    "dark": Case(dark=True),
    "tight": Case(coupling="tight"),
    "tight, one false": Case(coupling="tight", false=1),
    "stations": Case(station="clean"),
    "stations, biased": Case(station="biased"),
    "stations, moved": Case(station="moved"),
}


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
    """Craft of one batch before two stations, of whose noise each sweep has one draw and each photodiode another."""

    def __init__(self, craft: int, seed: int, case: Case) -> None:
        """Place them."""
        scenario = load("two-stations", ["navigation.integrity.false_stations=1", *QUIET_OFF])
        flight = Flight(load("drift"))
        self.rng, self.craft = np.random.default_rng(seed), craft
        rng = self.rng
        self.settings = replace(builders.navigation(scenario), filter="compiled")
        self.layout = Photodiodes._make(np.repeat(part[:1], craft, axis=0) for part in flight.world.photodiodes)
        facing = rot.matrix_from_quaternion(flight.motions.start().quaternion[:1])
        at = rng.uniform([-0.5, -0.5, 2.5], [0.5, 0.5, 3.5], (craft, 3))
        turn = rot.exp(rng.uniform(-0.3, 0.3, (craft, 3))) @ facing
        self.truth = State(turn, at, np.zeros((craft, 3)), np.zeros((craft, 3)))
        self.noise = station_noise(scenario)
        known, up = [], np.array([0.0, 1.0, 0.0])
        for side in (-3.0, 3.0):
            ahead = np.array([-side, 0.0, 3.0]) / np.hypot(side, 3.0)
            across = np.stack([np.cross(up, ahead), up, ahead], axis=1)
            known.append(Station(across, np.array([side, 0.0, 0.0]), LIGHTHOUSE_1))
        relations = replace(self.settings.relations, common_rad=(0.0, 0.0), turn_s=(self.settings.frame_s,) * 2)
        self.settings = replace(self.settings, relations=relations)
        self.navigator = StationNavigator(self.layout, self.settings, known, self.noise)
        self.known, self.bias = known, np.zeros((craft, 2))
        self.moved = np.zeros((craft, 3)), np.tile(np.eye(3), (craft, 1, 1))
        self.wrong = rng.integers(0, 2, craft)
        direction = rng.standard_normal((2, craft, 3))
        direction /= np.linalg.norm(direction, axis=2, keepdims=True)
        if case.station == "biased":
            angle = rng.uniform(0, 2 * np.pi, craft)
            size = np.hypot(*self.noise[0]) * 10 ** rng.uniform(-1, 3, craft)
            self.bias = size[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        elif case.station == "moved":
            shift = direction[0] * 10 ** rng.uniform(-4, -1, craft)[:, None]
            self.moved = shift, rot.exp(direction[1] * 10 ** rng.uniform(-5, -2, craft)[:, None])

    def period(self, number: int) -> Estimate:
        """Move on by one period, measure and navigate."""
        s, rng, shape = self.settings, self.rng, self.truth.position.shape
        push = s.acceleration_noise_m_s2 * rng.standard_normal(shape)
        twist = s.angular_acceleration_noise_rad_s2 * rng.standard_normal(shape)
        self.truth = pushed(self.truth, push, twist, s.frame_s)
        none = np.zeros(self.craft, dtype=np.int64)
        parts = [self._rows(station, fan, number) for station in (0, 1) for fan in (0, 1)]
        craft = np.concatenate([part[0] for part in parts])
        rows = Rows._make(np.concatenate(column) for column in zip(*(part[1] for part in parts), strict=True))
        return self.navigator.step(RowLight(gathered(craft, rows, self.craft), none, none))

    def _rows(self, station: int, fan: int, number: int) -> tuple[Any, Rows]:
        """The craft and the rows of one sweep."""
        truth, known, rng = self.truth, self.known[station], self.rng
        wrong = self.wrong == station
        shift, turn = np.where(wrong[:, None], self.moved[0], 0.0), self.moved[1].copy()
        turn[~wrong] = np.eye(3)
        tau = -self.settings.frame_s * (0.125 + 0.25 * (2 * station + fan))
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
        craft, photodiode = np.nonzero(seen & np.isfinite(angle))
        every = np.ones(len(craft), dtype=np.int64)
        sweep = number * every
        return craft, Rows(
            station * every, fan * every, photodiode, sweep, np.full(len(craft), tau), angle[craft, photodiode]
        )


class Tally:
    """Errors and levels of a case."""

    def __init__(self) -> None:
        self.samples = self.beyond = 0
        self.worst = np.zeros(2)
        self.error: list[Floats] = []
        self.level: list[Floats] = []
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

    def figures(self) -> dict[str, Any]:
        """JSON-able."""
        error, level = (np.concatenate(part, axis=1) for part in (self.error, self.level))
        rms = np.sqrt(np.mean(error**2, axis=1))
        middle = np.median(level, axis=1)
        with np.errstate(invalid="ignore"):
            mean = np.sqrt(np.mean(np.where(np.isfinite(level), level, 0.0) ** 2, axis=1))
        return {
            "craft_periods": self.samples,
            "beyond_level": self.beyond,
            "examples": self.beyond_by[:10],
            "worst_share_of_level": dict(zip(("position", "attitude"), self.worst.tolist(), strict=True)),
            "without_level": int(np.count_nonzero(~np.isfinite(level).all(axis=0))),
            "position_rms_mm": 1e3 * float(rms[0]),
            "attitude_rms_deg": float(rms[1]),
            "position_level_median_mm": 1e3 * float(middle[0]),
            "attitude_level_median_deg": float(middle[1]),
            "position_level_rms_mm": 1e3 * float(mean[0]),
            "attitude_level_rms_deg": float(mean[1]),
            "position_ratio": float(mean[0] / rms[0]),
            "attitude_ratio": float(mean[1] / rms[1]),
        }


def main() -> None:
    """Fly, and print JSON."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--craft", type=int, default=210)
    parser.add_argument("--batches", type=int, default=4)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", nargs="+", choices=CASES, default=list(CASES), help="cases")
    parser.add_argument("--false-photodiodes", type=int, default=2, help="0: levels by slope")
    asked = parser.parse_args()
    out = {}
    for name in asked.only:
        tally = Tally()
        for number in range(asked.batches):
            seed, case = asked.seed + number, CASES[name]
            alone = not case.station
            tally.add(
                Batch(asked.craft, seed, case, asked.false_photodiodes)
                if alone
                else StationBatch(asked.craft, seed, case)
            )
        out[name] = tally.figures()
    print(json.dumps(out, indent=2))


if __name__ == "__main__":
    main()
