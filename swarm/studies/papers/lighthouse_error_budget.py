"""The error budget: the budget of every source of table 1 of source 1 to the pose, alone and together.

    table 1                         here                                                           1 sigma
    straightness of the laser line  `curve` of (E), estimators.lighthouse.sweep                               0.002
    motor-speed fluctuation         once per turn: `gibbous_magnitude` of (E), at any phase        0.01 rad
                                    random: shared by the photodiodes of a sweep (19)              what is left of s
    skew of the rotation axis       `tilt` of (E)                                                  0.01 rad
    sync-pulse jitter               shared by the photodiodes of a sweep, w times                  50 ns
    photodiode mounting             every photodiode and axis                                      0.5 mm
    photodiode trigger time         every photodiode and sweep by itself, w times                  what is left of s
    timing                          ticks, of flash and sweep                                      20 ns long

The paper gives no sizes. The systematic ones are typical of real stations; the random ones add up to its noise: those
that a sweep shares to sqrt(rho) s, the others to sqrt(1 - rho) s, the tick's rounding of flash and sweep,
tick / sqrt(12) each, included. The constant phase of a fan is no part of table 1.

A draw is one station and one craft: signs and values of its systematic errors, normal about zero. It is put at poses
all over the volume of section 4.3, at rest and moving at a constant velocity and rate. At rest and moving, every source
alone and all together are solved from the same draws. Moving, a source alone is solved with the motion known, so that
the motion within the period is one more source, and together nothing is known of it. Frames are aligned beforehand as
in section 4.3, from other poses at rest and without random errors; `raw` are the same errors at rest without that.
Errors are RMS over draws and poses. Independent and small, they add up in squares:

    e_all^2 = sum_source e_source^2
"""

from typing import NamedTuple

import numpy as np

from estimators import rotation as rot
from estimators.arrays import Bools, Floats
from estimators.lighthouse.dop import dilution
from estimators.lighthouse.pnp import PoseSolution
from estimators.lighthouse.sweep import FanErrors, FanPair
from swarm import figures
from swarm.studies.papers.alignment import NONE, Alignment, align
from swarm.studies.papers.bench import PERFECT, Bench, Box, Motion
from swarm.studies.papers.experiment import Columns, Grid, Line, Outcome, Request, data, under

CURVE, GIBBOUS, TILT = 0.002, 0.01, 0.01
SYNC_JITTER_S, MOUNTING_M = 50e-9, 0.5e-3
CONTINUOUS_S = 1e-10
"""A tick so short, 1/200 of the real one, that it rounds nothing."""
BOX = Box((0.0, 0.0, 3.0), (4.0, 2.0, 4.0), np.deg2rad(30))
SPEED_M_S, RATE_RAD_S = 0.3, np.deg2rad(40)
"""RMS, as in `handheld.toml`."""
SQUARES = (0.9, 1.1)
SHARE_POSES = 5000

STRAIGHTNESS, ONCE_PER_TURN, SKEW = "line straightness", "motor, once per turn", "axis skew"
ROTOR, JITTER, MOUNTING = "motor, random", "sync jitter", "mounting"
TRIGGER, TICKS, MOTION = "trigger time", "timing ticks", "motion in the period"
SYSTEMATIC = (STRAIGHTNESS, ONCE_PER_TURN, SKEW, MOUNTING)
RANDOM = (ROTOR, JITTER, TRIGGER, TICKS)
SOURCES = (*SYSTEMATIC, *RANDOM)
TOGETHER = "together"
NAMES = (*SOURCES, MOTION, TOGETHER)
UNITS = np.tile([180 / np.pi, 1e3], 3)
WHAT = ("rotation", "translation")
PLACES = ("at rest", "moving", "at rest, frames not aligned")
COLUMNS = ("rest, °", "mm", "moving, °", "mm", "raw, °", "mm")


class Sizes(NamedTuple):
    """1 sigma of the random sources, as angles [rad]."""

    rotor: float
    jitter: float
    trigger: float


class Draw(NamedTuple):
    """One station and one craft at P poses.

    fans: each source's errors. mounting (K, 3) [m]. angle: each random source's angle errors (P, K, 2) [rad].
    """

    fans: dict[str, FanPair]
    mounting_m: Floats
    angle: dict[str, Floats]

    def without_random(self) -> "Draw":
        """Return the systematic errors alone."""
        return self._replace(angle={})

    def all_fans(self) -> FanPair:
        """Return the systematic errors of all sources in one."""
        x, y = (
            FanErrors(
                tilt_rad=self.fans[SKEW][fan].tilt_rad,
                curve=self.fans[STRAIGHTNESS][fan].curve,
                gibbous_phase_rad=self.fans[ONCE_PER_TURN][fan].gibbous_phase_rad,
                gibbous_magnitude=self.fans[ONCE_PER_TURN][fan].gibbous_magnitude,
            )
            for fan in (0, 1)
        )
        return x, y


def run(request: Request) -> Outcome:
    """Draw, solve every source alone and all together, add up."""
    request.refuse_below(3, "the alignment of two frames", "poses")
    draws, poses = request.sizes["draws"], request.sizes["poses"]
    bench, rng = Bench(), request.rng()
    sizes = random_sizes(bench)
    squares = {name: np.zeros((draws, 6)) for name in NAMES}
    for i in range(draws):
        motion, lit = draw_motion(bench, rng, poses)
        other, other_lit = draw_motion(bench, rng, poses)
        rest, elsewhere = (Motion.rest(moving.rotation, moving.position) for moving in (motion, other))
        drawn = draw_errors(bench, sizes, poses, rng)
        for name in NAMES:
            frame = NONE
            if name in (*SYSTEMATIC, TOGETHER):
                pose = solve(bench, elsewhere, other_lit, drawn.without_random(), name, rng)
                frame = align(pose.position[pose.solved], elsewhere.position[pose.solved])
            if name != MOTION:
                pose = solve(bench, rest, lit, drawn, name, rng)
                squares[name][i, :2] = mean_squares(rest, pose, frame)
                squares[name][i, 4:] = mean_squares(rest, pose, NONE)
            squares[name][i, 2:4] = mean_squares(motion, solve(bench, motion, lit, drawn, name, rng), frame)
        if i % 10 == 0:
            request.progress(i / draws, f"draw {i + 1} of {draws}")
    budget = {name: np.sqrt(each.mean(axis=0)) * UNITS for name, each in squares.items()}
    budget[MOTION][[0, 1, 4, 5]] = np.nan
    notes = (
        f"{draws} stations and craft, at {poses} poses each. RMS, 1 sigma of each source as in the module's table: "
        f"motor speed random {sizes.rotor * 206265:.1f} arcsec, sync jitter {1e9 * SYNC_JITTER_S:.0f} ns, trigger time "
        f"{1e9 * sizes.trigger * bench.period_s / (2 * np.pi):.0f} ns; random ones add up to s = 8.8 arcsec.",
        "Poses are PnP's. raw: at rest, frames not aligned.",
    )
    grid = Grid("Contribution, RMS", COLUMNS, [(name, tuple(map(float, row))) for name, row in budget.items()])
    lines = [*_compare(budget), *_rotor_share(bench, request.seed)]
    return Outcome(lines, data(_columns(budget)), _draw(budget), notes, (grid,))


def random_sizes(bench: Bench) -> Sizes:
    """Return what jitter and ticks leave of the paper's noise to the motor and to the photodiodes' triggers."""
    settings = bench.settings
    w = 2 * np.pi * settings.rate_hz
    rounding, jitter = w * settings.tick_s / np.sqrt(12), w * SYNC_JITTER_S
    shared = settings.rotor_correlation * settings.angle_noise_rad**2
    own = (1 - settings.rotor_correlation) * settings.angle_noise_rad**2
    return Sizes(float(np.sqrt(shared - jitter**2 - rounding**2)), jitter, float(np.sqrt(own - rounding**2)))


def draw_motion(bench: Bench, rng: np.random.Generator, poses: int) -> tuple[Motion, Bools]:
    """Draw poses all over the volume, each moving in its own way.

    Args:
        bench: The craft before its lighthouse.
        rng: Source of the draws.
        poses: Number of poses P.

    Returns:
        The motion, and the photodiodes that are lit (P, K).
    """
    each = [bench.random_pose(rng, BOX) for _ in range(poses)]
    rotation, position = (
        np.concatenate([getattr(pose, part) for pose, _ in each]) for part in ("rotation", "position")
    )
    rate, velocity = (rng.standard_normal((poses, 3)) * rms / np.sqrt(3) for rms in (RATE_RAD_S, SPEED_M_S))
    return Motion(rotation, position, rate, velocity), np.concatenate([lit for _, lit in each])


def draw_errors(bench: Bench, sizes: Sizes, poses: int, rng: np.random.Generator) -> Draw:
    """Draw signs and values of every source.

    Args:
        bench: The craft before its lighthouse.
        sizes: Sizes of the random sources.
        poses: Number of poses P.
        rng: Source of the draws.
    """
    curve, gibbous, tilt = (size * rng.standard_normal(2) for size in (CURVE, GIBBOUS, TILT))
    phase = rng.uniform(0, 2 * np.pi, 2)
    fans: dict[str, FanPair] = {
        STRAIGHTNESS: (FanErrors(curve=curve[0]), FanErrors(curve=curve[1])),
        ONCE_PER_TURN: (
            FanErrors(gibbous_phase_rad=phase[0], gibbous_magnitude=gibbous[0]),
            FanErrors(gibbous_phase_rad=phase[1], gibbous_magnitude=gibbous[1]),
        ),
        SKEW: (FanErrors(tilt_rad=tilt[0]), FanErrors(tilt_rad=tilt[1])),
    }
    angle = {
        ROTOR: bench.noise(poses, rng, sizes.rotor, 1.0),
        JITTER: bench.noise(poses, rng, sizes.jitter, 1.0),
        TRIGGER: bench.noise(poses, rng, sizes.trigger, 0.0),
    }
    return Draw(fans, MOUNTING_M * rng.standard_normal(bench.point_m.shape), angle)


def solve(bench: Bench, true: Motion, lit: Bools, drawn: Draw, name: str, rng: np.random.Generator) -> PoseSolution:
    """Solve poses by PnP with one source at work, or all of them.

    Args:
        bench: The craft before its lighthouse.
        true: True poses and rates (P rows).
        lit: Photodiodes that are lit (P, K).
        drawn: Errors of every source.
        name: One of NAMES.
        rng: Source of the clocks' phases.
    """
    everything = name == TOGETHER
    silent = np.zeros((*lit.shape, 2))
    mounted = drawn.mounting_m if everything or name == MOUNTING else 0.0
    angles = bench.angles(
        true,
        lit,
        sum(drawn.angle.values(), silent) if everything else drawn.angle.get(name, silent),
        rng,
        fans=drawn.all_fans() if everything else drawn.fans.get(name, PERFECT),
        point_m=np.repeat((bench.point_m + mounted)[None], len(lit), axis=0),
        tick_s=None if everything or name == TICKS else CONTINUOUS_S,
    )
    return bench.solve(angles, true, at_rest=name in (MOTION, TOGETHER))


def mean_squares(true: Motion, pose: PoseSolution, frame: Alignment) -> tuple[float, float]:
    """Return the mean squared attitude [rad^2] and position [m^2] errors over the poses.

    Args:
        true: True poses.
        pose: Solved poses.
        frame: Alignment of the frames.
    """
    ok = pose.solved
    attitude = rot.angle_between(true.rotation[ok], frame.rotations(pose.rotation[ok]))
    position = true.position[ok] - frame.positions(pose.position[ok])
    return float(np.mean(attitude**2)), float(np.mean(np.sum(position**2, axis=-1)))


def _compare(budget: dict[str, Floats]) -> list[Line]:
    """Tell whether squares add up, and how far systematic errors outweigh random ones."""
    squares = {name: np.nan_to_num(values) ** 2 for name, values in budget.items()}
    total = squares.pop(TOGETHER)
    added = sum(squares.values(), np.zeros(6)) / total
    systematic, chance = (np.sqrt(sum((squares[name] for name in of), np.zeros(6))) for of in (SYSTEMATIC, RANDOM))
    sums = [
        Line(f"{what}, {place}", "", None, float(added[2 * i + k]), SQUARES)
        for i, place in enumerate(PLACES)
        for k, what in enumerate(WHAT)
    ]
    ratios = [Line(f"{what}, at rest", "", "about 10", float(systematic[k] / chance[k])) for k, what in enumerate(WHAT)]
    return under("Sum of squares / square of the total", *sums) + under("Systematic / random errors", *ratios)


def _rotor_share(bench: Bench, seed: int) -> list[Line]:
    """Return what the rotor's noise, rho of the angles' variance, makes of the position's, pose by pose, by (18).

    H is linear in the angles' covariance, so that the photodiodes' own part is (1 - rho) H(0).
    """
    rho = bench.settings.rotor_correlation
    motion, lit = draw_motion(bench, np.random.default_rng([seed, 1]), SHARE_POSES)
    points, still = np.broadcast_to(bench.point_m, (SHARE_POSES, *bench.point_m.shape)), np.zeros((SHARE_POSES, 3))
    every, at_once = np.ones(SHARE_POSES, dtype=np.bool_), np.zeros((*lit.shape, 2))

    def square(correlation: float) -> Floats:
        pose = motion.rotation, motion.position
        found: Floats = dilution(*pose, lit, points, at_once, still, still, correlation, every).pdop_m_per_rad ** 2
        return found

    share = 100 * (1 - (1 - rho) * square(0.0) / square(rho))
    return under(
        f"Rotor's noise, {100 * rho:.0f} % of the angles' variance: share of the position's",
        Line("median of the poses", "%", None, float(np.median(share))),
        Line("95 % of the poses below", "%", None, float(np.quantile(share, 0.95))),
        Line("largest", "%", None, float(share.max())),
    )


def _columns(budget: dict[str, Floats]) -> Columns:
    """Return the data, a row per source."""
    kind = {**dict.fromkeys(SYSTEMATIC, "systematic"), **dict.fromkeys(RANDOM, "random"), MOTION: "motion"}
    names = [f"{place}_{what}" for place in ("rest", "moving", "raw") for what in ("rotation_deg", "translation_mm")]
    values = np.array(list(budget.values())).T
    return {
        "source": (list(budget), "of table 1"),
        "kind": ([kind.get(name, "all") for name in budget], "systematic, random, motion or all"),
        **{name: (row, "RMS error that the source causes") for name, row in zip(names, values, strict=True)},
    }


def _draw(budget: dict[str, Floats]) -> figures.Figure:
    """Draw the budget as bars, at rest and moving, largest attitude error first."""
    page, axes = figures.page(1, 2, 4.2)
    order = sorted(budget, key=lambda name: float(budget[name][2]))
    number = np.arange(len(order))
    for c, (place, label) in enumerate(zip(axes[0], ("rotation, deg RMS", "translation, mm RMS"), strict=True)):
        rest, moving = (np.array([budget[name][c + 2 * m] for name in order]) for m in (0, 1))
        place.barh(number + 0.2, np.nan_to_num(rest), 0.38, color=figures.BLUE, label="at rest")
        place.barh(number - 0.2, moving, 0.38, color=figures.ORANGE, label="moving")
        place.set_xscale("log")
        place.set_xlabel(label)
        place.grid(visible=False, axis="y")
        place.set_yticks(number, order if c == 0 else [""] * len(order))
    figures.legend(axes[0, 1], place="lower right")
    return page
