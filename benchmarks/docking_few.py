"""Dockings of a servicer that sees four photodiodes until the last half metre, and three from there on.

    python benchmarks/docking_few.py [--flights 100] [--first 1] [--coupling auto]

Flies the last 0.6 m of the scenario `docking` with as many seeds: noise, thruster errors and the servicer's start are
drawn anew in each, and so are the four photodiodes, of those that face the port's way and are lit to the end, and
which of them goes dark as the port comes within half a metre. Prints a line per flight, and JSON: how many made contact
within 10 mm and 1 degree and latched, the offsets at contact, and the error and NEES of the last half metre.
"""

import argparse
import json
import sys
from typing import Any

import numpy as np
from motion_models import errors

from estimators.arrays import Bools
from swarm.flight.flight import Flight
from swarm.onboard.guidance.phase import Phase
from swarm.onboard.settings import Status
from swarm.scenario import load
from swarm.sensors.sight import Sight

LATERAL_M, ANGLE_DEG = 0.01, 1.0
FOUR, THREE = 4, 3
DARK_M = 0.5
"""Distance of the ports at which the fourth photodiode goes dark."""
SHORT = [
    "duration_s=40",
    "craft[0].motion.from_m=[0.01,0.44,1.40]",
    "craft[0].motion.hold_ranges_m=[0.55]",
    "craft[0].motion.hold_s=[0.2]",
    "craft[0].scatter.position_m=0.02",
    "recording.enabled=false",
    "navigation.filter=compiled",
]
SERVICER = 0


class Fading(Flight):
    """A flight in which the servicer's light is that of some photodiodes only: `seen` (K,)."""

    seen: Bools | None = None

    def move(self, frame: int) -> Any:
        """Steer and move the craft, and hide photodiodes."""
        truth, sight = super().move(frame)
        if self.seen is not None:
            sight[SERVICER, ~self.seen] = Sight.OUTSIDE
        return truth, sight


def fly(seed: int, coupling: str, seen: Bools | None, dark: int) -> tuple[dict[str, Any], Bools]:
    """Fly once, until contact or the end; return figures, and the photodiodes lit in every period of the last metre.

    Args:
        seed: of the flight.
        coupling: `navigation.coupling`.
        seen: (K,), the photodiodes that the servicer sees until the ports are near; None: all.
        dark: the photodiode that goes dark then.
    """
    flight = Fading(load("docking", [*SHORT, f"navigation.coupling={coupling}"], seed))
    flight.seen = None if seen is None else seen.copy()
    # Those on the sides see the station at a slant, and not at every attitude of the start.
    always = flight.world.photodiodes.normal[SERVICER, :, 2] > 0.9
    out: dict[str, Any] = {"seed": seed, "docked": False}
    near: list[Any] = []
    phases: set[str] = set()
    for period in flight.fly():
        assert period.guided is not None
        closing = period.guided.docking[0][1]
        if flight.latches.closed[SERVICER]:
            out["docked"] = True
            break
        always &= np.isfinite(period.angles.theta[SERVICER]).all(axis=-1)
        phases.add(Phase(int(period.guided.phase[SERVICER])).name)
        if near or closing.range_m < DARK_M:
            if flight.seen is not None:
                flight.seen[dark] = False
            near.append([*errors(period, period.estimate)[SERVICER], period.estimate.visible[SERVICER]])
            out.setdefault("dark_m", float(closing.range_m))
        out.update(
            time_s=float(period.time_s),
            lateral_mm=1e3 * float(closing.lateral_m),
            angle_deg=float(np.degrees(closing.angle_rad)),
            speed_mm_s=1e3 * float(closing.speed_m_s),
            status=Status(int(period.estimate.status[SERVICER])).name,
        )
    every = np.array(near or [[np.nan] * 4])
    out.update(
        periods_near=len(near),
        three_lit=float(np.mean(every[1:, 3] == THREE)),
        position_rms_mm=1e3 * float(np.sqrt(np.nanmean(every[1:, 0] ** 2))),
        attitude_rms_deg=float(np.degrees(np.sqrt(np.nanmean(every[1:, 1] ** 2)))),
        nees=float(np.nanmean(every[1:, 2])),
        known=float(np.isfinite(every[:, 0]).mean()),
        lost="LOST" in phases,
    )
    return out, always


def main() -> None:
    """Fly, and print JSON."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--flights", type=int, default=100)
    parser.add_argument("--first", type=int, default=1, help="first seed")
    parser.add_argument("--coupling", default="auto")
    asked = parser.parse_args()
    whole, always = fly(0, asked.coupling, None, 0)
    print(json.dumps({"with all": whole, "lit to the end": np.flatnonzero(always).tolist()}), file=sys.stderr)
    runs = []
    for seed in range(asked.first, asked.first + asked.flights):
        four = np.random.default_rng(seed).choice(np.flatnonzero(always), FOUR, replace=False)
        seen = np.isin(np.arange(len(always)), four)
        runs.append(
            {**fly(seed, asked.coupling, seen, int(four[0]))[0], "dark": int(four[0]), "lit": four[1:].tolist()}
        )
        print(json.dumps(runs[-1]), file=sys.stderr, flush=True)
    good = [run["docked"] and run["lateral_mm"] <= 1e3 * LATERAL_M and run["angle_deg"] <= ANGLE_DEG for run in runs]
    names = [name for name, value in runs[0].items() if isinstance(value, float)]
    figures = {
        name: {"median": float(np.median(values)), "largest": float(np.max(values))}
        for name in names
        if (values := [run[name] for run in runs if name in run])
    }
    print(
        json.dumps(
            {
                "flights": len(runs),
                "docked": sum(run["docked"] for run in runs),
                "within": sum(good),
                "lost": sum(run["lost"] for run in runs),
                "missed": [run for run, fine in zip(runs, good, strict=True) if not fine],
                **figures,
            },
            indent=2,
        )
    )


if __name__ == "__main__":
    main()
