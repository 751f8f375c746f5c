"""A run's summary for the reader at a terminal: a table per craft and for the swarm, and what the figures mean.

Columns are dropped, the least important first, until the table fits the terminal; a figure that nobody has (errors
against the truth, in a replay) has no column. Errors are the filter's unless the head says PnP.
"""

import math
import shlex
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from rich import box
from rich.console import Console, Group, RenderableType
from rich.table import Table
from rich.text import Text

Figures = Mapping[str, Any]
RECORDING = "recording.rrd"
MOST_ROWS = 16
"""Up to so many craft have a row each; of more, the worst ones are shown."""
WORST_ROWS = 8
ARCSEC_PER_RAD = math.degrees(1) * 3600
HEAD, NAME_WIDTH = "craft", 16
GAP = 2
"""Blanks between two columns."""
NOTHING = "–"
FEWEST_SAMPLES = 20
"""Fewer independent samples than this say nothing about a filter."""
REFUSED_MUCH = 0.01
"""A larger share of refused poses than this is worth a line: the gate itself lets 0.99999 of good ones pass."""
BIAS_SIGMAS = 4.0
"""A slope of the motion bias below so many of its sigmas is not worth a line: chance reaches it once in 16 000."""


Value = Callable[[Figures], float | None]


class Column(NamedTuple):
    """One or two figures side by side: columns of high `rank` are dropped first; `head` is two lines."""

    rank: int
    head: str
    values: tuple[Value, ...]
    between: str = " / "


def _figure(key: str, scale: float = 1.0, inside: str | None = None) -> Value:
    def value(figures: Figures) -> float | None:
        found = figures if inside is None else figures.get(inside) or {}
        number = found.get(key)
        return None if number is None else scale * number

    return value


def _error(source: str, what: str, scale: float = 1.0) -> tuple[Value, Value]:
    quantity, unit = what.split()
    return _figure(f"{source}_{quantity}_rms_{unit}", scale), _figure(f"{source}_{quantity}_max_{unit}", scale)


TRACKING = Column(0, "tracking\n%", (_figure("tracking_share", 100),))
ADOP = Column(4, "ADOP\n°/rad", (_figure("mean_adop_deg_per_rad"),))
PDOP = Column(5, "PDOP\nm/rad", (_figure("mean_pdop_m_per_rad"),))
NEES = Column(3, "NEES\nmean", (_figure("mean", inside="nees"),))
COLUMNS = (
    TRACKING,
    Column(1, "position, mm\nRMS / max", _error("ekf", "position m", 1000)),
    Column(2, "attitude, °\nRMS / max", _error("ekf", "attitude deg")),
    Column(7, "PnP, mm\nRMS / max", _error("pnp", "position m", 1000)),
    Column(8, "PnP, °\nRMS / max", _error("pnp", "attitude deg")),
    ADOP,
    PDOP,
    NEES,
    Column(6, "95 %\nband", (_figure("band_low", inside="nees"), _figure("band_high", inside="nees")), "–"),
)
REPLAY_COLUMNS = (
    TRACKING,
    Column(1, "solved\n%, ≥5 lit", (_figure("solved_share_with_5_photodiodes", 100),)),
    Column(2, "residual\narcsec", (_figure("residual_median_rad", ARCSEC_PER_RAD),)),
    Column(3, "lit\nmean", (_figure("mean_visible"),)),
    Column(8, "LM steps\nmean", (_figure("mean_iterations"),)),
    Column(6, "to peer\nmm", (_figure("peer_position_scatter_mm"),)),
    Column(7, "to peer\n°", (_figure("peer_attitude_scatter_deg"),)),
    ADOP,
    PDOP,
)


def print_report(console: Console, summary: Mapping[str, Any], folder: Path) -> None:
    """Print the table and the findings of a run's `summary`, and where the run's `folder` is."""
    console.print(results(summary, console.width))
    if verdicts := summary.get("criteria"):
        console.print()
        console.print(criteria_table(verdicts))
    if summary.get("status") != "complete":
        reason = summary.get("reason", "the program was killed")
        console.print(Text(f"\nThis run is not complete ({reason}); this is what there is until then.", style="yellow"))
    console.print(f"\n{folder}/", highlight=False, markup=False, soft_wrap=True)
    for file, meaning in written(folder):
        console.print(Text.assemble(f"  {file}", (f"  {meaning}", "dim")))
    if (folder / RECORDING).exists():
        console.print("Look at it: ", end="")
        console.print(
            f"swarm view {shlex.quote(str(folder))}", style="bold", highlight=False, markup=False, soft_wrap=True
        )


def criteria_table(verdicts: Sequence[Mapping[str, Any]]) -> Table:
    """Which criteria held: name, value, limits, and whose value it is."""
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, show_edge=False, padding=(0, GAP - 1, 0, 0))
    for head, side in (("criterion", "left"), ("", "left"), ("value", "right"), ("limits", "left"), ("craft", "left")):
        table.add_column(head, justify="right" if side == "right" else "left", no_wrap=head == "")
    for v in verdicts:
        held = Text(outcome(v), {True: "green", False: "bold red", None: "yellow"}[v["held"]])
        value = NOTHING if v["value"] is None else f"{v['value']:.4g}"
        table.add_row(Text(v["name"]), held, value, limits(v), Text(about(v)))
    return table


def outcome(verdict: Mapping[str, Any]) -> str:
    """Whether a criterion held."""
    return {True: "held", False: "MISSED", None: "not judged: after the end"}[verdict["held"]]


def about(verdict: Mapping[str, Any]) -> str:
    """Whose value it is, or which craft it is about."""
    named = list(verdict.get("about") or ())
    return verdict["craft"] or (_names(named) if named else "all")


def limits(verdict: Mapping[str, Any]) -> str:
    """What a criterion allows."""
    least, most = verdict["min"], verdict["max"]
    if least is None:
        return f"≤ {most:g}"
    return f"≥ {least:g}" if most is None else f"{least:g} to {most:g}"


def results(summary: Mapping[str, Any], width: int) -> RenderableType:
    """The table and the sentences below it, for a terminal of so many columns."""
    swarm = summary.get("swarm")
    if not swarm:
        return Text("Not one lighthouse period was recorded.")
    navigating = {name: f for name, f in summary["craft"].items() if f.get("navigates", True)}
    craft = _chosen(navigating)
    rows = [*craft.items(), *([("swarm", swarm)] if len(navigating) > 1 else [])]
    lines: list[RenderableType] = [_table(rows, width)]
    if len(craft) < len(navigating):
        lines.append(Text(f"The {len(craft)} worst of {len(navigating)} craft; summary.json has them all.", "dim"))
    sentences = [*findings(swarm), *inspections(summary.get("lidar") or {}), *warnings(summary["craft"])]
    return Group(*lines, Text(), *(Text(sentence, style) for sentence, style in sentences))


def findings(figures: Figures) -> list[tuple[str, str]]:
    """What the figures say, in sentences with a style each."""
    out = []
    for key, name in (("nees", "NEES"), ("nis", "NIS")):
        f = figures.get(key)
        if f and f["effective_samples"] >= FEWEST_SAMPLES:
            side = "inside" if f["inside_band"] else "below" if f["mean"] < f["band_low"] else "above"
            meaning = {
                "inside": "as the filter promises",
                "below": "errors smaller than the filter promises, as in smooth motion",
                "above": "errors larger than the filter promises",
            }[side]
            band = f"6 is exact, {f['band_low']:.2f} to {f['band_high']:.2f} is chance"
            if side == "above" and (hit := figures.get("contact_periods")):
                meaning += f"; there were {hit} periods in contact, whose blow no filter can know of"
            out.append((f"{name} {f['mean']:.2f}: {meaning} ({band})", _colour(f)))
    position, attitude = figures.get("ekf_to_pnp_position_ratio"), figures.get("ekf_to_pnp_attitude_ratio")
    if position is not None and attitude is not None:
        out.append((f"Filter error over raw PnP error: {position:.2f} in position, {attitude:.2f} in attitude", ""))
    if delta_v := figures.get("delta_v_m_s"):
        out.append((f"Delta-v: {delta_v:.3g} m/s a craft", ""))
    if ccd := figures.get("ccd"):
        shares = f"stereo {ccd['stereo_share']:.0%}, the main camera alone {ccd['camera_share']:.0%} of the images"
        out.append((f"Cameras: {shares}; the sensor in use changed {ccd['sensor_switches']} times", ""))
    bias = figures.get("pnp_motion_bias") or {}
    for name, size, unit in (("position", "position_rms_m", "mm"), ("attitude", "attitude_rms_deg", "°")):
        slopes, sigmas = bias.get(f"{name}_slope_s", ()), bias.get(f"{name}_slope_sigma_s", ())
        if figures["samples"] >= FEWEST_SAMPLES and any(
            b is not None and abs(b) > BIAS_SIGMAS * s for b, s in zip(slopes, sigmas, strict=True)
        ):
            rms = (bias[size] or 0.0) * (1000 if unit == "mm" else 1)
            axes = ", ".join(f"{a} {b * 1000:+.2f} ms" for a, b in zip("xyz", slopes, strict=True) if b is not None)
            out.append((f"Motion biases PnP's {name}: {rms:.2g} {unit} RMS ({axes})", "yellow"))
    return out


def inspections(lidar: Mapping[str, Figures]) -> list[tuple[str, str]]:
    """What every LiDAR made of its target."""
    return [
        (
            f"{name}'s LiDAR: {f['target']} tracked in {f['tracked_share']:.1%} of {f['scans']} scans, acquired "
            + ("once" if f["acquisitions"] == 1 else f"{f['acquisitions']} times")
            + (
                f"; attitude error of a scan {f['measured_attitude_mean_deg']:.2f}° on average, "
                f"{f['measured_attitude_max_deg']:.2f}° at most"
                if f["measured_attitude_mean_deg"] is not None
                else ""
            ),
            "",
        )
        for name, f in lidar.items()
    ]


def warnings(craft: Mapping[str, Figures]) -> list[tuple[str, str]]:
    """What is wrong with single craft that the swarm's figures hide, and what to do about it."""
    craft = {name: f for name, f in craft.items() if f.get("navigates", True)}
    dark = [name for name, f in craft.items() if not (f["mean_visible"] or f.get("ccd") or f.get("observed"))]
    refused = {name: f["refused_share"] or 0.0 for name, f in craft.items() if f.get("refused_share")}
    refused = {name: share for name, share in refused.items() if share > REFUSED_MUCH}
    vain = [
        name
        for name, f in craft.items()
        if (nees := f.get("nees")) and nees["effective_samples"] >= FEWEST_SAMPLES and nees["mean"] > nees["band_high"]
    ]
    out = []
    if dark:
        out.append(
            f"{_names(dark)} never saw light: outside the field or range, turned away, or every photodiode covered"
        )
    if refused:
        worst = max(refused, key=lambda name: refused[name])
        out.append(
            f"The filter refused {100 * refused[worst]:.0f} % of {worst}'s poses"
            + (f" (and of {len(refused) - 1} more craft)" if len(refused) > 1 else "")
            + ": it moves more sharply than navigation.acceleration_noise_m_s2 and"
            " angular_acceleration_noise_deg_s2 expect, or its errors are not noise (docs/filter.md)"
        )
    if vain and len(craft) > 1:
        out.append(f"NEES above its band: {_names(vain)}")
    return [(sentence, "yellow") for sentence in out]


def _names(craft: list[str]) -> str:
    return ", ".join(craft[:4]) + (f" and {len(craft) - 4} more" if len(craft) > 4 else "")


def written(folder: Path) -> list[tuple[str, str]]:
    """The files of a run that exist, and what each is."""
    files = (
        ("telemetry.parquet", "a row per craft and period"),
        ("angles.parquet", "every sweep angle, for swarm calibrate"),
        ("scans.parquet", "a row per LiDAR scan"),
        ("summary.json", "these figures, and more"),
        ("scenario.toml", "all that was set; run it again"),
        (RECORDING, "for the viewer"),
    )
    return [(name, meaning) for name, meaning in files if (folder / name).exists()]


def _chosen(craft: Mapping[str, Figures]) -> dict[str, Figures]:
    """All craft, or the worst of many: those that tracked least, then those with the largest error."""
    if len(craft) <= MOST_ROWS:
        return dict(craft)

    def badness(item: tuple[str, Figures]) -> tuple[float, float]:
        error = item[1].get("ekf_position_rms_m")
        return -(item[1].get("tracking_share") or 0.0), math.inf if error is None else error

    return dict(sorted(craft.items(), key=badness, reverse=True)[:WORST_ROWS])


def _table(rows: list[tuple[str, Figures]], width: int) -> Table:
    replay = any("peer_samples" in figures for _, figures in rows)
    columns = [(c, _cells(c, rows)) for c in (REPLAY_COLUMNS if replay else COLUMNS)]
    columns = [(c, cells) for c, cells in columns if any(cell != NOTHING for cell in cells)]
    room = width - min(max(len(name) for name, _ in [*rows, (HEAD, None)]), NAME_WIDTH)
    while columns and sum(GAP + _width(c, cells) for c, cells in columns) > room:
        columns.remove(max(columns, key=lambda pair: pair[0].rank))

    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, show_edge=False, padding=(0, GAP - 1, 0, 0))
    table.add_column(HEAD, no_wrap=True, max_width=NAME_WIDTH, overflow="ellipsis")
    for column, _ in columns:
        table.add_column(column.head, justify="right", no_wrap=True)
    for i, (name, figures) in enumerate(rows):
        is_swarm = i == len(rows) - 1 > 0
        if is_swarm:
            table.add_section()
        cells = (Text(texts[i], _colour(figures.get("nees")) if c is NEES else "") for c, texts in columns)
        table.add_row(Text(name), *cells, style="bold" if is_swarm else "")
    return table


def _cells(column: Column, rows: list[tuple[str, Figures]]) -> list[str]:
    """One column, each of its figures with as many decimals as give the largest three significant digits."""
    parts = []
    for value in column.values:
        numbers = [value(figures) for _, figures in rows]
        largest = max((abs(v) for v in numbers if v is not None), default=0.0)
        decimals = min(max(2 - math.floor(math.log10(largest)), 0), 5) if largest > 0 else 0
        texts = [NOTHING if v is None else f"{v:.{decimals}f}" for v in numbers]
        parts.append([text.rjust(max(map(len, texts))) for text in texts])
    joined = (column.between.join(cells) for cells in zip(*parts, strict=True))
    known = ([value(figures) is not None for value in column.values] for _, figures in rows)
    return [text if any(some) else NOTHING for text, some in zip(joined, known, strict=True)]


def _width(column: Column, cells: list[str]) -> int:
    return max(len(text) for text in (*column.head.split("\n"), *cells))


def _colour(consistency: Figures | None) -> str:
    return "" if not consistency else "green" if consistency["inside_band"] else "yellow"
