"""A layout's figures, as the JSON has them, and as the reader at a terminal sees them.

Errors at a percentile are null where more poses are unsolvable than the percentile forgives; the terminal shows ∞.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
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
from swarm.tables import RankedColumn, fitting, table

Figures = Mapping[str, Any]
WAYS = ("all_poses", "same_poses", "same_share")
PERCENTILES = tuple(range(5, 100, 5))
BOTH_COLUMNS = 78
"""Width from which the comparison has room for what was measured beside what is predicted."""


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
        "asked": {
            **request._asdict(),
            "distance_m": list(request.distance_m),
            "overrides": list(request.overrides),
            "keep_out": list(request.keep_out),
        },
        "keep_out": [] if task.keep_out is None else task.keep_out.zones,
        "wanted_precision_met": None
        if (request.attitude_deg, request.position_mm) == (None, None)
        else meets(ours.predicted, task, request.attitude_deg, request.position_mm),
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
        "unsolvable_with_one_lost_share": found.unsolvable_with_one_lost,
        "error_with_one_lost": _number(percentile(found.lost, share)),
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
    console.print(Text(f"{made['photodiodes']} photodiodes on {made['model']}: {_asked(made['asked'])}"))
    console.print(
        Text(f"error e: e² = (attitude / {one['attitude_deg']:g}°)² + (position / {one['position_mm']:g} mm)²")
    )
    layouts = made["layouts"]
    printed, left_out = fitting(console.width, _columns(layouts, q))
    console.print(printed)
    if left_out:
        console.print(Text(f"No room in {console.width} columns for: {left_out} (the JSON has them).", "dim"))
    for sentence in (*_sentences(made), *_warnings(made)):
        console.print(Text(*sentence))
    found = ", ".join(
        f"{name} {_percent(each['measured']['found_from_nothing_share'])}" for name, each in layouts.items()
    )
    console.print(
        Text(
            f"Solvable poses that are found without a start, rightly and for certain, from one period's angles: {found}"
        )
    )
    console.print(Text(f"Design against the other layouts, by the {q} percentile of e; unsolvable poses count as ∞:"))
    console.print(_against(made, console.width))
    against = made["design_against_every_even_spread"]
    low, high = (100 * share for share in against["unsolvable"])
    console.print(
        Text(
            f"The even layout is the most even of {against['spreads']} spreads (farthest points, other first ones). "
            f"They leave {low:.1f} % to {high:.1f} % unsolvable. Design over even, predicted: "
            + "; ".join(f"{_way(way)} {_span(against['ratio'][way])}" for way in WAYS)
        )
    )


def _asked(asked: Figures) -> str:
    """Return in words at which poses a layout is judged."""
    cone = asked["cone_deg"]
    if asked["scene"] is not None:
        return f"along the flight of {asked['scene']}, turned by up to {cone:g}°"
    attitudes = "all attitudes" if cone >= 180 else f"+z within {cone:g}° of the lighthouse"
    distance = ", ".join(f"{d:g}" for d in asked["distance_m"])
    return f"{attitudes}, at {distance} m, up to {asked['off_axis_deg']:g}° off the boresight"


def _columns(layouts: Figures, q: str) -> list[RankedColumn]:
    def cells(text: Callable[[Figures], str]) -> list[str]:
        return [text(each) for each in layouts.values()]

    six = f"share_with_{WANTED_LIT}_lit"
    return [
        RankedColumn(0, "layout", list(layouts)),
        RankedColumn(4, "photo-\ndiodes", cells(lambda each: str(each["photodiodes"]))),
        RankedColumn(1, "unsolv-\nable, %", cells(lambda each: f"{100 * each['unsolvable_share']:.1f}")),
        RankedColumn(1, "one\nlost, %", cells(lambda each: f"{100 * each['unsolvable_with_one_lost_share']:.1f}")),
        RankedColumn(7, f"{WANTED_LIT} lit\n%", cells(lambda each: f"{100 * each[six]:.0f}")),
        RankedColumn(6, "e\nmedian", cells(lambda each: _shown(each["predicted"]["median"]))),
        RankedColumn(2, f"e\n{q}", cells(lambda each: _shown(each["predicted"]["error"]))),
        RankedColumn(5, f"e, one\nlost {q}", cells(lambda each: _shown(each["error_with_one_lost"]))),
        RankedColumn(3, f"att., °\n{q}", cells(lambda each: _shown(each["predicted"]["attitude_deg"]))),
        RankedColumn(3, f"pos., mm\n{q}", cells(lambda each: _shown(each["predicted"]["position_mm"]))),
        RankedColumn(8, f"meas. e\n{q}", cells(lambda each: _shown(each["measured"]["error"]))),
        RankedColumn(9, "/ pre-\ndicted", cells(lambda each: _shown(each["measured"]["median_ratio_to_predicted"]))),
    ]


def _sentences(made: Figures) -> Iterator[tuple[str, str]]:
    """Yield what the layout promises."""
    if made["asked"]["losses"]:
        poses = made["poses"]["predicted"]
        yield f"Each of {poses} poses that the search has not seen stays solvable with any one photodiode lost.", ""
    if made["keep_out"]:
        yield f"Kept free: {', '.join(made['keep_out'])}", ""
    if made["wanted_precision_met"] is not None:
        verdict, share = "met" if made["wanted_precision_met"] else "NOT met", f"{made['percentile']:g} % of the poses"
        yield f"The wanted precision is {verdict} by the design at {share}, as predicted.", ""


def _warnings(made: Figures) -> Iterator[tuple[str, str]]:
    """Yield what the user should not overlook."""
    designed = made["layouts"]["designed"]
    if made["photodiodes"] < WANTED_LIT:
        yield (
            f"Warning: {made['photodiodes']} photodiodes; below {WANTED_LIT}, one lost leaves no check of the pose "
            "and perhaps two poses that fit",
            "yellow",
        )
    if not made["asked"]["losses"] and (share := designed["unsolvable_with_one_lost_share"]):
        yield (
            f"Warning: with one photodiode dead or shadowed, {100 * share:.2g} % of the poses are unsolvable "
            "(--losses 1 looks for a layout without such poses)",
            "yellow",
        )
    if made["asked"]["scene"] is None:
        yield "The craft is judged alone: --scene takes ports and neighbours that shade it into account.", "dim"


def _against(made: Figures, width: int) -> Table:
    change = ("\nother", "\nchange")
    both = width >= BOTH_COLUMNS
    heads = ("predicted\ndesign", *change, *(("measured\ndesign", *change) if both else ()))
    printed = table("", "poses", *heads, left=2, tight=True)
    for name, ways in made["design_against"].items():
        predicted, measured = ways["predicted"], ways["measured"]
        notes = {
            "all_poses": "all",
            "same_poses": f"both solve ({100 * predicted['both_solve_share']:.0f} %)",
            "same_share": f"best {100 * predicted['same_share_of_poses']:.0f} % of each",
        }
        for way, note in notes.items():
            cells = [*_cells(predicted[way]), *(_cells(measured[way]) if both else ())]
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
