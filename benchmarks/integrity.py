"""Reflections in a share of the sweeps: what they cost, and whether accepted poses keep to their protection levels.

    python benchmarks/integrity.py [--scenario formation] [--seeds 7] [--share 0.05] [--spread-deg 5] [--poses 100000]

Every seed is flown twice, clean and with the ghosts (kind `ghosts` of `[[fault]]`), until so many poses with ghosts
have been accepted. Prints JSON: position error RMS of both, over craft and periods with an estimate, their ratio,
the poses and estimates beyond their protection levels, and the worst error as a share of its level.
"""

import argparse
import json
import platform
from importlib.metadata import version
from typing import Any

import numpy as np

from estimators.rotation import angle_between, matrix_from_quaternion
from swarm.flight.flight import Flight
from swarm.onboard.settings import Status
from swarm.scenario import load


class Tally:
    """Errors and levels of one kind of flight."""

    def __init__(self) -> None:
        self.square = np.zeros(2)
        self.known = self.tracking = self.samples = self.dropped = self.failed = 0
        self.beyond = {"accepted_poses": [0, 0, 0.0], "estimates": [0, 0, 0.0]}
        self.level: list[float] = []

    def add(self, flight: Flight, seconds: float) -> None:
        """Fly it."""
        for frame in range(round(seconds / flight.period_s)):
            period = flight.period(frame)
            truth, estimate = period.truth, period.estimate
            assert truth is not None
            turn, own = matrix_from_quaternion(truth.quaternion), estimate.integrity
            tracking = estimate.status == Status.TRACKING
            every = np.ones_like(tracking)
            for name, pose, among, levels in (
                ("accepted_poses", estimate.pnp, tracking, (own.pnp_position_m, own.pnp_attitude_deg)),
                ("estimates", estimate, every, (own.position_m, own.attitude_deg)),
            ):
                error = np.linalg.norm(pose.position - truth.position, axis=1)
                angle = np.full(len(error), np.nan)
                known = np.isfinite(error)
                angle[known] = np.rad2deg(angle_between(pose.rotation[known], turn[known]))
                share = np.fmax(error / levels[0], angle / levels[1])[among & known]
                tally = self.beyond[name]
                tally[0] += len(share)
                tally[1] += int(np.count_nonzero(~(share <= 1)))
                tally[2] = max(tally[2], float(share.max(initial=0.0)))
            self.square += np.nansum(error**2), np.nansum(angle**2)
            self.known += int(np.count_nonzero(known))
            self.tracking += int(np.count_nonzero(tracking))
            self.samples += len(tracking)
            self.dropped += int(np.maximum(own.dropped, 0).sum())
            self.failed += int(np.count_nonzero(own.dropped < 0))
            if frame % 60 == 0:
                self.level.append(float(np.nanmedian(own.position_m)))

    def figures(self) -> dict[str, Any]:
        """JSON-able."""
        rms = np.sqrt(self.square / max(1, self.known))
        return {
            "craft_periods": self.samples,
            "tracking_share": self.tracking / self.samples,
            "position_rms_mm": 1e3 * rms[0],
            "attitude_rms_deg": rms[1],
            "position_protection_median_mm": 1e3 * float(np.median(self.level)),
            "photodiodes_dropped_per_period": self.dropped / self.samples,
            "failed_residual_test_share": self.failed / self.samples,
            **{
                name: {"samples": n, "beyond_protection_level": beyond, "worst_share_of_level": worst}
                for name, (n, beyond, worst) in self.beyond.items()
            },
        }


def main() -> None:
    """Fly, and print JSON."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenario", default="formation")
    parser.add_argument("--seeds", type=int, default=7)
    parser.add_argument("--share", type=float, default=0.05)
    parser.add_argument("--spread-deg", type=float, default=5.0)
    parser.add_argument("--poses", type=int, default=100_000)
    options = parser.parse_args()
    ghosts = f'fault=[{{kind="ghosts", at_s=0, share={options.share}, spread_deg={options.spread_deg}}}]'
    clean, struck = Tally(), Tally()
    for seed in range(1, options.seeds + 1):
        for tally, more in ((clean, []), (struck, [ghosts])):
            scenario = load(options.scenario, more, seed)
            tally.add(Flight(scenario), scenario.duration_s)
        if struck.beyond["accepted_poses"][0] >= options.poses:
            break
    print(
        json.dumps(
            {
                "scenario": options.scenario,
                "share": options.share,
                "spread_deg": options.spread_deg,
                "clean": clean.figures(),
                "with_ghosts": struck.figures(),
                "position_rms_ratio": float(
                    np.sqrt(struck.square[0] / struck.known) / np.sqrt(clean.square[0] / clean.known)
                ),
                "machine": platform.processor() or platform.machine(),
                "versions": {name: version(name) for name in ("mujoco", "numpy", "numba", "filterpy")},
            },
            indent=2,
        )
    )


if __name__ == "__main__":
    main()
