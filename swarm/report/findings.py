"""Sentences about a run's figures: what they mean, and what is wrong with single craft."""

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from swarm.onboard.settings import MIN_LIT
from swarm.report.measured import measured

Figures = Mapping[str, Any]
FEWEST_SAMPLES = 20
"""Fewer independent samples than this say nothing about a filter, unless its errors are `FAR` too large."""
FAR = 1.5
"""Errors larger than promised by this factor, and beyond chance, are told however few samples there are."""
REFUSED_MUCH = 0.01
"""A larger share of refused poses than this is worth a line: the gate itself lets 0.99999 of good ones pass."""
AMBIGUOUS_MUCH = 0.01
"""A larger share of ambiguous periods than this is worth a line: a search takes some periods anywhere."""
SINGLE_MUCH = 0.01
"""A larger share of periods by single sweeps than this is worth a line: figures of poses leave these periods out."""
BIAS_SIGMAS = 4.0
"""A slope of the motion bias below so many of its sigmas is not worth a line: chance reaches it once in 16 000."""
LEAST_HUNDREDTHS = 0.05
"""Ratio from which on hundredths tell enough."""
LEAST_DELTA_V = 1e-9
"""Delta-v that is worth a sentence [m/s]; below it a motor made good no more than rounding."""
EXACT = 6.0
"""NEES and NIS of errors that are as large as the filter promises."""
LEFT = 0.8
"""A scatter of which a smoother leaves a larger share is mostly motion within the second, which it must leave."""
WORTH = 0.1
"""Errors that differ by less than this share from what the filter promises call for nothing."""

TIMES = 2.0
"""Errors are told as a multiple of the promise from this one on, below it by the difference in percent."""


class Finding(NamedTuple):
    """A sentence, and the style in which it is printed."""

    text: str
    style: str = ""


def of_summary(summary: Figures, cards: bool = False) -> list[Finding]:
    """Return all that the summary of a run says, group by group where the craft have different sensors.

    cards: delta-v and dockings are left out, as they have places of their own.
    """
    groups, craft = summary.get("groups") or {}, summary["craft"]
    said = [
        Finding(f"{name}: {each.text}" if name else each.text, each.style)
        for name, figures in (groups or {"": summary["swarm"]}).items()
        for each in findings(figures, effort=not cards)
    ]
    ends = [] if cards else dockings(craft)
    return [*said, *inspections(summary.get("lidar") or {}), *ends, *warnings(craft)]


def findings(figures: Figures, effort: bool = True) -> list[Finding]:
    """Return what the figures of a swarm or a craft say; effort: with the delta-v."""
    out: list[Finding | None] = [_consistency(figures, key) for key in ("nees", "nis")]
    out.append(_single_sweeps(figures))
    position, attitude = figures.get("ekf_to_pnp_position_ratio"), figures.get("ekf_to_pnp_attitude_ratio")
    if position is not None and attitude is not None:
        small = min(position, attitude) < LEAST_HUNDREDTHS
        both = (f"{ratio:.2g}" if small else f"{ratio:.2f}" for ratio in (position, attitude))
        out.append(Finding("Filter error over raw PnP error: {} in position, {} in attitude".format(*both)))
    out += _smoothed(figures)
    if effort and (delta_v := figures.get("delta_v_m_s") or 0.0) >= LEAST_DELTA_V:
        out.append(Finding(f"Delta-v: {delta_v:.3g} m/s per craft"))
    if ccd := figures.get("ccd"):
        stereo, alone = 100 * ccd["stereo_share"], 100 * ccd["camera_share"]
        shares = f"stereo {stereo:.0f} %, the main camera alone {alone:.0f} % of the images"
        out.append(Finding(f"Cameras: {shares}; the sensor in use changed {ccd['sensor_switches']} times"))
    out += [_motion_bias(figures, *size) for size in (("position", "m", "mm"), ("attitude", "deg", "°"))]
    return [finding for finding in out if finding is not None]


def _single_sweeps(figures: Figures) -> Finding | None:
    """Return how much of the flight the figures of poses leave out, None if hardly any."""
    share = figures.get("single_sweeps_share") or 0.0
    if share < SINGLE_MUCH:
        return None
    return Finding(
        f"Navigated by single sweeps, with fewer than four photodiodes, in {100 * share:.0f} % of the periods:"
        " PnP, ADOP and PDOP are those of the periods with a pose"
    )


def _smoothed(figures: Figures) -> list[Finding | None]:
    """Return what a smoother has gained, against the truth or, in a replay, in scatter."""
    position, attitude = figures.get("smooth_to_ekf_position_ratio"), figures.get("smooth_to_ekf_attitude_ratio")
    if position and attitude:
        gain = f"Smoothed error over the filter's: {position:.2f} in position, {attitude:.2f} in attitude"
        return [_consistency(figures, "smooth_nees"), Finding(gain)]
    before, after = figures.get("ekf_position_scatter_mm"), figures.get("smooth_position_scatter_mm")
    if before is None or after is None:
        return []
    said = f"Scatter of the positions about their mean over a second: {before:.3g} mm, smoothed {after:.3g} mm"
    if not scatter_is_noise(before, after):
        said += "; what the smoother leaves is mostly the object's own motion, so this is no measure of its gain"
    return [Finding(said)]


def scatter_is_noise(before_mm: float, after_mm: float) -> bool:
    """Return whether a smoother has taken enough of a scatter away that noise, and not motion, is a good part of it."""
    return after_mm <= LEFT * before_mm


def meaning(consistency: Figures) -> str:
    """Return what a user makes of NEES or NIS: how large the errors are beside the filter's promise, and what to do."""
    size, inside = _size(consistency), consistency["inside_band"]
    if not _says_something(consistency):
        return "too few independent values to judge"
    if inside:
        return "as the filter promises"
    off, few = abs(size - 1), "" if _has_many(consistency) else ", by few independent values"
    if size >= TIMES:
        by = f"{size:.2g} times as large as"
    else:
        share = "less than 1 %" if off < 0.01 else f"{100 * off:.0f} %"
        by = f"{share} {'smaller' if size < 1 else 'larger'} than"
    if off <= WORTH:
        verdict = "nothing to act on"
    elif size < 1:
        verdict = "it is cautious, as in smooth motion"
    else:
        verdict = "it expects less noise or smoother motion than there is"
    return f"errors {by} the filter promises{few}: {verdict}"


def _has_many(consistency: Figures) -> bool:
    return bool(consistency["effective_samples"] >= FEWEST_SAMPLES)


def _says_something(consistency: Figures) -> bool:
    return _has_many(consistency) or (not consistency["inside_band"] and _size(consistency) >= FAR)


def _size(consistency: Figures) -> float:
    """Return the size of the errors over what the filter promises."""
    return math.sqrt(max(consistency["mean"], 0.0) / EXACT)


def _consistency(figures: Figures, key: str) -> Finding | None:
    f = figures.get(key)
    if not f:
        return None
    said, refused, nees = meaning(f), figures.get("refused_share") or 0.0, figures.get("nees")
    if key == "nis" and f["mean"] > f["band_high"] and refused and nees and _size(nees) <= 1 + WORTH:
        # A few reflections, rightly refused, make a mean of thousands.
        share = f"{100 * refused:.2f} %"
        said = f"the mean of all light, with the {share} of it that the filters refused; NEES judges the rest"
        return Finding(f"NIS {f['mean']:.5g}: {said}")
    if _says_something(f) and f["mean"] > f["band_high"] and (hit := figures.get("contact_periods")):
        said += f"; there were {hit} periods in contact, whose blow no filter can know of"
    elif colour(f) == "yellow":
        said += " (navigation.acceleration_noise_m_s2, docs/filter.md)"
    name = "NEES of the smoothed estimate" if key == "smooth_nees" else key.upper()
    return Finding(f"{name} {f['mean']:.2f}: {said} (6 is exact, chance {_band(f)})", colour(f))


def _band(f: Figures) -> str:
    return f"{f['band_low']:.2f} to {f['band_high']:.2f}"


def _motion_bias(figures: Figures, name: str, unit: str, shown: str) -> Finding | None:
    bias = figures.get("pnp_motion_bias") or {}
    slopes, sigmas = bias.get(f"{name}_slope_s", ()), bias.get(f"{name}_slope_sigma_s", ())
    pairs = zip(slopes, sigmas, strict=True)
    if figures["samples"] < FEWEST_SAMPLES or not any(
        slope is not None and sigma is not None and abs(slope) > BIAS_SIGMAS * sigma for slope, sigma in pairs
    ):
        return None
    rms = (bias[f"{name}_rms_{unit}"] or 0.0) * (1000 if shown == "mm" else 1)
    axes = ", ".join(f"{a} {b * 1000:+.2f} ms" for a, b in zip("xyz", slopes, strict=True) if b is not None)
    return Finding(f"Motion biases PnP's {name}: {rms:.2g} {shown} RMS ({axes})", "yellow")


NEVER_ACQUIRED = {
    "ambiguous": "more than one attitude fits, the shape is symmetric or looks so from there",
    "undetermined": "the surface in sight leaves a direction free, as a single plane or a round body does",
    "not recognised": "no pose of the known shape explains what returned",
    "too few returns": "the target is too far, too small, or seen edge on",
    "no own fix": "the observer did not know its own pose",
}
"""Per outcome of a scan: why a target was never acquired."""


def dockings(craft: Mapping[str, Figures]) -> list[Finding]:
    """Return what became of every docking."""
    ends = {name: end for name, f in craft.items() if (end := f.get("docking"))}
    return [Finding(f"{name}: {end['sentence']}", "" if end["docked"] else "bold red") for name, end in ends.items()]


def reasons(verdicts: Sequence[Figures]) -> list[Finding]:
    """Return why criteria were missed, a sentence each; a reason that several share is told once."""
    out, told = list[Finding](), set[str]()
    for v in verdicts:
        if not v.get("why"):
            continue
        why = _beside_the_limits(v)
        value, has_reason, reason = why.partition("; ")
        if has_reason and reason in told:
            why = f"{value}; for the same reason"
        told.add(reason)
        out.append(Finding(f"{v['name']}: {why}", "red"))
    return out


def _beside_the_limits(verdict: Figures) -> str:
    """Return the value of a missed criterion, its limits, and why."""
    why, (value, limits) = verdict["why"], measured(verdict)
    told = f"{value} (limit: {limits})"
    # A reason may have a colon of its own.
    return f"{told}{'; ' if ': ' in why else ': '}{why}"


def inspections(lidar: Mapping[str, Figures]) -> list[Finding]:
    """Return what every LiDAR made of its target."""
    out = []
    for name, f in lidar.items():
        times = "once" if f["acquisitions"] == 1 else f"{f['acquisitions']} times"
        text = (
            f"{name}'s LiDAR: {f['target']} tracked in {100 * f['tracked_share']:.1f} % of {f['scans']} scans, "
            f"acquired {times}"
        )
        if f["measured_attitude_mean_deg"] is not None:
            text += f"; attitude error of a scan {f['measured_attitude_mean_deg']:.2f}° on average"
            text += f", {f['measured_attitude_max_deg']:.2f}° at most"
        if not f["acquisitions"] and f["outcomes"]:
            most = max(f["outcomes"], key=lambda word: f["outcomes"][word])
            text += f"; {f['outcomes'][most]} scans {most}: {NEVER_ACQUIRED.get(most, 'no pose was found')}"
        if inertia := f.get("inertia"):
            told = " : ".join(
                f"{m:.3f} ± {m * s:.3f}" for m, s in zip(inertia["moments"], inertia["sigmas"], strict=True)
            )
            text += f"; principal moments of inertia as {told}, {inertia['observed']} of 5 ratios observed"
        out.append(Finding(text))
    return out


def warnings(craft: Mapping[str, Figures]) -> list[Finding]:
    """Return what is wrong with single craft that the swarm's figures hide, and what to do about it."""
    craft = {name: f for name, f in craft.items() if f.get("navigates", True)}
    dark = [name for name, f in craft.items() if not (f["mean_visible"] or f.get("ccd") or f.get("observed"))]
    few = [name for name, f in craft.items() if f.get("tracking_share") == 0 and 0 < (f["mean_visible"] or 0) < MIN_LIT]
    refused = {name: f["refused_share"] or 0.0 for name, f in craft.items() if f.get("refused_share")}
    # What is ambiguous is refused for another reason than the filter's noise.
    refused = {n: share for n, share in refused.items() if share > REFUSED_MUCH and not _ambiguous(n, craft[n])}
    vain = [name for name, f in craft.items() if colour(f.get("nees")) == "yellow"]
    out = []
    if dark:
        out.append(
            f"{names(dark)} never saw light: outside the field or range, turned away, every photodiode covered, or the "
            "lighthouse dark"
        )
    if few:
        out.append(
            f"{names(few)} never had an estimate: a first pose takes {MIN_LIT} photodiodes lit in one period, and "
            + ("it" if len(few) == 1 else "each of them")
            + f" saw {max(craft[name]['mean_visible'] for name in few):.1f} on average at most"
        )
    if refused:
        worst = max(refused, key=lambda name: refused[name])
        out.append(
            f"The filter refused {100 * refused[worst]:.0f} % of {worst}'s poses"
            + (f" (and of {len(refused) - 1} more craft)" if len(refused) > 1 else "")
            + ": it moves more sharply than navigation.acceleration_noise_m_s2 and"
            " angular_acceleration_noise_deg_s2 expect, or its errors are not noise (docs/filter.md)"
        )
    out += [sentence for name, f in craft.items() if (sentence := _ambiguous(name, f))]
    out += [sentence for name, f in craft.items() if (sentence := _untrusted(name, f))]
    if vain and len(craft) > 1:
        out.append(f"Errors larger than the filter promises: {names(vain)}")
    return [Finding(sentence, "yellow") for sentence in out]


def _ambiguous(name: str, figures: Figures) -> str | None:
    """Return why the pose that a craft had by its own photodiodes was ambiguous, None if it hardly was."""
    share = figures.get("ambiguous_share") or 0.0
    # Of a target that others observe, `inspections` tells why its shape does not decide.
    if share <= AMBIGUOUS_MUCH or not figures["mean_visible"]:
        return None
    return (
        f"The pose of {name} was ambiguous in {100 * share:.0f} % of the periods: its lit photodiodes lie in one plane,"
        " or look so from there, and a plane and its mirror image fit nearly equally well; one photodiode off the"
        " plane, more size or less distance decides (docs/models.md)"
    )


def _untrusted(name: str, figures: Figures) -> str | None:
    """Return what the residual test of a replay left out, None if nothing to speak of."""
    tested = figures.get("integrity")
    if "peer_samples" not in figures or not tested:
        return None
    dropped, failed = tested["mean_dropped_photodiodes"] or 0.0, tested["failed_residual_test_share"] or 0.0
    parts = []
    if dropped > REFUSED_MUCH:
        parts.append(f"left out {dropped:.2f} photodiodes per period as false")
    if failed > REFUSED_MUCH:
        parts.append(f"refused {100 * failed:.0f} % of the poses")
    return f"The residual test of {name} " + " and ".join(parts) + " (column dropped_photodiodes)" if parts else None


def names(craft: list[str]) -> str:
    """Return the names of some craft, of many the first four."""
    return ", ".join(craft[:4]) + (f" and {len(craft) - 4} more" if len(craft) > 4 else "")


def colour(consistency: Figures | None) -> str:
    """Return the style of a consistency figure: green as promised, yellow where errors are larger than promised."""
    if not consistency or not _says_something(consistency):
        return ""
    size = _size(consistency)
    if consistency["inside_band"] or abs(size - 1) <= WORTH:
        return "green"
    return "yellow" if size > 1 else ""
