"""Relative navigation of two craft under one light: covariances against Monte Carlo, with and without fan errors.

    python benchmarks/relative.py [--trials 300] [--each 1] [--only CASE]

Pairs of mockups 3 m before the lighthouse, side by side, each with its own draws of everything: photodiodes, rotor,
motion (white accelerations, as the filter assumes them), and what is left of the fans' errors. A pair's two craft have
the rotor and the fans in common. Every craft runs the product's navigation on its sweep angles; after the filter has
settled the error of each pair's relative pose, in the axes of its first craft, is compared with its covariance.

`lateral` is the position across the line of sight, where the rotor's error cancels; its gain is the sigma of a
difference of independent errors over the true one, of the filter and of poses of one period. `lateral_variance` is that
of each craft alone, `common_part` the covariance between both. Figures of fan errors are
those of 2 % of what the fans of a real station have (scenarios/survey.toml): its own errors times 0.02 where they stand
alone, drawn with that standard deviation beside noise.

`theory` is what two filters of one model of motion, each for itself, reach (`benchmarks/filter_theory.py`), and `bound`
the least that any navigation of both could, which had the errors of the fans among its states.
"""

import argparse
import json
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from filter_theory import Model, Seen, separate, together
from pushed_motion import pushed
from scipy.stats import chi2

from estimators import rotation as rot
from estimators.arrays import Floats
from estimators.lighthouse.innovation import light_of, rows_of_sweeps
from estimators.lighthouse.rows import Station, linearise, packed
from estimators.lighthouse.shared import Common, considered_errors, pose_sensitivity, shared_sums
from estimators.lighthouse.sweep import HALF_PI, LIGHTHOUSE_1, FanErrors, FanPair, lighthouse_1, measured_angles
from estimators.relative.pose import covariance_between, relative
from estimators.state import STATES, State
from swarm.flight import builders
from swarm.flight.flight import Flight
from swarm.hardware import Photodiodes
from swarm.onboard.decoder import SweepAngles
from swarm.onboard.navigation import Estimate, Navigator
from swarm.onboard.settings import NavigationSettings
from swarm.onboard.shared_errors import Relations
from swarm.scenario import load

SURVEY = load("survey").lighthouse
REAL: FanPair = FanErrors(**SURVEY.fan_x.model_dump()), FanErrors(**SURVEY.fan_y.model_dump())
"""Errors of the fans of a real station."""
SETTLE, SETTLE_QUIET, APART = 60, 300, 45
"""Periods before the first sample of a pair, and between two of its samples."""
POSE = np.array([0, 1, 2, 6, 7, 8])
THEORY = 16
"""Pairs that theory is the mean of."""


def gibbous(errors: FanErrors) -> complex:
    """The once-per-turn error as m cos(phase) + i m sin(phase)."""
    return complex(errors.gibbous_magnitude * np.exp(1j * errors.gibbous_phase_rad))


def changed(errors: FanErrors, by: Floats) -> FanErrors:
    """Fan errors with phase, tilt, curve and both parts of the once-per-turn error larger by `by` (5,)."""
    wave = gibbous(errors) + complex(by[3], by[4])
    phase, tilt, curve = (float(value) for value in np.array(errors[:3]) + by[:3])
    return FanErrors(phase, tilt, curve, float(np.angle(wave)), float(np.abs(wave)))


def left_over(share: float) -> Floats:
    """A share of the errors of the real station, (2, 5)."""
    return share * np.array([[*e[:3], gibbous(e).real, gibbous(e).imag] for e in REAL])


def sigmas(share: float) -> tuple[tuple[str, float], ...]:
    """Standard deviations of the terms: a share of their RMS over the fans of the real station."""
    size = np.sqrt(np.mean(left_over(share) ** 2, axis=0))
    wave = float(np.hypot(size[3], size[4]) / np.sqrt(2))
    return (
        ("phase", float(size[0])),
        ("tilt", float(size[1])),
        ("curve", float(size[2])),
        ("gibbous", wave),
        ("ogee", 0),
    )


class Case(NamedTuple):
    """One case. share: of the fan errors that is left over; drawn: at random with that size, or as they are. coupling:
    of the navigation. turned: largest turn of either craft of a pair against the other, per axis [rad]. noisy: whether
    angles have noise and craft are pushed; the filters assume both. quiet: craft that nothing but the process noise of
    the quietest model of motion pushes, by a filter of several models; alone: by that model alone.
    """

    share: float = 0.0
    drawn: bool = False
    coupling: str = "auto"
    turned: float = 0.05
    noisy: bool = True
    quiet: bool = False
    alone: bool = False


CASES = {
    "noise": Case(),
    "noise, turned by 20 deg": Case(turned=0.35),
    "noise, tight": Case(coupling="tight"),
    "noise, quiet": Case(quiet=True),
    "noise, quiet, one model": Case(quiet=True, alone=True),
    "fan errors alone": Case(share=0.02, noisy=False),
    "fan errors and noise": Case(share=0.02, drawn=True),
    "fan errors and noise, turned by 20 deg": Case(share=0.02, drawn=True, turned=0.35),
    "fan errors and noise, tight": Case(share=0.02, drawn=True, coupling="tight"),
    "fan errors and noise, quiet": Case(share=0.02, drawn=True, quiet=True),
}


class Pairs:
    """`count` pairs of craft, (2 count) in all, craft 2 n and 2 n + 1 a pair `apart_m` from each other."""

    def __init__(self, count: int, apart_m: float, seed: int, case: Case) -> None:
        """Place them."""
        share, self.case = case.share, case
        scenario = load("drift", [f"navigation.quiet.craft={'all' if case.quiet else 'none'}"])
        flight = Flight(scenario)
        one = flight.world.photodiodes
        self.rng, self.count = np.random.default_rng(seed), count
        rng, craft = self.rng, 2 * count
        layout = Photodiodes._make(np.repeat(part[:1], craft, axis=0) for part in one)
        self.layout = layout
        noise = builders.navigation(scenario).noise
        relations = Relations(
            tuple((2 * n, 2 * n + 1) for n in range(count)),
            (),
            (noise.shared_rad,),
            (1 / scenario.lighthouse.rate_hz,),
            sigmas(share) if share else (),
        )
        self.settings: NavigationSettings = replace(
            builders.navigation(scenario),
            relations=relations,
            filter="compiled",
            coupling=case.coupling,
            fan_x=REAL[0] if share else FanErrors(),
            fan_y=REAL[1] if share else FanErrors(),
        )
        if case.alone and self.settings.quiet is not None:
            least = self.settings.quiet
            self.settings = replace(
                self.settings,
                quiet=None,
                acceleration_noise_m_s2=least.acceleration_noise_m_s2,
                angular_acceleration_noise_rad_s2=least.angular_acceleration_noise_rad_s2,
            )
        self.noise = noise
        known: FanPair = self.settings.fan_x, self.settings.fan_y
        size = np.array([sigma for _, sigma in sigmas(share)])[[0, 1, 2, 3, 3]]
        self.fans = []
        for _ in range(count):
            by = size * rng.standard_normal((2, 5)) if case.drawn else left_over(share)
            self.fans.append(lighthouse_1(*(changed(e, b) for e, b in zip(known, by, strict=True))))
        facing = rot.matrix_from_quaternion(flight.motions.start().quaternion[:1])
        at = np.repeat(rng.uniform([-0.3, -0.3, 2.9], [0.3, 0.3, 3.1], (count, 3)), 2, axis=0)
        direction = rng.uniform(0, 2 * np.pi, count)
        side = np.stack([np.cos(direction), np.sin(direction), np.zeros(count)], axis=1)
        at[0::2] -= apart_m / 2 * side
        at[1::2] += apart_m / 2 * side
        both = np.repeat(rot.exp(rng.uniform(-0.4, 0.4, (count, 3))), 2, axis=0)
        turn = rot.exp(rng.uniform(-case.turned, case.turned, (craft, 3))) @ both @ facing
        self.truth = State(turn, at, np.zeros((craft, 3)), np.zeros((craft, 3)))
        self.navigator = Navigator(layout, self.settings)

    def period(self) -> Estimate:
        """Move on by one period, measure and navigate."""
        s, rng, truth = self.settings, self.rng, self.truth
        dt = s.frame_s
        if not self.case.noisy:
            return self.navigator.step(self._angles(truth))
        model = s.quiet if self.case.quiet and s.quiet is not None else s
        push = model.acceleration_noise_m_s2 * rng.standard_normal(truth.position.shape)
        twist = model.angular_acceleration_noise_rad_s2 * rng.standard_normal(truth.position.shape)
        self.truth = truth = pushed(truth, push, twist, dt)
        return self.navigator.step(self._angles(truth))

    def _angles(self, truth: State) -> SweepAngles:
        rng, (craft, most, _) = self.rng, self.layout.point_m.shape
        theta, offset = np.full((craft, most, 2), np.nan), np.zeros((craft, most, 2))
        rate = 1 / self.settings.frame_s
        noisy = float(self.case.noisy)
        shared = np.repeat(noisy * self.noise.shared_rad * rng.standard_normal((self.count, 2)), 2, axis=0)
        own = noisy * self.noise.own_rad * rng.standard_normal((craft, most, 2))
        toward = -truth.position / np.linalg.norm(truth.position, axis=1, keepdims=True)
        normal = np.einsum("cij,ckj->cki", truth.rotation, self.layout.normal)
        lit = self.layout.present & (np.einsum("cki,ci->ck", normal, toward) > np.cos(np.radians(80)))
        for fan, quarter in enumerate((-0.25, 0.25)):
            tau = np.full((craft, most), quarter / rate)
            for _ in range(2):  # the instant at which the fan reaches the photodiode
                turn = rot.exp(truth.angular_rate[:, None] * tau[..., None])
                arm = (turn @ (truth.rotation[:, None] @ self.layout.point_m[..., None]))[..., 0]
                where = truth.position[:, None] + truth.velocity[:, None] * tau[..., None] + arm
                a = np.empty((craft, most))
                for n, fans in enumerate(self.fans):
                    a[2 * n : 2 * n + 2] = measured_angles(where[2 * n : 2 * n + 2], fans[fan : fan + 1])[..., 0]
                tau = quarter / rate + a / (2 * np.pi * rate)
            theta[..., fan], offset[..., fan] = HALF_PI + a + shared[:, fan, None] + own[..., fan], tau
        theta[~lit], offset[~lit] = np.nan, 0.0
        none = np.zeros(craft, dtype=np.int64)
        return SweepAngles(theta, offset, lit, none, none, none)

    def seen(self, craft: int) -> Seen:
        """The rows of one craft as they stand now, with their derivatives by the errors of the fans it knows."""
        angles, truth = self._angles(self.truth), self.truth.of(craft)
        rows = rows_of_sweeps(angles.theta, angles.offset_s).of(craft)
        known: FanPair = self.settings.fan_x, self.settings.fan_y
        light = lighthouse_1(*known)
        before = packed([Station(np.eye(3), np.zeros(3), light)])
        at = truth.rotation, truth.position, truth.velocity, truth.angular_rate
        _, h = linearise(rows, before, self.layout.point_m[craft], *at)
        there = self.layout.point_m[craft, rows.photodiode] @ truth.rotation.T + truth.position
        d = np.zeros((len(rows.angle), 10))
        for term in range(10 if self.case.share else 0):
            by = np.zeros((2, 5))
            by[term // 5, term % 5] = 1e-6
            other = lighthouse_1(*(changed(e, b) for e, b in zip(known, by, strict=True)))
            moved = (measured_angles(there, other) - measured_angles(there, light)) / 1e-6
            d[:, term] = np.where(rows.fan == term // 5, moved[:, term // 5], 0.0)
        return Seen(h, d, np.asarray(rows.fan))

    def theory(self) -> dict[str, float]:
        """What theory says of the relative poses, root mean square of `THEORY` pairs."""
        s, case = self.settings, self.case
        model = s.quiet if case.quiet and s.quiet is not None else s
        size = np.tile(np.array([sigma for _, sigma in sigmas(case.share)])[[0, 1, 2, 3, 3]], 2)
        push = model.acceleration_noise_m_s2, model.angular_acceleration_noise_rad_s2
        periods = SETTLE_QUIET if case.quiet else SETTLE
        asked = Model(self.noise.own_rad, self.noise.shared_rad, size**2, *push, s.frame_s, periods)
        found: dict[str, list[Floats]] = {"theory": [], "independent": [], "bound": []}
        for n in range(min(THEORY, self.count)):
            both = [self.seen(2 * n), self.seen(2 * n + 1)]
            apart = separate(both, asked)
            for name, all_errors, cross in (
                ("theory", apart, 1.0),
                ("independent", apart, 0.0),
                ("bound", together(both, asked), 1.0),
            ):
                there = relative(self.truth.of(2 * n), self.truth.of(2 * n + 1))
                own, other, common = (
                    all_errors[:STATES, :STATES],
                    all_errors[STATES:, STATES:],
                    cross * all_errors[:STATES, STATES:],
                )
                frame = np.kron(np.eye(2), self.truth.rotation[2 * n])
                part = covariance_between(there, own, other, common)[np.ix_(POSE, POSE)]
                found[name].append(frame @ part @ frame.T)
        parts = {name: np.array(value) for name, value in found.items()}
        return {
            "theory_mm": 1e3 * root(parts["theory"], 3),
            "theory_deg": float(np.degrees(root(parts["theory"], 0))),
            "theory_lateral_gain": root(parts["independent"], 3, 2) / root(parts["theory"], 3, 2),
            "bound_for_any_navigation_mm": 1e3 * root(parts["bound"], 3),
            "bound_for_any_navigation_deg": float(np.degrees(root(parts["bound"], 0))),
        }

    def lateral_gain(self) -> float:
        """The gain of the lateral position of poses of one period alone, as they stand now: by theory."""
        angles, every = self._angles(self.truth), np.ones(2 * self.count, dtype=np.bool_)
        rows = rows_of_sweeps(angles.theta, angles.offset_s)
        sums = shared_sums(
            rows,
            np.ones(len(rows.angle), dtype=np.bool_),
            every,
            light_of(packed([Station(np.eye(3), np.zeros(3), LIGHTHOUSE_1)]), [self.noise]),
            Common(np.array([self.noise.shared_rad]), np.array([self.settings.frame_s]), np.zeros((2, 0))),
            considered_errors(()),
            self.layout.point_m,
            self.truth,
            weighted=False,
        )
        by_rotor, _ = pose_sensitivity(sums, every)
        own = self.noise.own_rad**2 * np.linalg.inv(sums.information[:, POSE[:, None], POSE])
        alone = own + by_rotor @ np.swapaxes(by_rotor, 1, 2)
        both = by_rotor[0::2] @ np.swapaxes(by_rotor[1::2], 1, 2)
        independent = alone[0::2] + alone[1::2]
        return root(independent, 3, 2) / root(independent - both - np.swapaxes(both, 1, 2), 3, 2)

    def samples(self, each: int) -> dict[str, Floats]:
        """Errors and covariances of all pairs at `each` instants."""
        out: dict[str, list[Any]] = {
            name: [] for name in ("error", "covariance", "independent", "bound", "own", "own_p")
        }
        settle = SETTLE_QUIET if self.case.quiet else SETTLE
        for number in range(settle + APART * (each - 1) + 1):
            estimate = self.period()
            if number < settle or (number - settle) % APART:
                continue
            found, truth = estimate.relative, self.truth
            assert found is not None
            if not np.isfinite(found.position).all():
                raise SystemExit("a pair has lost its track")
            own, other = truth.rotation[0::2], truth.rotation[1::2]
            turn = rot.log(np.swapaxes(own, 1, 2) @ other @ np.swapaxes(found.rotation, 1, 2))
            apart = (truth.position[1::2] - truth.position[0::2])[:, None] @ own
            out["error"].append(np.concatenate([turn, apart[:, 0] - found.position], axis=1))
            frame = np.zeros((self.count, 6, 6))
            frame[:, :3, :3] = frame[:, 3:, 3:] = own
            # In the lighthouse's axes, where across and along the line of sight are told apart.
            out["error"][-1] = np.einsum("nij,nj->ni", frame, out["error"][-1])
            for name, value in (
                ("covariance", found.covariance),
                ("independent", found.independent),
                ("bound", found.bound),
            ):
                out[name].append(frame @ value[:, POSE[:, None], POSE] @ np.swapaxes(frame, 1, 2))
            alone = rot.log(truth.rotation @ np.swapaxes(estimate.rotation, 1, 2))
            out["own"].append(np.concatenate([alone, truth.position - estimate.position], axis=1))
            out["own_p"].append(estimate.covariance[:, POSE[:, None], POSE])
        return {name: np.concatenate(value) for name, value in out.items()}


def nees(error: Floats, covariance: Floats) -> dict[str, Any]:
    """The mean NEES of samples (n, 6) and the 95 % band of the mean."""
    value = np.einsum("ni,ni->n", error, np.linalg.solve(covariance, error[..., None])[..., 0])
    low, high = chi2.ppf([0.025, 0.975], 6 * len(value)) / len(value)
    mean = float(value.mean())
    return {"mean": mean, "low": float(low), "high": float(high), "inside": bool(low <= mean <= high)}


def rms(error: Floats) -> float:
    """The RMS length of vectors (n, 3)."""
    return float(np.sqrt(np.mean(np.sum(error**2, axis=1))))


def root(covariance: Floats, first: int, count: int = 3) -> float:
    """The root of the mean trace of a block of covariances (n, 6, 6)."""
    return float(
        np.sqrt(np.mean(np.trace(covariance[:, first : first + count, first : first + count], axis1=1, axis2=2)))
    )


def figures(pairs: Pairs, each: int) -> dict[str, Any]:
    """All figures of one set of pairs."""
    s = pairs.samples(each)
    lateral = np.sqrt(np.mean(np.sum(s["error"][:, 3:5] ** 2, axis=1)))
    common = np.sum(s["own"][0::2, 3:5] * s["own"][1::2, 3:5], axis=1)
    claimed = (root(s["independent"], 3, 2) ** 2 - root(s["covariance"], 3, 2) ** 2) / 2
    alone = float(np.mean(np.sum(s["own"][:, 3:5] ** 2, axis=1)))
    return {
        "samples": len(s["error"]),
        "absolute_mm": 1e3 * rms(s["own"][:, 3:]),
        "absolute_deg": float(np.degrees(rms(s["own"][:, :3]))),
        "absolute_sigma_mm": 1e3 * root(s["own_p"], 3),
        "absolute_nees": nees(s["own"][0::2], s["own_p"][0::2]),
        "relative_mm": 1e3 * rms(s["error"][:, 3:]),
        "relative_deg": float(np.degrees(rms(s["error"][:, :3]))),
        "relative_sigma_mm": 1e3 * root(s["covariance"], 3),
        "relative_sigma_deg": float(np.degrees(root(s["covariance"], 0))),
        "independent_sigma_mm": 1e3 * root(s["independent"], 3),
        "bound_sigma_mm": 1e3 * root(s["bound"], 3),
        "lateral_mm": 1e3 * float(lateral),
        "lateral_sigma_mm": 1e3 * root(s["covariance"], 3, 2),
        "lateral_variance_over_claimed": alone / root(s["own_p"], 3, 2) ** 2,
        "lateral_common_part_over_claimed": float(common.mean()) / claimed,
        "its_standard_error": float(common.std() / np.sqrt(len(common))) / claimed,
        "claimed_common_part": claimed / root(s["own_p"], 3, 2) ** 2,
        "lateral_gain": root(s["independent"], 3, 2) / root(s["covariance"], 3, 2),
        "lateral_gain_of_poses": pairs.lateral_gain(),
        **(pairs.theory() if pairs.case.noisy else {}),
        "relative_nees": nees(s["error"], s["covariance"]),
        "independent_nees": nees(s["error"], s["independent"]),
        "bound_nees": nees(s["error"], s["bound"]),
    }


def main() -> None:
    """Fly, and print JSON."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--trials", type=int, default=300, help="pairs of a case")
    parser.add_argument("--each", type=int, default=1, help="samples of a pair, which drifts apart meanwhile")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", nargs="+", choices=CASES, default=list(CASES), help="cases")
    asked = parser.parse_args()
    out = {
        f"{name}, {apart} m": figures(Pairs(asked.trials, apart, asked.seed, CASES[name]), asked.each)
        for name in asked.only
        for apart in (0.3, 1.0)
    }
    print(json.dumps(out, indent=2))


if __name__ == "__main__":
    main()
