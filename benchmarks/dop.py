"""Dilution of precision and rate coupling of one period, beside the same equations in batched NumPy.

    python benchmarks/dop.py [--craft 1000] [--repeats 25] [--out dop.json]

Found the truth: the share of craft with a dilution; the greatest relative difference from NumPy's H; and the mean of
e^T (s^2 H)^-1 e of the PnP poses' real errors, 6 if H is right, over all craft of the period. They share
the rotor's error, so that their mean scatters by more than that of independent craft.
"""

import numpy as np
from harness import finish, interleaved, options, show
from period import captured

from estimators.lighthouse.dop import dilution
from estimators.rotation import exp, log, matrix_from_quaternion, skew


def numpys(
    rotation: np.ndarray,
    position: np.ndarray,
    lit: np.ndarray,
    point: np.ndarray,
    offset: np.ndarray,
    rate: np.ndarray,
    velocity: np.ndarray,
    rho: float,
    mask: np.ndarray,
) -> np.ndarray:
    """H (C, 6, 6) of (18), by stacked arrays."""
    turn = exp(rate[:, None, None] * offset[..., None])
    arm = np.einsum("cij,ckj->cki", rotation, point)
    p = np.einsum("ckfij,ckj->ckfi", turn, arm) + position[:, None, None] + velocity[:, None, None] * offset[..., None]
    gradient = np.zeros_like(p)
    for fan in range(2):
        across, ahead = p[:, :, fan, fan], p[:, :, fan, 2]
        square = across**2 + ahead**2
        gradient[:, :, fan, fan], gradient[:, :, fan, 2] = ahead / square, -across / square
    by_turn = -np.einsum("ckfi,ckfij,ckjl->ckfl", gradient, turn, skew(arm))
    j = np.where(lit[:, :, None, None], np.concatenate([by_turn, gradient], axis=-1), 0.0)[mask]
    inverse = np.linalg.inv(np.einsum("ckfa,ckfb->cab", j, j))
    spread = np.einsum("cab,cfb->cfa", inverse, j.sum(axis=1))
    out = np.full((len(lit), 6, 6), np.nan)
    out[mask] = (1 - rho) * inverse + rho * np.einsum("cfa,cfb->cab", spread, spread)
    return out


def main() -> None:
    """Measure, show, write."""
    chosen = options(__doc__, craft=(1000, "craft"), repeats=(25, "repetitions"))
    c = captured(chosen.craft)
    arguments = c.dilution
    times = interleaved({"ours": lambda: dilution(*arguments), "NumPy": lambda: numpys(*arguments)}, chosen.repeats)
    mine, theirs, mask = dilution(*arguments), numpys(*arguments), arguments[-1]
    h = mine.covariance[mask]
    turn = log(matrix_from_quaternion(c.truth.quaternion[mask]) @ np.swapaxes(c.estimate.pnp.rotation[mask], 1, 2))
    error = np.hstack([turn, c.truth.position[mask] - c.estimate.pnp.position[mask]])
    noise = c.flight.sensors.lighthouse.settings.angle_noise_rad
    squared = np.einsum("ca,cab,cb->c", error, np.linalg.inv(noise**2 * h), error)
    size = np.abs(h).max(axis=(1, 2))
    truth = {
        "computed": float(mask.mean()),
        "greatest_relative_difference_from_numpy": float(np.max(np.abs(h - theirs[mask]).max(axis=(1, 2)) / size)),
        "mean_squared_normalised_error": float(squared.mean()),
    }
    per = {name: t.figures(int(mask.sum())) for name, t in times.items()}
    show(
        f"{int(mask.sum())} craft; per craft [us]",
        ["", "CPU median", "CPU minimum", "wall median"],
        [[n, *(1e6 * f[k] for k in ("cpu_median_s", "cpu_minimum_s", "wall_median_s"))] for n, f in per.items()],
    )
    print("\n" + ", ".join(f"{name} {value}" for name, value in truth.items()))
    finish("dop", {"craft": len(mask), "per_craft": per, "truth": truth}, chosen.out)


if __name__ == "__main__":
    main()
