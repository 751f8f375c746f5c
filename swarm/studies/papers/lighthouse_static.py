"""Static precision, source 1 section 4.2 and figure 5: what ADOP and PDOP predict against what is measured.

A craft rests at poses chosen freely on a 3 m x 3 m table, with at least 4 photodiodes lit; many frames each. Measured
is the scatter about the mean (of rotations: the mean rotation, not the mean of phi), predicted is DOP times noise:

    s_rot = (180/pi) sqrt( sum |phi(R_i R_mean^T)|^2 / N ),   s_trans likewise                         (23)
    s_rot = ADOP s,   s_trans = PDOP s,   s = 8.8 arcsec, rho = 0.8717                                 (24)

three times: with the dilution at the true pose; at every measured pose, as on board; and for a pinhole camera at the
same poses, whose image noise takes the place of the angle noise (`estimators.lighthouse.dop.image_dilution`).
"""

from typing import NamedTuple

import numpy as np

from estimators import rotation as rot
from estimators.arrays import Bools, Floats
from estimators.lighthouse.dop import dilution, image_dilution
from estimators.lighthouse.pnp import PoseSolution, refine_projections
from swarm import figures
from swarm.studies.papers.bench import Bench, Motion
from swarm.studies.papers.experiment import Columns, Line, Outcome, Request, data, span, under
from swarm.world.motion.pointing import facing

TABLE_M = ((-1.5, 1.5), (0.4, 0.4), (1.0, 4.0))
"""The table's x, y and z: 3 m x 3 m from 1 m before the lighthouse on, 0.4 m below it (y is down)."""
TILT_MAX_RAD = np.deg2rad(80)
"""The craft's front points this far from the lighthouse at most."""
FEWEST_LIT = 4
FEWEST_FRAMES = 100
IMAGE_NOISE = 0.1 / 1200
"""The camera's: 0.1 pixels at a focal length of 1200 pixels, 17 arcsec at its centre."""
WHAT = ("rotation", "translation")
MEDIAN, CORRELATION = (0.97, 1.03), (0.99, None)


class Pose(NamedTuple):
    """A pose of the craft: rotation (3, 3), position (3,) [m], lit (K,)."""

    rotation: Floats
    position: Floats
    lit: Bools


class Result(NamedTuple):
    """One pose: standard deviations of rotation [deg] and translation [m], (2,) each, measured and predicted.

    scatter: of the prediction from measured poses, over itself.
    """

    pose: Pose
    measured: Floats
    at_truth: Floats
    at_measured: Floats
    scatter: Floats
    camera_measured: Floats
    camera_predicted: Floats


def run(request: Request) -> Outcome:
    """Measure every pose and compare."""
    request.refuse_below(FEWEST_FRAMES, "a standard deviation", "frames")
    request.refuse_below(3, "a correlation", "poses")
    poses, frames = request.sizes["poses"], request.sizes["frames"]
    bench, rng = Bench(), request.rng()
    results: list[Result] = []
    ambiguous = 0
    for _ in request.each(range(poses), "pose"):
        while (result := _measure(bench, _draw_pose(bench, rng), frames, rng)) is None:
            ambiguous += 1
        results.append(result)
    notes = [
        f"{poses} poses, {frames} frames each. The ticks' rounding comes on top of s, and is not predicted: "
        "1 % of the measured."
    ]
    if ambiguous:
        notes.append(f"{ambiguous} poses more stayed ambiguous (two poses fit the angles) and were drawn anew.")
    return Outcome(_compare(results), data(_columns(results)), _draw(results), tuple(notes))


def _draw_pose(bench: Bench, rng: np.random.Generator) -> Pose:
    """Draw a pose on the table, with enough photodiodes lit."""
    while True:
        position = np.array([rng.uniform(low, high) for low, high in TABLE_M])
        towards = facing(position[None], np.zeros((1, 3)), np.zeros((1, 3))).rotation[0]
        # Uniform over the directions within the largest tilt.
        tilt = np.arccos(rng.uniform(np.cos(TILT_MAX_RAD), 1.0))
        azimuth, roll = rng.uniform(0, 2 * np.pi, 2)
        tilted = rot.exp(tilt * np.array([np.cos(azimuth), np.sin(azimuth), 0.0]))
        rotation = towards @ tilted @ rot.exp(np.array([0.0, 0.0, roll]))
        lit = bench.lit(rotation[None], position[None])[0]
        if np.count_nonzero(lit) >= FEWEST_LIT:
            return Pose(rotation, position, lit)


def _measure(bench: Bench, pose: Pose, frames: int, rng: np.random.Generator) -> Result | None:
    """Return the results of both sensors at one pose; None where the craft cannot tell which of two poses it has."""
    noise, correlation = bench.settings.angle_noise_rad, bench.settings.rotor_correlation
    true = Motion.rest(pose.rotation[None], pose.position[None]).repeat(frames)
    lit = np.repeat(pose.lit[None], frames, axis=0)
    angles = bench.angles(true, lit, bench.noise(frames, rng, noise, correlation), rng)
    first = bench.first_pose(angles, noise * float(np.sqrt(1 - correlation)))
    if first is None:
        return None
    start = first.repeat(frames)
    solution = bench.solve(angles, start)
    points, still = np.broadcast_to(bench.point_m, (frames, *bench.point_m.shape)), np.zeros((frames, 3))

    def predicted(rotation: Floats, position: Floats) -> Floats:
        found = dilution(rotation, position, lit, points, angles.offset_s, still, still, correlation, solution.solved)
        factors: Floats = np.stack([found.adop_deg_per_rad, found.pdop_m_per_rad], axis=-1)
        scaled: Floats = noise * factors[solution.solved]
        return scaled

    at_truth = predicted(true.rotation, true.position)
    at_measured = predicted(solution.rotation, solution.position)
    camera_measured, camera_predicted = _camera(bench, pose, start, rng)
    return Result(
        pose,
        _scatter(solution),
        at_truth[0],
        at_measured.mean(axis=0),
        at_measured.std(axis=0) / at_measured.mean(axis=0),
        camera_measured,
        camera_predicted,
    )


def _camera(bench: Bench, pose: Pose, start: Motion, rng: np.random.Generator) -> tuple[Floats, Floats]:
    """Return the measured and the predicted precision of a pinhole camera, from as many frames as `start` has rows."""
    frames = len(start.position)
    lit, points = np.repeat(pose.lit[None], frames, axis=0), np.repeat(bench.point_m[None], frames, axis=0)
    arm = np.einsum("cij,ckj->cki", np.repeat(pose.rotation[None], frames, axis=0), points) + pose.position
    projection = arm[..., :2] / arm[..., 2:] + IMAGE_NOISE * rng.standard_normal((*lit.shape, 2))
    one, none, still = np.ones_like(projection), np.zeros_like(projection), np.zeros((frames, 3))
    seen = refine_projections(projection, one, lit, points, start.rotation, start.position, none, still, still)
    rotation, position, every = pose.rotation[None], pose.position[None], np.ones(1, np.bool_)
    found = image_dilution(rotation, position, lit[:1], points[:1], one[:1], none[:1], still[:1], every)
    return _scatter(seen), np.array([found.adop_deg_per_rad[0], found.pdop_m_per_rad[0]]) * IMAGE_NOISE


def _scatter(solution: PoseSolution) -> Floats:
    """Return (23): the RMS of the solved poses about their mean, rotation [deg] and translation [m]."""
    rotation, position = solution.rotation[solution.solved], solution.position[solution.solved]
    angle = rot.angle_between(rotation, rot.mean_rotation(rotation))
    distance = np.linalg.norm(position - position.mean(axis=0), axis=-1)
    return np.array([np.rad2deg(np.sqrt(np.mean(angle**2))), np.sqrt(np.mean(distance**2))])


def _compare(results: list[Result]) -> list[Line]:
    measured = _table(results, "measured")
    lines = under(
        "Over the poses, least to most",
        Line("s_rot", "deg", "0.1 level", span(measured[:, 0]), (0.01, 1.0)),
        Line("s_trans", "mm", "1 level", span(1e3 * measured[:, 1]), (0.1, 10.0)),
    )
    for name, of_measured, of_predicted in (
        ("Predicted / measured", "measured", "at_truth"),
        ("... DOP at the measured poses", "measured", "at_measured"),
        ("... for a pinhole camera", "camera_measured", "camera_predicted"),
    ):
        true, said = _table(results, of_measured), _table(results, of_predicted)
        ratio = np.median(said / true, axis=0)
        correlation = [float(np.corrcoef(true[:, i], said[:, i])[0, 1]) for i in (0, 1)]
        lines += under(
            name,
            *(Line(f"median, {WHAT[i]}", "", "agree", float(ratio[i]), MEDIAN) for i in (0, 1)),
            *(Line(f"correlation, {WHAT[i]}", "", "agree", correlation[i], CORRELATION) for i in (0, 1)),
        )
    largest = 100 * _table(results, "scatter").max(axis=0)
    scatter = (Line(("ADOP", "PDOP")[i], "%", None, float(largest[i])) for i in (0, 1))
    return [*lines, *under("Scatter of that DOP, worst pose", *scatter)]


def _columns(results: list[Result]) -> Columns:
    poses = [result.pose for result in results]
    quaternion = rot.quaternion_from_matrix(np.array([pose.rotation for pose in poses]))
    columns: Columns = {
        "pose": (np.arange(1, len(poses) + 1), "number of the pose"),
        "p*_m": ([pose.position for pose in poses], "true position, *"),
        "q*": (quaternion, "true attitude quaternion, *"),
        "lit": ([int(np.count_nonzero(pose.lit)) for pose in poses], "photodiodes lit"),
    }
    for name, meaning in {
        "measured": "standard deviation over the frames (23)",
        "at_truth": "predicted, DOP at the true pose (24)",
        "at_measured": "predicted, mean of DOP at the measured poses (24)",
        "camera_measured": "pinhole camera: standard deviation over the frames (23)",
        "camera_predicted": "pinhole camera: predicted (24)",
    }.items():
        values = _table(results, name)
        columns[f"{name}_rotation_deg"] = values[:, 0], f"rotation: {meaning}"
        columns[f"{name}_translation_m"] = values[:, 1], f"translation: {meaning}"
    return columns


def _draw(results: list[Result]) -> figures.Figure:
    """Draw figure 5, measured and predicted, pose by pose; beside it the camera."""
    page, axes = figures.page(2, 2, 4.6)
    number = np.arange(1, len(results) + 1)
    for c, (title, measured, predicted) in enumerate(
        (("Lighthouse", "measured", "at_truth"), ("Pinhole camera, same poses", "camera_measured", "camera_predicted"))
    ):
        for r, (label, scale) in enumerate((("$s_{rot}$, deg", 1.0), ("$s_{trans}$, mm", 1e3))):
            place = axes[r, c]
            true, said = scale * _table(results, measured)[:, r], scale * _table(results, predicted)[:, r]
            place.plot(number, true, "o", ms=4, color=figures.BLUE, label="measured (23)")
            place.plot(number, said, "-", lw=1.0, color=figures.VERMILLION, label="predicted, DOP × s (24)")
            place.set_ylim(bottom=0)
            place.set_ylabel(label)
        axes[0, c].set_title(title)
        axes[1, c].set_xlabel("pose")
    axes[0, 0].set_ylim(top=1.25 * axes[0, 0].get_ylim()[1])
    figures.legend(axes[0, 0], columns=2, place="upper left")
    return page


def _table(results: list[Result], name: str) -> Floats:
    """Return one of the precisions of all results, (N, 2): rotation [deg], translation [m]."""
    return np.array([getattr(result, name) for result in results])
