"""PnP and dilution of several craft at once, beside the same work in C++ with AVX2, four craft per vector.

    python benchmarks/lanes.py [--craft 1000] [--repeats 60] [--limit LIBRARY.so] [--out lanes.json]

The product's kernels on one period of `swarm1000`, moving, 12 photodiodes of which 11.5 are lit on average, with all
that they do beside the equations: checks, copies, motion within the period, residuals, slopes. The limit is a library
with `lm_v(N, n, R, t, P, uv, iterations, cost)` and `dop_v(N, n, R, t, P, variance, H)`: three Levenberg-Marquardt
steps of a craft at rest with all its photodiodes lit, and (18) without slopes and coupling; without `--limit` left out.
Candidates take turns in one process; the minimum of many short blocks is what a load of other programs disturbs least.
"""

import ctypes
from collections.abc import Callable

import numpy as np
from harness import finish, interleaved, options, show
from period import captured

from estimators.lighthouse.dop import dilution
from estimators.lighthouse.pnp import refine, refine_projections, refine_with_dilution
from estimators.lighthouse.projection import angle_weights, projections


def limits(
    library: str, uv: np.ndarray, point: np.ndarray, pose: tuple[np.ndarray, ...]
) -> dict[str, Callable[[], object]]:
    """Return the limit's two functions on the same craft."""
    code = ctypes.CDLL(library)
    count, most, _ = uv.shape
    place, seen = np.ascontiguousarray(point[0]), np.nan_to_num(uv)
    start = [np.nan_to_num(part, nan=1.0) for part in pose]
    cost, h = np.empty(count), np.empty((count, 21))

    def address(array: np.ndarray) -> ctypes.c_void_p:
        return ctypes.c_void_p(array.ctypes.data)

    def steps() -> None:
        rotation, position = (part.copy() for part in start)
        code.lm_v(count, most, address(rotation), address(position), address(place), address(seen), 3, address(cost))

    def precision() -> None:
        at = address(start[0]), address(start[1])
        code.dop_v(count, most, *at, address(place), ctypes.c_double(1.0), address(h))

    return {"limit: 3 steps": steps, "limit: dilution": precision}


def main() -> None:
    """Measure, show, write."""
    chosen = options(
        __doc__,
        craft=(1000, "craft"),
        repeats=(60, "repetitions"),
        limit=("", "library of the limit"),
    )
    c = captured(chosen.craft)
    uv = projections(c.refine[0])
    weight = angle_weights(uv)
    both = (*c.refine, c.dilution[7])
    candidates: dict[str, Callable[[], object]] = {
        "PnP, from angles": lambda: refine(*c.refine),
        "PnP, from projections": lambda: refine_projections(uv, weight, *c.refine[1:]),
        "dilution and slopes": lambda: dilution(*c.dilution),
        "both, from one table": lambda: refine_with_dilution(*both),
    }
    if chosen.limit:
        candidates |= limits(chosen.limit, uv, c.refine[2], c.refine[3:5])
    times = interleaved(candidates, chosen.repeats)
    per = {name: t.figures(chosen.craft) for name, t in times.items()}

    def ratio(name: str) -> float | None:
        if not chosen.limit:
            return None
        least = {of: per[of]["wall_minimum_s"] for of in ("limit: 3 steps", "limit: dilution")}
        dilutes = "dilution" in name
        of = sum(least.values()) if "both" in name else least["limit: dilution" if dilutes else "limit: 3 steps"]
        return per[name]["wall_minimum_s"] / of

    show(
        f"{chosen.craft} craft, {c.refine[1].sum(axis=1).mean():.1f} photodiodes lit on average; per craft [us]",
        ["", "minimum", "CPU median", "over the limit"],
        [[name, 1e6 * f["wall_minimum_s"], 1e6 * f["cpu_median_s"], ratio(name)] for name, f in per.items()],
    )
    finish("lanes", {"craft": chosen.craft, "per_craft": per}, chosen.out)


if __name__ == "__main__":
    main()
