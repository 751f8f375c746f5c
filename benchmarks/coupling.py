"""What does tight coupling cost on board? Processor time of the navigation of C craft, loose and tight in turns.

    python benchmarks/coupling.py [--craft 1000] [--photodiodes 9] [--periods 40] [--models 6]

Craft with the mockup's layout stand still and see the same photodiodes; both navigators get the same light, period by
period in turns, so that a load that comes and goes meets both. The ratio is of the medians.
"""

from dataclasses import replace

import numpy as np
from harness import Times, finish, options, show, timed
from single_sweeps import HOLD, PLACE, Truth, mockup, sweep

from swarm.flight import builders
from swarm.hardware import pad
from swarm.onboard.decoder import SweepAngles
from swarm.onboard.navigation import Navigator
from swarm.scenario import load

WARM_UP = 10
"""Periods that do not count: the search for the first pose, and compiling."""


def main() -> None:
    """Step, and print."""
    chosen = options(
        __doc__,
        craft=(1000, "craft"),
        photodiodes=(9, "photodiodes that are lit, of 12"),
        periods=(40, "periods that count"),
        models=(6, "models of motion; 1: one"),
    )
    craft, points = chosen.craft, mockup()
    settings = builders.navigation(load("drift", ['navigation.filter="compiled"']))
    assert settings.quiet is not None
    quiet = replace(settings.quiet, models=chosen.models) if chosen.models > 1 else None
    layout = pad([points] * craft, [np.tile([0.0, 0.0, 1.0], (len(points), 1))] * craft)
    navigators = {
        coupling: Navigator(layout, replace(settings, coupling=coupling, quiet=quiet))
        for coupling in ("loose", "tight")
    }
    zero = np.zeros((craft, 3))
    truth = Truth(np.broadcast_to(HOLD, (craft, 3, 3)), zero, np.broadcast_to(PLACE, (craft, 3)), zero)
    angle, instant = sweep(truth, np.broadcast_to(points, (craft, *points.shape)), settings.frame_s)
    seen = np.zeros((craft, len(points)), dtype=np.bool_)
    seen[:, : chosen.photodiodes] = True
    none, rng, rho = np.zeros(craft, dtype=np.int64), np.random.default_rng(0), settings.rotor_correlation
    times = {coupling: Times([], []) for coupling in navigators}
    for period in range(WARM_UP + chosen.periods):
        rotor, own = rng.standard_normal((craft, 1, 2)), rng.standard_normal(angle.shape)
        noisy = angle + settings.angle_noise_rad * (np.sqrt(rho) * rotor + np.sqrt(1 - rho) * own)
        theta = np.where(seen[..., None], np.pi / 2 + noisy, np.nan)
        light = SweepAngles(theta, np.where(seen[..., None], instant, 0.0), seen, none, none, none)
        for coupling, navigator in navigators.items():
            with timed(times[coupling] if period >= WARM_UP else Times([], [])):
                navigator.step(light)
    us = {name: [1e6 * value for value in of.figures(craft).values()] for name, of in times.items()}
    show(
        "us per craft and period",
        ["", "cpu median", "cpu min", "wall median", "wall min"],
        [[name, *values] for name, values in us.items()],
    )
    ratio = us["tight"][0] / us["loose"][0]
    print(f"tight over loose: {ratio:.2f}")
    finish("coupling", {"us": us, "ratio": ratio}, chosen.out)


if __name__ == "__main__":
    main()
