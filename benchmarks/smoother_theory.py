"""What NEES do a filter and a smoother have whose process noise never comes? Along one line, by theory, times six.

    python benchmarks/smoother_theory.py [--sigma-m 0.0007] [--noise-m-s2 0.038] [--push-m-s2 0.013] [--turn-deg-s 6]
                                         [--core CORE] [--out FILE]

Position and velocity with white accelerations, a position measured 60 times a second. The errors are those of the
measurements' noise and of a craft that stands still, or that is carried round a circle, pushed by a constant
acceleration which turns; noise and push of any flight add up, since all is linear. A long stretch is left out at both
ends.
"""

import numpy as np
from harness import finish, options, show

from estimators.arrays import Floats

FRAME_S = 1 / 60
PERIODS, ENDS = 12000, 3000


def responses(measured: Floats, sigma: float, noise: float) -> tuple[Floats, Floats, float, float]:
    """Return the positions (N, T) of filter and smoother to measured ones (N, T), and both variances.

    Args:
        measured: positions [m] of N flights.
        sigma: of a measurement [m].
        noise: of the accelerations [m/s^2].
    """
    step, gamma = np.array([[1.0, FRAME_S], [0.0, 1.0]]), np.array([FRAME_S**2 / 2, FRAME_S])
    p, x, kept = np.diag([1.0, 1.0]), np.zeros((len(measured), 2)), []
    for z in measured.T:
        before, ahead = step @ p @ step.T + noise**2 * np.outer(gamma, gamma), x @ step.T
        gain = before[:, 0] / (before[0, 0] + sigma**2)
        p, x = before - np.outer(gain, before[0]), ahead + np.outer(z - ahead[:, 0], gain)
        kept.append((p, x, before, ahead))
    smooth, spread, out = x, p, [x[:, 0]]
    variances = [p[0, 0]]
    for (p, x, _, _), (_, _, before, ahead) in zip(kept[-2::-1], kept[:0:-1], strict=True):
        back = p @ step.T @ np.linalg.inv(before)
        smooth, spread = x + (smooth - ahead) @ back.T, p + back @ (spread - before) @ back.T
        out.append(smooth[:, 0])
        variances.append(spread[0, 0])
    middle = PERIODS // 2
    filtered = np.stack([x[:, 0] for _, x, _, _ in kept], axis=1)
    return filtered, np.stack(out[::-1], axis=1), float(kept[middle][0][0, 0]), float(variances[::-1][middle])


def main() -> None:
    """Compute, and print."""
    chosen = options(
        __doc__,
        sigma_m=(0.0007, "sigma of a measured position [m]"),
        noise_m_s2=(0.038, "process noise [m/s^2]"),
        push_m_s2=(0.013, "acceleration round the circle [m/s^2]"),
        turn_deg_s=(6.0, "angular rate round the circle [deg/s]"),
    )
    rng, rate = np.random.default_rng(0), np.radians(chosen.turn_deg_s)
    circle = -chosen.push_m_s2 / rate**2 * np.cos(rate * FRAME_S * np.arange(PERIODS))
    measured = np.vstack([circle, chosen.sigma_m * rng.standard_normal((40, PERIODS))])
    filtered, smoothed, p_filter, p_smooth = responses(measured, chosen.sigma_m, chosen.noise_m_s2)
    result = {}
    for name, found, variance in (("filter", filtered, p_filter), ("smoother", smoothed, p_smooth)):
        inner = slice(ENDS, PERIODS - ENDS)
        noise = 6 * float(np.mean(found[1:, inner] ** 2)) / variance
        push = 6 * float(np.mean((found[0] - circle)[inner] ** 2)) / variance
        result[name] = {"still": noise, "carried": noise + push}
    show("NEES of six", ["", "still", "carried round"], [[name, *values.values()] for name, values in result.items()])
    finish("smoother_theory", {"nees": result}, chosen.out)


if __name__ == "__main__":
    main()
