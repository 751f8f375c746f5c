"""Calibration: a lighthouse's fans and where photodiodes really sit, from the sweep angles of a survey.

A robust bundle adjustment: `scipy.optimize.least_squares` with Huber's loss on the residuals of
`estimators.calibration.problem`, its sparse analytic Jacobian, in the coordinates of `estimators.calibration.arrow`.
With known poses (motion capture) only the shared parameters are sought; without, every pose is an unknown, too.

1. Observability, before anything is solved: S, scaled by the sizes that each parameter has in real hardware, has an
   eigenvalue below 1 along a direction that the survey tells less of than those sizes do. Then nothing is estimated.
2. Huber's limit starts where the residuals are (a phase error is thousands of standard deviations) and follows them
   down to `HUBER` standard deviations.
3. Angles beyond `REJECT` robust standard deviations are dropped, and the rest is solved again. An unknown pose that
   loses many of its angles, or fits the others badly, has adapted to wrong ones: all of its angles go.
4. Standard deviations from S^-1 there, with the noise as it is: times the RMS of the residuals if that is above one.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares

from estimators.arrays import Bools, Floats
from estimators.calibration.arrow import Arrow, Whitening, arrow
from estimators.calibration.model import FAN_PARAMETERS
from estimators.calibration.problem import Noise, Problem, Survey

HUBER = 2.0
"""Residual at which Huber's loss turns from square to straight [standard deviations]: 99 % efficient if normal."""
REJECT = 5.0
"""An angle further off than this [standard deviations] is not one: of a million good ones half a one is."""
FEWEST_ANGLES = 8
"""Angles of a pose that is to be solved, too: those of 4 photodiodes (source 1, section 2)."""
FEWEST_SHARE = 0.75
"""A pose that fits fewer of its angles is not one: with a few wrong ones it may have adapted to them."""
FEWEST_PER_PHOTODIODE = 20
"""A photodiode seen in fewer angles stays where it is believed to be."""
TYPICAL = np.array([0.05, 0.01, 0.002, 0.01, 0.01])
"""Sizes of a real fan's five numbers (Lighthouse 1.0): who knows them no better had better leave them."""
TYPICAL_MOUNTING_M = 1e-3
"""Size of a mounting error per axis [m]."""
_REJECTIONS = 3
"""Rounds of dropping angles and solving again."""
_ROUNDS = 30
_SETTLED = 0.01
"""Largest change of a shared unknown [standard deviations] that ends the rounds."""


class Unobservable(ValueError):
    """A survey that is too poor. parameters: those it leaves open. missing: the number of open directions."""

    def __init__(self, parameters: Sequence[str], missing: int, total: int) -> None:
        self.parameters, self.missing, self.total = tuple(parameters), missing, total
        super().__init__(
            f"{missing} of {total} directions of the parameters are not observable in this survey; "
            f"they involve {', '.join(parameters)}"
        )


class Calibration(NamedTuple):
    """The result of a survey.

    fans: (2, 5), numbers of `calibration.model`. point_m: (P, 3) [m]. covariance: (10 + 3 P, 10 + 3 P) of both, in the
    gauge; zero where held. rotation (N, 3, 3), position (N, 3) [m]: the poses, as known or as found. residual: RMS of
    the residuals over its expected value: 1 where the noise is as stated. condition: largest over smallest standard
    deviation of the shared parameters, in units of their typical sizes. placed: (P,), photodiodes that were estimated.
    used: (M,), angles that were used. evaluations: number of evaluations of the residuals.
    """

    fans: Floats
    point_m: Floats
    covariance: Floats
    rotation: Floats
    position: Floats
    residual: float
    condition: float
    placed: Bools
    used: Bools
    evaluations: int

    @property
    def fan_sigma(self) -> Floats:
        """The standard deviations (2, 5) of `fans`."""
        out: Floats = np.sqrt(np.diagonal(self.covariance)[:10]).reshape(2, 5)
        return out

    @property
    def point_sigma_m(self) -> Floats:
        """The standard deviations (P, 3) of `point_m` [m]."""
        out: Floats = np.sqrt(np.diagonal(self.covariance)[10:]).reshape(-1, 3)
        return out


def calibrate(survey: Survey, noise: Noise, *, poses_known: bool, hold: Sequence[str] = ()) -> Calibration:
    """Estimate fans and photodiodes from a survey, as the module describes.

    Args:
        survey: the angles and poses.
        noise: of one angle.
        poses_known: True where the survey's poses are the truth, False where they are only a start.
        hold: names of `calibration.problem.PARTS` that stay as the survey believes them.

    Raises:
        Unobservable: the survey is too poor.
        ValueError: the survey's arrays do not fit together, or everything is held.
    """
    seen = np.bincount(survey.photodiode, minlength=len(survey.point_m)) >= FEWEST_PER_PHOTODIODE
    problem = Problem(survey, noise, poses_known=poses_known, hold=hold, seen=seen)
    if not poses_known:
        angles = np.bincount(survey.pose, minlength=len(survey.rotation))
        problem.used = (angles >= FEWEST_ANGLES)[survey.pose]
    if problem.basis.shape[1] == 0:
        raise ValueError("hold: nothing is left to be estimated")
    try:
        x = problem.start()
        _observe(problem, x)
        x, evaluations = _solve(problem, x)
        for _ in range(_REJECTIONS):
            kept = _good(problem, x)
            if np.array_equal(kept, problem.used):
                break
            problem.used = kept
            _observe(problem, x)
            x, more = _solve(problem, x)
            evaluations += more
        return _conclude(problem, x, seen, evaluations)
    except np.linalg.LinAlgError:
        # A block without an inverse: poses whose photodiodes lie on one line, or angles that contradict each other.
        raise Unobservable(["a mixture of all"], 1, problem.basis.shape[1]) from None


def _spread(residual: Floats) -> float:
    """Return a robust standard deviation of residuals."""
    return float(1.4826 * np.median(np.abs(residual)))


def _good(problem: Problem, x: Floats) -> Bools:
    """Return the angles that fit; a pose that had to adapt to wrong ones loses all of its angles (see the module)."""
    survey, before = problem.survey, problem.used
    problem.used = np.ones_like(before)
    error = problem.residuals(x)[: len(before)]
    problem.used = before
    scale = max(1.0, _spread(error[before]))
    kept = np.abs(error) <= REJECT * scale
    if problem.poses_known:
        return kept
    poses = len(survey.rotation)
    every, left = np.bincount(survey.pose, minlength=poses), np.bincount(survey.pose[kept], minlength=poses)
    square = np.bincount(survey.pose, np.where(kept, error / scale, 0.0) ** 2, minlength=poses)
    sound = (left >= FEWEST_ANGLES) & (left >= FEWEST_SHARE * every) & (square < left - 6 + REJECT * np.sqrt(2 * left))
    out: Bools = kept & sound[survey.pose]
    return out


def _huber(angles: int, limit: float) -> Callable[[Floats], Floats]:
    """Return the loss for `least_squares`: Huber's with `limit` for the first `angles` residuals, none for the rest."""

    def loss(square: Floats) -> Floats:
        out = np.stack([square, np.ones_like(square), np.zeros_like(square)])
        far = np.flatnonzero(square[:angles] > limit**2)
        size = np.sqrt(square[far])
        out[:2, far] = 2 * limit * size - limit**2, limit / size
        return out

    return loss


def _solve(problem: Problem, x: Floats) -> tuple[Floats, int]:
    """Return x at the minimum of Huber's loss, and the number of evaluations of the residuals."""
    angles, evaluations = len(problem.survey.theta), 0
    for _ in range(_ROUNDS):
        residual = problem.residuals(x)
        limit = HUBER * max(1.0, _spread(residual[:angles][problem.used]))
        weight = np.ones(len(residual))
        weight[:angles] = np.sqrt(np.minimum(1.0, limit / np.maximum(np.abs(residual[:angles]), 1e-300)))
        jacobian = problem.jacobian(x)
        whitening = Whitening(problem, arrow(problem, jacobian, weight))
        reach = np.linalg.norm(whitening.backward(jacobian.T @ (weight**2 * residual)))
        origin, count = x, whitening.shape[1]
        step = least_squares(
            lambda y, origin=origin, to=whitening: problem.residuals(origin + to.forward(y)),
            np.zeros(count),
            jac=lambda y, origin=origin, to=whitening: to.of(problem.jacobian(origin + to.forward(y))),
            # The first trust region is one `x_scale` wide: wide enough for a whole step.
            x_scale=max(float(reach), 1e-3),
            loss=_huber(angles, limit),
            tr_solver="lsmr",
            tr_options={"atol": 1e-9, "btol": 1e-9, "maxiter": 30},
            max_nfev=8,
        )
        x = origin + whitening.forward(step.x)
        evaluations += step.nfev
        if np.abs(step.x[problem.local :]).max() < _SETTLED:
            break
    return x, evaluations


def _observe(problem: Problem, x: Floats) -> tuple[Arrow, float]:
    """Return the unweighted arrow at x and the condition number. Raises Unobservable."""
    normal = arrow(problem, problem.jacobian(x), np.ones(len(problem.used) + 2 * problem.blocks))
    typical = np.concatenate([TYPICAL, TYPICAL, np.full(problem.survey.point_m.size, TYPICAL_MOUNTING_M)])
    # Every column of the basis is in units of one kind: fans one by one, photodiodes all alike.
    scale = np.sqrt(np.sum((typical[:, None] * problem.basis) ** 2, axis=0))
    value, vector = np.linalg.eigh(scale[:, None] * normal.schur * scale)
    bad = value < 1.0
    if bad.any():
        share = np.sum((problem.basis @ vector[:, bad]) ** 2, axis=1)
        raise Unobservable(_names(problem, share), int(bad.sum()), len(value))
    return normal, float(np.sqrt(value[-1] / value[0]))


def _names(problem: Problem, share: Floats) -> list[str]:
    """Return the parameters with a noticeable share in unobservable directions, the photodiodes by their number."""
    names = []
    for fan in (0, 1):
        for i, name in enumerate(FAN_PARAMETERS):
            if share[5 * fan + i] > 0.1:
                names.append(f"fan_{'xy'[fan]}.{name}")
    lost = int(np.count_nonzero(share[10:].reshape(-1, 3).sum(axis=1) > 0.1))
    if lost:
        names.append(f"the places of {lost} photodiodes")
    return names or ["a mixture of all"]


def _conclude(problem: Problem, x: Floats, seen: Bools, evaluations: int) -> Calibration:
    normal, condition = _observe(problem, x)
    residual = problem.residuals(x)
    poses = 0 if problem.poses_known else 6 * len(np.unique(problem.survey.pose[problem.used]))
    freedom = int(problem.used.sum()) - poses - problem.basis.shape[1]
    rms = float(np.sqrt(np.sum(residual**2) / max(freedom, 1)))
    covariance = problem.basis @ np.linalg.inv(normal.schur) @ problem.basis.T * max(rms, 1.0) ** 2
    fans, point_m = problem.shared(x)
    rotation, position = problem.poses(x)
    placed = seen & (np.diagonal(covariance)[10:].reshape(-1, 3).sum(axis=1) > 0)
    return Calibration(
        fans.copy(), point_m.copy(), covariance, rotation, position, rms, condition, placed, problem.used, evaluations
    )
