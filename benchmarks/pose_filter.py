"""The filter: one prediction and one update of every craft, compiled and by filterpy, fed with the same poses; and
compiled with four models of motion side by side, as the craft of `swarm1000` have it.

    python benchmarks/pose_filter.py [--craft 1000] [--repeats 7] [--out filter.json]

The poses and covariances are those of a period of `swarm1000`, given again and again, as of craft that hover. Found
the truth: the greatest difference of the two filters' states and covariances after all rounds, relative to the largest
entry of each; and that the estimate comes nearer to the truth than the single pose.
"""

from functools import partial

import numpy as np
from harness import finish, interleaved, options, show
from period import captured

from estimators.filter.bank import FilterBank
from estimators.filter.compiled import CompiledFilterBank
from estimators.filter.compiled_interacting import CompiledInteractingBank
from estimators.filter.filterpy_bank import PoseFilterBank

STATE = ("rotation", "angular_rate", "position", "velocity", "covariance")


def main() -> None:
    """Measure, show, write."""
    chosen = options(__doc__, craft=(1000, "craft"), repeats=(7, "repetitions"))
    c = captured(chosen.craft)
    solution, precision = c.estimate.pnp, c.estimate.dilution
    mask, noise = solution.solved, c.flight.sensors.lighthouse.settings.angle_noise_rad
    covariance = noise**2 * precision.covariance
    flown = c.flight.computer.navigator.tracks.bank
    assert isinstance(flown, CompiledInteractingBank)
    grid, models = flown.grid, flown.mixtures.models
    noises = list(zip(grid.acceleration, grid.angular_acceleration, strict=True))
    banks: dict[str, FilterBank] = {
        "compiled": CompiledFilterBank(chosen.craft),
        "filterpy": PoseFilterBank(chosen.craft),
        "compiled, four models": CompiledInteractingBank(noises, 1 / grid.livelier, 1 / grid.quieter, models),
    }
    for bank in banks.values():
        bank.start(mask, solution.rotation, solution.position, covariance, (1.0, 0.5))
    root = np.linalg.cholesky(np.where(mask[:, None, None], covariance, np.eye(6)))
    # Every round another pose, the same for both: the truth and its own noise.
    shift = {name: np.random.default_rng(1) for name in banks}

    def step(name: str) -> None:
        bank = banks[name]
        moved = (root @ shift[name].standard_normal((chosen.craft, 6, 1)))[:, 3:, 0]
        bank.predict(1 / 60, mask)
        bank.update_pose(mask, solution.rotation, c.truth.position + moved, covariance, precision.rate_coupling)

    times = interleaved({name: partial(step, name) for name in banks}, chosen.repeats)
    one, other, _ = banks.values()
    difference = {
        name: float(
            np.max(np.abs(getattr(one, name) - getattr(other, name))[mask]) / np.max(np.abs(getattr(other, name)[mask]))
        )
        for name in STATE
    }
    errors = {
        "one pose": np.linalg.norm(solution.position - c.truth.position, axis=1)[mask],
        "filtered": np.linalg.norm(one.position - c.truth.position, axis=1)[mask],
    }
    median = {name: float(np.median(error)) for name, error in errors.items()}
    per = {name: t.figures(int(mask.sum())) for name, t in times.items()}
    show(
        f"{int(mask.sum())} craft; predict and update, per craft and period [us]",
        ["", "CPU median", "CPU minimum", "wall median"],
        [[n, *(1e6 * f[k] for k in ("cpu_median_s", "cpu_minimum_s", "wall_median_s"))] for n, f in per.items()],
    )
    print("\nrelative difference: " + ", ".join(f"{name} {value:.1e}" for name, value in difference.items()))
    print("median position error [mm]: " + ", ".join(f"{name} {1e3 * value:.2f}" for name, value in median.items()))
    result = {"per_craft": per, "relative_difference": difference, "median_position_error_m": median}
    finish("pose_filter", {"craft": int(mask.sum()), **result}, chosen.out)


if __name__ == "__main__":
    main()
