"""A layout's figures, as the JSON has them, and as the reader at a terminal sees them.

Errors at a percentile are null where more poses are unsolvable than the percentile forgives; the terminal shows ∞.
"""

from collections.abc import Mapping, Sequence
from math import degrees, isfinite
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table
from rich.text import Text

from estimators.arrays import Floats
from estimators.layout.error import WANTED_LIT, percentile
from swarm.studies.layout.judgement import Comparison, Judged, compare, lit_share, tried
from swarm.studies.layout.prediction import Task
from swarm.studies.layout.request import Request
from swarm.studies.layout.smallest import meets
from swarm.tables import table

Figures = Mapping[str, Any]
WAYS = ("all_poses", "same_poses", "same_share")
PERCENTILES = tuple(range(5, 100, 5))


def figures(request: Request, task: Task, judged: Sequence[Judged]) -> dict[str, Any]:
    """Return everything that was found, ready for JSON.

    Args:
        request: What the user asked for.
        task: The request in SI units.
        judged: The design, the even layout, the others.
    """
    ours = judged[0]
    share = task.share
    compared = {
        other.name: {
            "predicted": _comparison(compare(ours.predicted.error, other.predicted.error, share)),
            "measured": _comparison(compare(ours.measured.error, other.measured.error, share)),
        }
        for other in judged[1:]
        if ours.measured and other.measured
    }
    evens = [compare(ours.predicted.error, j.predicted.error, share) for j in judged if j.name.startswith("even")]
    ratios = np.array([comparison.ratios() for comparison in evens])
    return {
        "program": "lighthouse-swarm",
        "model": task.hull.path.name,
        "photodiodes": len(ours.mount.point_m),
        "asked": {**request._asdict(), "distance_m": list(request.distance_m), "overrides": list(request.overrides)},
        "wanted_precision_met": None
        if (request.attitude_deg, request.position_mm) == (None, None)
        else meets(ours.predicted, share, request.attitude_deg, request.position_mm),
        "error_of_one": {
            "attitude_deg": degrees(task.mix.attitude_rad),
            "position_mm": 1e3 * task.mix.position_m,
        },
        "percentile": 100 * share,
        "poses": {"predicted": len(ours.predicted.error), "measured": len(tried(ours.predicted.error))},
        "layouts": {j.name: _layout(j, share) for j in judged if j.measured},
        "design_against": compared,
        "design_against_every_even_spread": {
            "spreads": len(evens),
            "ratio": {way: _range(ratios[:, i]) for i, way in enumerate(WAYS)},
            "unsolvable": _range(np.array([j.predicted.unsolvable for j in judged if j.name.startswith("even")])),
        },
        "design": [
            {"point_mm": (1e3 * point).round(3).tolist(), "normal": normal.round(6).tolist()}
            for point, normal in zip(ours.mount.point_m, ours.mount.normal, strict=True)
        ],
    }


def _layout(judged: Judged, share: float) -> dict[str, Any]:
    found, measured = judged.predicted, judged.measured
    assert measured is not None
    solvable = np.isfinite(measured.error)
    ratio = measured.error[solvable] / tried(found.error)[solvable]
    return {
        "photodiodes": len(judged.mount.point_m),
        "unsolvable_share": found.unsolvable,
        f"share_with_{WANTED_LIT}_lit": lit_share(found),
        "predicted": _percentiles(found.attitude_rad, found.position_m, found.error, share),
        "measured": {
            **_percentiles(measured.attitude_rad, measured.position_m, measured.error, share),
            "unsolvable_share": float(np.mean(~solvable)),
            "failed_trials_share": _number(measured.failed),
            "found_from_nothing_share": _number(measured.found),
            "median_ratio_to_predicted": _number(float(np.median(ratio))) if len(ratio) else None,
        },
        "error_by_percentile": {str(q): _number(percentile(found.error, q / 100)) for q in PERCENTILES},
    }


def _percentiles(attitude: Floats, position: Floats, error: Floats, share: float) -> dict[str, float | None]:
    return {
        "median": _number(percentile(error, 0.5)),
        "error": _number(percentile(error, share)),
        "attitude_deg": _number(degrees(percentile(attitude, share))),
        "position_mm": _number(1e3 * percentile(position, share)),
    }


def _comparison(made: Comparison) -> dict[str, Any]:
    pairs = zip(WAYS, (made.all_poses, made.same_poses, made.same_share), made.ratios(), strict=True)
    out: dict[str, Any] = {
        way: {"design": _number(a), "other": _number(b), "ratio": _number(r)} for way, (a, b), r in pairs
    }
    return {**out, "both_solve_share": made.both_solve, "same_share_of_poses": made.share}


def _range(values: Floats) -> list[float | None]:
    known = values[~np.isnan(values)]
    return [_number(float(known.min())), _number(float(known.max()))] if len(known) else [None, None]


def _number(value: float) -> float | None:
    return value if isfinite(value) else None


def print_report(console: Console, made: Figures) -> None:
    """Print the tables, and what they mean."""
    one, q = made["error_of_one"], f"{made['percentile']:g} %"
    asked = made["asked"]
    cone = "all attitudes" if asked["cone_deg"] >= 180 else f"+z within {asked['cone_deg']:g}° of the lighthouse"
    distance = ", ".join(f"{d:g}" for d in asked["distance_m"])
    console.print(
        Text(
            f"{made['photodiodes']} photodiodes on {made['model']}: {cone}, at {distance} m, "
            f"up to {asked['off_axis_deg']:g}° off the boresight"
        )
    )
    console.print(
        Text(f"error e: e² = (attitude / {one['attitude_deg']:g}°)² + (position / {one['position_mm']:g} mm)²")
    )
    found = ("e\nmedian", f"e\n{q}", f"att., °\n{q}", f"pos., mm\n{q}", f"meas. e\n{q}", "/ pre-\ndicted")
    heads = ("layout", "photo-\ndiodes", "unsolv-\nable, %", f"{WANTED_LIT} lit\n%", *found)
    printed = table(*heads, tight=True, wrap=True)
    layouts = made["layouts"]
    for name, layout in layouts.items():
        predicted, measured = layout["predicted"], layout["measured"]
        printed.add_row(
            name,
            str(layout["photodiodes"]),
            f"{100 * layout['unsolvable_share']:.1f}",
            f"{100 * layout[f'share_with_{WANTED_LIT}_lit']:.0f}",
            *(_shown(predicted[key]) for key in ("median", "error", "attitude_deg", "position_mm")),
            _shown(measured["error"]),
            _shown(measured["median_ratio_to_predicted"]),
        )
    console.print(printed)
    console.print(
        Text(
            "Solvable poses that are found without a start, rightly and for certain, from one period's angles: "
            + ", ".join(
                f"{name} {_percent(each['measured']['found_from_nothing_share'])}" for name, each in layouts.items()
            )
        )
    )
    if made["wanted_precision_met"] is not None:
        verdict = "met" if made["wanted_precision_met"] else "NOT met"
        console.print(Text(f"The wanted precision is {verdict} by the design at {q} of the poses, as predicted."))
    console.print(Text(f"Design against the other layouts, by the {q} percentile of e; unsolvable poses count as ∞:"))
    console.print(_against(made))
    against = made["design_against_every_even_spread"]
    low, high = (100 * share for share in against["unsolvable"])
    console.print(
        Text(
            f"The even layout is the most even of {against['spreads']} spreads (farthest points, other first ones). "
            f"They leave {low:.1f} % to {high:.1f} % unsolvable. Design over even, predicted: "
            + "; ".join(f"{_way(way)} {_span(against['ratio'][way])}" for way in WAYS)
        )
    )


def _against(made: Figures) -> Table:
    change = ("\nother", "\nchange")
    printed = table("", "poses", "predicted\ndesign", *change, "measured\ndesign", *change, left=2, tight=True)
    for name, ways in made["design_against"].items():
        predicted, measured = ways["predicted"], ways["measured"]
        notes = {
            "all_poses": "all",
            "same_poses": f"that both solve ({100 * predicted['both_solve_share']:.0f} %)",
            "same_share": f"each one's best {100 * predicted['same_share_of_poses']:.0f} %",
        }
        for way, note in notes.items():
            cells = [*_cells(predicted[way]), *_cells(measured[way])]
            printed.add_row(name if way == WAYS[0] else "", note, *cells)
    return printed


def _cells(pair: Figures) -> tuple[str, str, str]:
    ratio = pair["ratio"]
    change = "–" if ratio is None else "∞ → finite" if ratio == 0 else f"{100 * (ratio - 1):+.0f} %"
    return _shown(pair["design"]), _shown(pair["other"]), change


def _way(way: str) -> str:
    return {"all_poses": "all poses", "same_poses": "same poses", "same_share": "same share"}[way]


def _span(values: Sequence[float | None]) -> str:
    low, high = (_shown(value) for value in values)
    return low if low == high else f"{low} to {high}"


def _percent(share: float | None) -> str:
    return "–" if share is None else f"{100 * share:.1f} %"


def _shown(value: float | None) -> str:
    return "∞" if value is None else f"{value:.3f}" if value < 10 else f"{value:.1f}"
