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
import pyarrow as pa
from matplotlib.figure import Figure

from estimators import rotation as rot
from estimators.arrays import Bools, Floats
from estimators.lighthouse.dop import dilution, image_dilution
from estimators.lighthouse.pnp import PoseSolution, refine_projections
from swarm.errors import SwarmError
from swarm.studies.papers import figures
from swarm.studies.papers.bench import Bench, Motion
from swarm.studies.papers.results import Line, Outcome, Request, column, table_of
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
RANGE = "Over the poses, least to most"
MEDIAN, CORRELATION = (0.97, 1.03), (0.99, None)


class Pose(NamedTuple):
    """A pose of the craft: rotation (3, 3), position (3,) [m], lit (K,)."""

    rotation: Floats
    position: Floats
    lit: Bools


class Precision(NamedTuple):
    """Standard deviations of rotation [deg] and translation [m]."""

    rotation_deg: float
    translation_m: float


class Result(NamedTuple):
    """One pose: what was measured and predicted; scatter: of the prediction from measured poses, over itself."""

    measured: Precision
    at_truth: Precision
    at_measured: Precision
    scatter: Precision
    camera_measured: Precision
    camera_predicted: Precision


def run(request: Request) -> Outcome:
    """Measure every pose and compare."""
    poses_wanted, frames = request.sizes["poses"], request.sizes["frames"]
    if frames < FEWEST_FRAMES:
        raise SwarmError(f"--frames: {frames}: a standard deviation needs at least {FEWEST_FRAMES}")
    if poses_wanted < 3:
        raise SwarmError(f"--poses: {poses_wanted}: a correlation needs at least 3")
    bench = Bench()
    rng = np.random.default_rng(request.seed)
    poses: list[Pose] = []
    results: list[Result] = []
    ambiguous = 0
    while len(results) < poses_wanted:
        pose = draw_pose(bench, rng)
        result = measure(bench, pose, frames, rng)
        if result is None:
            ambiguous += 1
            continue
        poses.append(pose)
        results.append(result)
        request.progress(len(results) / poses_wanted, f"pose {len(results)} of {poses_wanted}")
    notes = [
        f"{poses_wanted} poses, {frames} frames each. The ticks' rounding comes on top of s, and is not predicted: "
        "1 % of the measured."
    ]
    if ambiguous:
        notes.append(f"{ambiguous} poses more stayed ambiguous (two poses fit the angles) and were drawn anew.")
    return Outcome(compare(results), data(poses, results), draw(results), tuple(notes))


def draw_pose(bench: Bench, rng: np.random.Generator) -> Pose:
    """A pose on the table, with enough photodiodes lit."""
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


def measure(bench: Bench, pose: Pose, frames: int, rng: np.random.Generator) -> Result | None:
    """Both sensors at one pose; None where the craft cannot tell which of two poses it has."""
    noise, correlation = bench.settings.angle_noise_rad, bench.settings.rotor_correlation
    true = Motion.rest(pose.rotation[None], pose.position[None]).repeat(frames)
    lit = np.repeat(pose.lit[None], frames, axis=0)
    angles = bench.angles(true, lit, bench.noise(frames, rng, noise, correlation), rng)
    first = bench.first_pose(angles, noise * float(np.sqrt(1 - correlation)))
    if first is None:
        return None
    start = Motion.rest(first[0][None], first[1][None]).repeat(frames)
    solution = bench.solve(angles, start)
    points = np.broadcast_to(bench.point_m, (frames, *bench.point_m.shape))

    still = np.zeros((frames, 3))
    predictions = [
        dilution(r, p, lit, points, angles.offset_s, still, still, correlation, solution.solved)
        for r, p in ((true.rotation, true.position), (solution.rotation, solution.position))
    ]
    at_truth, at_measured = (
        np.stack([d.adop_deg_per_rad, d.pdop_m_per_rad], axis=-1)[solution.solved] * noise for d in predictions
    )

    arm = np.einsum("cij,ckj->cki", true.rotation, points) + true.position[:, None]
    projection = arm[..., :2] / arm[..., 2:] + IMAGE_NOISE * rng.standard_normal((*lit.shape, 2))
    seen = refine_projections(
        projection,
        np.ones_like(projection),
        lit,
        points,
        start.rotation,
        start.position,
        np.zeros_like(projection),
        still,
        still,
    )
    rest, lit = np.zeros((1, 3)), pose.lit[None]
    images = np.ones((*lit.shape, 2)), np.zeros((*lit.shape, 2)), rest
    camera = image_dilution(pose.rotation[None], pose.position[None], lit, points[:1], *images, np.ones(1, np.bool_))
    adop, pdop = camera.adop_deg_per_rad, camera.pdop_m_per_rad
    return Result(
        scatter_of(solution),
        Precision(*at_truth[0]),
        Precision(*at_measured.mean(axis=0)),
        Precision(*(at_measured.std(axis=0) / at_measured.mean(axis=0))),
        scatter_of(seen),
        Precision(float(adop[0]) * IMAGE_NOISE, float(pdop[0]) * IMAGE_NOISE),
    )


def scatter_of(solution: PoseSolution) -> Precision:
    """(23): the RMS of the solved poses about their mean."""
    rotation, position = solution.rotation[solution.solved], solution.position[solution.solved]
    angle = rot.angle_between(rotation, rot.mean_rotation(rotation))
    distance = np.linalg.norm(position - position.mean(axis=0), axis=-1)
    return Precision(float(np.rad2deg(np.sqrt(np.mean(angle**2)))), float(np.sqrt(np.mean(distance**2))))


def compare(results: list[Result]) -> list[Line]:
    """Paper beside ours, per sensor and where the dilution is evaluated, rotation and translation."""
    measured = _table(results, "measured")
    lines = [
        Line("s_rot", "deg", "0.1 level", _range(measured[:, 0]), (0.01, 1.0), RANGE),
        Line("s_trans", "mm", "1 level", _range(1e3 * measured[:, 1]), (0.1, 10.0), RANGE),
    ]
    sets = (
        ("Predicted / measured", "measured", "at_truth", "agree"),
        ("... DOP at the measured poses", "measured", "at_measured", "agree"),
        ("... for a pinhole camera", "camera_measured", "camera_predicted", "agree"),
    )
    for name, of_measured, of_predicted, paper in sets:
        true, said = _table(results, of_measured), _table(results, of_predicted)
        ratio = np.median(said / true, axis=0)
        correlation = [float(np.corrcoef(true[:, i], said[:, i])[0, 1]) for i in (0, 1)]
        lines += [Line(f"median, {WHAT[i]}", "", paper, float(ratio[i]), MEDIAN, name) for i in (0, 1)]
        lines += [Line(f"correlation, {WHAT[i]}", "", paper, correlation[i], CORRELATION, name) for i in (0, 1)]
    largest = 100 * _table(results, "scatter").max(axis=0)
    name = "Scatter of that DOP, worst pose"
    lines += [Line(("ADOP", "PDOP")[i], "%", None, float(largest[i]), None, name) for i in (0, 1)]
    return lines


def data(poses: list[Pose], results: list[Result]) -> pa.Table:
    """A row per pose."""
    position = np.array([pose.position for pose in poses])
    quaternion = rot.quaternion_from_matrix(np.array([pose.rotation for pose in poses]))
    columns = [column("pose", np.arange(1, len(poses) + 1), "1", "number of the pose")]
    columns += [column(f"p{a}_m", position[:, i], "m", f"true position, {a}") for i, a in enumerate("xyz")]
    columns += [column(f"q{a}", quaternion[:, i], "1", f"true attitude quaternion, {a}") for i, a in enumerate("wxyz")]
    columns.append(column("lit", [int(np.count_nonzero(pose.lit)) for pose in poses], "1", "photodiodes lit"))
    meanings = {
        "measured": "standard deviation over the frames (23)",
        "at_truth": "predicted, DOP at the true pose (24)",
        "at_measured": "predicted, mean of DOP at the measured poses (24)",
        "camera_measured": "pinhole camera: standard deviation over the frames (23)",
        "camera_predicted": "pinhole camera: predicted (24)",
    }
    for name, meaning in meanings.items():
        values = _table(results, name)
        columns.append(column(f"{name}_rotation_deg", values[:, 0], "deg", f"rotation: {meaning}"))
        columns.append(column(f"{name}_translation_m", values[:, 1], "m", f"translation: {meaning}"))
    return table_of(columns)


def draw(results: list[Result]) -> Figure:
    """Figure 5: measured and predicted, pose by pose; beside it the camera."""
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
    """One of the precisions of all results, (N, 2): rotation [deg], translation [m]."""
    return np.array([getattr(result, name) for result in results])


def _range(values: Floats) -> tuple[float, float]:
    return float(values.min()), float(values.max())
