"""Crossing times and decoding: the lighthouse's pulses of one period, and the angles that every craft reads from them.

    python benchmarks/crossing.py [--craft 1000] [--repeats 15] [--out crossing.json]

Baseline: SciPy's `brentq` on the same equation, the motion interpolated by SciPy's `Slerp`, for some photodiodes.
Found the truth: the greatest difference of an instant from brentq's [s] (both solve to 1e-13 s; the issue asks for
1 ns), the share of lit photodiodes whose angles were decoded, and the RMS of the decoded angle about the true one in
units of the angle noise.
"""

import numpy as np
from harness import finish, interleaved, options, show
from period import captured
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation, Slerp

from estimators.rotation import xyzw_from_wxyz
from swarm.onboard.decoder import PulseDecoder
from swarm.sensors.crossing import cross_into, knots_of, row_by_row, side_by_side


def main() -> None:
    """Measure, show, write."""
    chosen = options(__doc__, craft=(1000, "craft"), repeats=(15, "repetitions"), sample=(300, "crossings by SciPy"))
    c = captured(chosen.craft)
    lighthouse, motion = c.flight.sensors.lighthouse, c.motion
    true, settings = lighthouse.photodiodes, lighthouse.settings
    period, knot = 1 / settings.rate_hz, motion.time_s - motion.time_s[0]
    error = side_by_side(np.where(c.lit, 0.0, np.nan))
    instants, widths = np.empty_like(error), np.empty_like(error)
    faces = side_by_side(true.point_m), side_by_side(true.normal)
    arguments = (knots_of(knot, motion.position, motion.quaternion), *faces, error, lighthouse._fans)

    def cross() -> None:
        cross_into(*arguments, period, settings.photodiode_diameter_m, instants, widths)

    craft, photodiode, fan = np.nonzero(c.lit)
    chosen_ones = np.random.default_rng(0).choice(len(craft), min(chosen.sample, len(craft)), replace=False)
    solved = np.empty(len(chosen_ones))

    def scipys() -> None:
        for n, i in enumerate(chosen_ones):
            who, k, f = craft[i], photodiode[i], fan[i]
            turn = Slerp(knot, Rotation.from_quat(xyzw_from_wxyz(motion.quaternion[:, who])))
            place, point = motion.position[:, who], true.point_m[who, k]

            def left(t: float) -> float:
                p = turn(t).apply(point) + np.array([np.interp(t, knot, place[:, a]) for a in range(3)])  # noqa: B023
                return float(np.arctan2(p[2], p[f]) - 2 * np.pi / period * (t - f * period / 2))  # noqa: B023

            solved[n] = brentq(left, f * period / 2, min((f + 1) * period / 2, knot[-1]), xtol=1e-15, rtol=1e-14)

    decoder = c.flight.computer.decoder
    if not isinstance(decoder, PulseDecoder):
        raise TypeError("the period is that of one lighthouse")
    times = interleaved(
        {
            "crossing times": cross,
            "crossing times and pulses": lambda: lighthouse.sweep(motion, c.frame, c.lit),
            "decode": lambda: decoder.decode(c.pulses),
        },
        chosen.repeats,
    )
    scipy_times = interleaved({"SciPy brentq": scipys}, 2)["SciPy brentq"]
    instant = row_by_row(instants, chosen.craft)
    worst = float(np.abs(instant[craft, photodiode, fan][chosen_ones] - solved).max())
    both = c.lit.all(axis=2)
    theta = 2 * np.pi * settings.rate_hz * (instant - np.array([0, period / 2]))
    off = (c.angles.theta - theta)[both & c.angles.lit] / settings.angle_noise_rad
    truth = {
        "greatest_difference_from_brentq_s": worst,
        "lit_and_decoded": float(c.angles.lit[both].mean()),
        "decoded_rms_over_noise": float(np.sqrt(np.mean(off**2))),
    }
    crossings = int(np.count_nonzero(c.lit))
    per = {name: t.figures(chosen.craft) for name, t in times.items()}
    per_crossing = times["crossing times"].figures(crossings)["cpu_median_s"]
    show(
        f"{chosen.craft} craft, {crossings} crossings; CPU time per craft and period [us]",
        ["stage", "median", "minimum", "wall median"],
        [[n, *(1e6 * f[k] for k in ("cpu_median_s", "cpu_minimum_s", "wall_median_s"))] for n, f in per.items()],
    )
    by_scipy = scipy_times.figures(len(chosen_ones))
    print(f"\nper crossing: {1e9 * per_crossing:.0f} ns, SciPy {1e6 * by_scipy['cpu_median_s']:.0f} us")
    print(", ".join(f"{name} {value:.3g}" for name, value in truth.items()))
    result = {"craft": chosen.craft, "crossings": crossings, "per_craft": per, "brentq_per_crossing": by_scipy}
    finish("crossing", {**result, "per_crossing_s": per_crossing, "truth": truth}, chosen.out)


if __name__ == "__main__":
    main()
