"""The golden gate: short runs of everything that computes, and the hashes of what they gave when they were kept.

    python -m tests.golden                      compare everything with what is kept, and print every difference
    python -m tests.golden formation layout     only these cases
    python -m tests.golden --update [CASE...]   keep what is computed now instead
    python -m tests.golden --long               longer flights, which pytest leaves out
    python -m tests.golden --list               the names

A case gives named values: a column of a table, a key of a summary, an entity of a recording. Of each is kept

    SHA-256 (16 digits), number of numbers, their mean, their rms

in tests/golden/CASE.json, with the machine that computed it. On such a machine hashes must be equal: bit for bit. On
another one (other processor, other libraries), floating point rounds elsewhere, so only the figures are compared, and
only roughly: see `TOLERANCE`. What takes wall time, and names of files and versions, are not among the values.
"""

import argparse
import hashlib
import json
import os
import platform
import re
import sys
import tempfile
import time
import tomllib
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, NamedTuple
from unittest import mock

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import swarm

# The rest of what is called of the package beside `swarm`'s own names: where files move, only this block changes.
# isort: split
from swarm import assets
from swarm.scenario import for_replay
from swarm.studies.campaign.conduct import conduct
from swarm.studies.campaign.study import load_study
from swarm.studies.campaign.task import is_wall_clock
from swarm.studies.layout.request import Request
from swarm.studies.layout.study import study as design_layout
from swarm.studies.papers import reproduce
from swarm.studies.papers.catalogue import EXPERIMENTS

KEPT = Path(__file__).with_suffix("")
REAL = Path(__file__).resolve().parents[2] / "shared" / "data" / "lighthouse-v1" / "lh1_test_cal.rec.gz"
"""A recording of a real lighthouse, where the machine has it."""
TOLERANCE = 0.02
"""On another machine: how far the rms of a value may be off, as a share of it, and its mean, as a share of the rms.

Rounding differs there in the last bit. Now and then that moves a sweep over the edge of a timer's tick, and a tick is a
good part of the angle noise; so single samples of a filter's error differ visibly, and behind a gate or a count of lit
photodiodes a sample more or less. Of a short flight's hundred samples that is a per cent. Values that are words or
counts of words are not compared there at all.
"""
EXACT_DIGITS = 16
WORDS = frozenset({"about"})
"""Values that are a text in which nothing rounds: compared in full on every machine."""


class Absent(Exception):
    """A case that this machine cannot compute, and why."""


# --- values -----------------------------------------------------------------------------------------------------------


class Value:
    """A growing hash, and the numbers behind it."""

    def __init__(self) -> None:
        self._sha = hashlib.sha256()
        self._count, self._sum, self._squares = 0, 0.0, 0.0

    def text(self, text: str) -> None:
        self._sha.update(f"{len(text)}:{text}".encode())

    def numbers(self, values: Any, figures: bool = True) -> None:
        """Type, shape and bytes; every NaN is the same one. figures: whether they count for mean and rms."""
        array = np.ascontiguousarray(values)
        self.text(f"{array.dtype.str}{array.shape}")
        if array.dtype.kind == "f":
            array = np.where(np.isnan(array), np.array(np.nan, array.dtype), array)
        self._sha.update(array.tobytes())
        if figures and array.dtype.kind in "fiub":
            known = array.astype(float).ravel()
            known = known[np.isfinite(known)]
            self._count += len(known)
            self._sum += float(known.sum())
            self._squares += float(known @ known)

    def arrow(self, array: Any) -> None:
        """An arrow array by its values: not by its chunks, its offset or what lies below a null."""
        if isinstance(array, pa.ChunkedArray):
            array = array.combine_chunks()
        kind = array.type
        if pa.types.is_dictionary(kind):
            array, kind = array.dictionary_decode(), kind.value_type
        if isinstance(array, pa.ExtensionArray):
            array, kind = array.storage, array.storage.type
        if array.null_count:
            self.numbers(array.is_null().to_numpy(zero_copy_only=False), figures=False)
        if pa.types.is_fixed_size_list(kind) or pa.types.is_list(kind) or pa.types.is_large_list(kind):
            length = pc.list_value_length(array).fill_null(-1).to_numpy(zero_copy_only=False)
            self.numbers(length.astype(np.int64), figures=False)
            self.arrow(array.flatten())
        elif pa.types.is_struct(kind):
            for field, inner in zip(kind, array.flatten(), strict=True):
                self.text(field.name)
                self.arrow(inner)
        elif pa.types.is_boolean(kind):
            self.numbers(array.fill_null(False).to_numpy(zero_copy_only=False).astype(bool))
        elif pa.types.is_integer(kind) or pa.types.is_floating(kind):
            self.numbers(array.fill_null(0).to_numpy(zero_copy_only=False))
        elif pa.types.is_temporal(kind):
            self.numbers(array.cast(pa.int64()).fill_null(0).to_numpy(zero_copy_only=False))
        else:
            self.text(repr(array.to_pylist()))

    def json(self, value: Any) -> None:
        """What JSON can say."""
        if isinstance(value, Mapping):
            for key in sorted(value):
                self.text(key)
                self.json(value[key])
        elif isinstance(value, list | tuple):
            self.text(f"[{len(value)}]")
            for inner in value:
                self.json(inner)
        elif isinstance(value, float):
            self.numbers(np.float64(value))
        else:
            self.text(repr(value))

    def take(self, other: "Value") -> None:
        """Another value becomes a part of this one."""
        self.text(other._sha.hexdigest())
        self._count += other._count
        self._sum += other._sum
        self._squares += other._squares

    def kept(self) -> str:
        digest = self._sha.hexdigest()[:EXACT_DIGITS]
        if not self._count:
            return digest
        mean, rms = self._sum / self._count, float(np.sqrt(self._squares / self._count))
        return f"{digest} {self._count} {mean:.9g} {rms:.9g}"


class Values(dict[str, str]):
    """What a case gives, by name."""

    def table(self, prefix: str, table: Any, leave_out: Iterable[str] = ()) -> None:
        """A value per column."""
        for name in table.column_names:
            if name not in leave_out:
                value = Value()
                value.arrow(table.column(name))
                self[f"{prefix}.{name}"] = value.kept()

    def tree(self, prefix: str, tree: Mapping[str, Any], leave_out: Iterable[str] = ()) -> None:
        """A value per key of a JSON object."""
        for name, inner in tree.items():
            if name not in leave_out:
                value = Value()
                value.json(inner)
                self[f"{prefix}.{name}"] = value.kept()

    def run(self, prefix: str, run: "swarm.Run") -> None:
        """All files of a run."""
        for file in ("telemetry", "angles", "scans"):
            if (run.folder / f"{file}.parquet").exists():
                self.table(f"{prefix}{file}", pq.read_table(run.folder / f"{file}.parquet"))
        summary = json.loads((run.folder / "summary.json").read_text(encoding="utf-8"))
        self.tree(f"{prefix}summary", summary, ("program", "version", "versions", "inputs"))


# --- flights ----------------------------------------------------------------------------------------------------------


class Flight(NamedTuple):
    """A scenario flown short. divide: every time in it is divided by so much. seeds: None is the file's own."""

    scenario: str
    duration_s: float
    overrides: tuple[str, ...] = ()
    divide: float = 1.0
    seeds: tuple[int | None, ...] = (None,)


BOTH = (None, 11)
TIMES = ("at_s", "until_s", "for_s", "start_s", "times_s", "hold_s", "failure_every_s", "failure_length_s")
DOCK_NEAR = (
    "craft[0].motion.from_m=[0.02, 0.44, 0.9]",
    "craft[0].motion.hold_ranges_m=[0.12, 0.04]",
    "craft[0].motion.hold_s=[0.0, 0.0]",
    "craft[0].motion.settle_s=0.1",
    "craft[0].motion.closing_speed_m_s=0.1",
    "craft[0].motion.glideslope_s=0.5",
    "craft[0].motion.speed_m_s=0.4",
    "craft[0].motion.acceleration_m_s2=0.4",
    "craft[0].scatter={position_m=0.005, velocity_m_s=0.001, attitude_deg=0.5}",
)
CCD_NEAR = ("craft[0].motion.from_m=[0.0, 2.5, 17.5]", "craft[0].motion.start_s=0.1")
OUTAGE = "craft[0].ccd.outages=[{camera='backup', from_m=12.5, to_m=12.1}]"
SHIPPED = {
    "ccd-docking": Flight("ccd-docking", 2.0, (*CCD_NEAR, OUTAGE)),
    "cloud": Flight("cloud", 0.3),
    "crossing": Flight("crossing", 1.6, divide=12.0),
    "docking": Flight("docking", 3.0, DOCK_NEAR),
    "drift": Flight("drift", 0.8),
    "fault-parade": Flight("fault-parade", 3.3, divide=12.0),
    "formation": Flight("formation", 1.0),
    "formation-reconfigure": Flight("formation-reconfigure", 2.0, ("swarm.motion.speed_m_s=3.0",), divide=40.0),
    "inspect-satellite": Flight("inspect-satellite", 1.0, divide=8.0),
    "inspection": Flight("inspection", 1.5),
    "orbit": Flight("orbit", 2.0, divide=30.0),
    "plate": Flight("plate", 1.2, divide=12.0),
    "rendezvous": Flight("rendezvous", 1.5, divide=10.0),
    "static": Flight("static", 0.8),
    "survey": Flight("survey", 1.5, divide=40.0),
    "swarm-inspect": Flight("swarm-inspect", 0.5, divide=4.0),
    "swarm1000": Flight("swarm1000", 0.085),
}
FREE = "attitude={yaw_deg=15, pitch_deg=10}"
FANS = (
    "lighthouse.fan_x={phase_rad=0.02, tilt_rad=-0.009, curve=0.002, gibbous_phase_rad=1.8, gibbous_magnitude=0.01}",
    "lighthouse.fan_y={phase_rad=-0.03, tilt_rad=0.008, curve=-0.002, gibbous_phase_rad=-1.2, gibbous_magnitude=0.009}",
)
RANDOM_FAULTS = (
    "[{kind='photodiode-dead', photodiodes=[1, 6], probability_per_s=0.8, for_s=0.3},"
    "{kind='photodiode-stuck', photodiodes=[2], probability_per_s=0.8, for_s=0.4},"
    "{kind='ghosts', share=0.1, probability_per_s=1.0, for_s=0.3},"
    "{kind='sync-loss', missed_sync_probability=0.6, probability_per_s=1.0, for_s=0.2},"
    "{kind='restart', probability_per_s=0.5, for_s=0.2},"
    "{kind='lighthouse-dark', probability_per_s=0.5, for_s=0.2},"
    "{kind='rotor-drift', speed_ppm=200, probability_per_s=0.5, for_s=0.5},"
    "{kind='craft-lost', probability_per_s=0.3, for_s=0.5, angular_rate_deg_s=[5, 9, -4]}]"
)


def _swarm_of(motion: str) -> tuple[str, ...]:
    return "swarm.count=3", f"swarm.motion={motion}"


EXTRA = {
    "filter-compiled": Flight("formation", 0.8, ("navigation.filter=compiled",)),
    "without-motion-compensation": Flight("formation", 0.8, ("navigation.motion_compensation=false",)),
    "feedback-estimate": Flight(
        "formation",
        1.0,
        (
            "swarm.feedback=estimate",
            "swarm.disturbance={acceleration_m_s2=0.05, angular_acceleration_deg_s2=5}",
            "swarm.scatter={position_m=0.02, velocity_m_s=0.01, attitude_deg=3, angular_rate_deg_s=1}",
        ),
    ),
    "motion-hold": Flight("drift", 0.4, _swarm_of(f"{{kind='hold', box_m=[2, 1, 1], {FREE}}}")),
    "motion-drift": Flight("drift", 0.4, _swarm_of(f"{{kind='drift', velocity_m_s=[0, 0.1, 0], {FREE}}}")),
    "motion-tumble": Flight("drift", 0.4, _swarm_of(f"{{kind='tumble', angular_rate_deg_s=[5, 20, 3], {FREE}}}")),
    "motion-wander": Flight("drift", 0.6, _swarm_of(f"{{kind='wander', {FREE}}}")),
    "motion-keep": Flight(
        "drift", 0.8, (*_swarm_of(f"{{kind='keep', separation_m=0.3, {FREE}}}"), "swarm.feedback=estimate")
    ),
    "motion-figures": Flight(
        "drift",
        1.2,
        (
            "orbit={altitude_km=500}",
            "swarm.count=4",
            "swarm.feedback=estimate",
            "swarm.motion={kind='formation', separation_m=0.2, speed_m_s=2.0, figures=["
            "{shape='ring', radius_m=0.6, rate_deg_s=5}, {at_s=0.3, shape='line', length_m=1.5, turn_deg=20},"
            "{at_s=0.6, shape='tetrahedron', radius_m=0.6}, {at_s=0.9, shape='projected-circle', radius_m=0.7}]}",
        ),
    ),
    "poor-lighthouse": Flight(
        "formation",
        1.0,
        (
            *FANS,
            "lighthouse.mounting_error_mm=0.5",
            "lighthouse.sync_jitter_ns=50",
            "lighthouse.stray_pulse_rate_hz=200",
            "lighthouse.missed_sync_probability=0.05",
            "lighthouse.lost_pulse_probability=0.05",
            "navigation.angle_noise_arcsec=100",
            "recording.angles=true",
        ),
    ),
    "ccd-and-lighthouse": Flight(
        "ccd-docking", 1.0, (*CCD_NEAR, OUTAGE, "craft[0].lighthouse=true", "craft[0].ccd.mounting_error_mm=0.5")
    ),
    "ccd-closed-form": Flight(
        "ccd-docking",
        1.2,
        (
            *CCD_NEAR,
            "craft[0].ccd.solution=closed-form",
            "craft[0].ccd.outages=[{camera='main', from_m=12.55, to_m=12.4}]",
            "craft[0].ccd.failure_every_s=0.5",
            "craft[0].ccd.failure_length_s=0.1",
            "craft[0].ccd.lost_image_probability=0.02",
            "craft[0].ccd.resolution_um=0.5",
            # An estimate by this solution is so wide in depth that what steers by it feeds its rounding back.
            "craft[0].feedback=truth",
        ),
    ),
    "random-faults": Flight("formation", 1.5, ("swarm.feedback=estimate", f"fault={RANDOM_FAULTS}")),
    "reflection-outshines": Flight(
        "fault-parade",
        0.6,
        ("fault=[{kind='reflection', outshines=true, at_s=0.1}, {kind='thruster-stuck', craft='inspector', thruster=1, "
         "state='on', probability_per_s=3.0, for_s=0.2}]",),
        divide=12.0,
    ),
}  # fmt: skip
COSTLY = ("ccd-docking", "formation-reconfigure", "inspect-satellite", "swarm-inspect", "swarm1000")
"""Flown with one seed only; with the other one by --long."""
FLIGHTS = {name: f if name in COSTLY else f._replace(seeds=BOTH) for name, f in SHIPPED.items()} | EXTRA
LONG = {
    f"{name}-long": Flight(name, duration_s, overrides)
    for name, duration_s, overrides in (
        ("ccd-docking", 50.0, ()),
        ("cloud", 2.0, ()),
        ("crossing", 20.0, ()),
        ("docking", 55.0, ()),
        ("drift", 5.0, ()),
        ("fault-parade", 40.0, ("recording.angles=true",)),
        ("formation", 10.0, ("recording.angles=true",)),
        ("formation-reconfigure", 40.0, ()),
        ("inspect-satellite", 10.0, ()),
        ("inspection", 40.0, ()),
        ("orbit", 30.0, ()),
        ("rendezvous", 36.0, ()),
        ("static", 10.0, ()),
        ("survey", 30.0, ()),
        ("swarm-inspect", 6.0, ()),
        ("swarm1000", 1.0, ()),
    )
} | {f"{name}-11": SHIPPED[name]._replace(seeds=(11,)) for name in COSTLY}


def _divided(tree: Any, by: float, path: str = "") -> Iterator[str]:
    """Overrides that divide every time in a scenario's TOML."""
    entries = tree.items() if isinstance(tree, dict) else enumerate(tree) if isinstance(tree, list) else ()
    for key, inner in entries:
        at = f"{path}[{key}]" if isinstance(key, int) else f"{path}.{key}" if path else key
        if key in TIMES:
            times = [t / by for t in inner] if isinstance(inner, list) else inner / by
            yield f"{at}={times}"
        elif path or key in ("swarm", "craft", "fault"):
            yield from _divided(inner, by, at)


def _load(flight: Flight, seed: int | None, *more: str) -> "swarm.Scenario":
    overrides = [f"duration_s={flight.duration_s}"]
    if flight.divide != 1.0:
        text = assets.scenarios()[flight.scenario].read_text(encoding="utf-8")
        overrides += _divided(tomllib.loads(text), flight.divide)
    return swarm.load(flight.scenario, [*overrides, *flight.overrides, *more], seed)


def _fly(flight: Flight, folder: Path) -> Values:
    values = Values()
    for seed in flight.seeds:
        more = () if seed is None else ("recording.angles=true",)
        run = swarm.simulate(_load(flight, seed, *more), out=folder / f"run-{seed}", record=False)
        values.run("" if seed is None else f"seed-{seed}/", run)
    return values


# --- recordings -------------------------------------------------------------------------------------------------------

RECORDED = {
    "recording-formation": Flight("formation", 1.2),
    "recording-ccd": Flight("ccd-docking", 1.2, (*CCD_NEAR, OUTAGE)),
    "recording-lidar": Flight("inspect-satellite", 0.7, divide=8.0),
    "recording-crowd": Flight("cloud", 0.6, ("swarm.count=40",)),
}


class _Spy:
    """Sees what a recording sends, per entity in order; the order among entities means nothing to the viewer."""

    def __init__(self) -> None:
        self.data: dict[str, Value] = {}
        self._blueprint = False

    def _of(self, what: str, entity: str) -> Value:
        value = self.data.setdefault(entity, Value())
        value.text(f"{what} {entity}")
        return value

    def kept(self) -> Values:
        """The entities of a kind, such as world/craft, together."""
        kinds: dict[str, Value] = {}
        for entity in sorted(self.data):
            kinds.setdefault("/".join(entity.split("/")[:2]), Value()).take(self.data[entity])
        return Values({kind: value.kept() for kind, value in kinds.items()})

    @contextmanager
    def watching(self) -> Iterator[None]:
        import rerun as rr

        stream = rr.RecordingStream
        log, send_columns, send_blueprint = stream.log, stream.send_columns, stream.send_blueprint

        def spied_log(this: Any, entity: str, what: Any, *more: Any, **options: Any) -> None:
            if self._blueprint:
                log(this, entity, what, *more, **options)
                return
            value = self._of("log", entity)
            value.text(f"{len(more)} {sorted(options.items())}")
            for batch in what.as_component_batches():
                value.text(str(batch.component_descriptor()))
                value.arrow(batch.as_arrow_array())
            log(this, entity, what, *more, **options)

        def spied_columns(this: Any, entity: str, indexes: Any, columns: Any, **options: Any) -> None:
            value, indexes, columns = self._of("columns", entity), list(indexes), list(columns)
            for index in indexes:
                value.text(index.timeline_name())
                value.arrow(index.as_arrow_array())
            for column in columns:
                value.text(str(column.component_descriptor()))
                value.arrow(column.as_arrow_array())
            send_columns(this, entity, indexes, columns, **options)

        def spied_blueprint(this: Any, *arguments: Any, **options: Any) -> None:
            # What is logged meanwhile is the blueprint's, under names drawn by chance.
            self._of("blueprint", "blueprint")
            self._blueprint = True
            try:
                send_blueprint(this, *arguments, **options)
            finally:
                self._blueprint = False

        with (
            mock.patch.object(stream, "log", spied_log),
            mock.patch.object(stream, "send_columns", spied_columns),
            mock.patch.object(stream, "send_blueprint", spied_blueprint),
        ):
            yield


def _record(flight: Flight, folder: Path) -> Values:
    spy = _Spy()
    with spy.watching():
        swarm.simulate(_load(flight, None), out=folder / "run")
    return spy.kept()


# --- what else computes -----------------------------------------------------------------------------------------------

SMALLEST = {
    "lighthouse-static": {"poses": 3, "frames": 100},
    "lighthouse-dynamic": {"runs": 1, "seconds": 2},
    "lighthouse-error-budget": {"draws": 3, "poses": 3},
    "stereo-accuracy": {"poses": 4},
    "stereo-mounting": {"poses": 64},
    "stereo-noise": {"poses": 40, "draws": 30},
    "stereo-baseline": {"draws": 1000},
    "stereo-fallback": {"runs": 1},
    "lidar-acquisition": {"poses": 1, "draws": 1},
    "lidar-tracking": {"runs": 1, "frames": 3},
    "lidar-turn": {"poses": 3},
    "lidar-shapes": {"draws": 1},
    "beside": {"draws": 50},
}


def _experiment(name: str, folder: Path) -> Values:
    reproduce(name, out=folder / "out", sizes=SMALLEST[name])
    values = Values()
    values.table("data", pq.read_table(folder / "out" / "data.parquet"))
    comparison = json.loads((folder / "out" / "comparison.json").read_text(encoding="utf-8"))
    values.tree("comparison", comparison, ("program", "version", "versions", "status", "sample"))
    return values


def _study(folder: Path) -> Values:
    (folder / "tiny.toml").write_text(
        'base = "cloud"\nseeds = 1\nmeasure = ["onboard", "central", "first_craft"]\n'
        'overrides = ["duration_s=0.2"]\n[grid]\n"swarm.count" = [2, 5]\n'
    )
    rows = conduct(load_study(folder / "tiny.toml"), out=folder / "out", serial=True).rows
    values = Values()
    values.table("rows", rows, ("key", *filter(is_wall_clock, rows.column_names)))
    return values


def _layout(folder: Path) -> Values:
    request = Request("mockup", photodiodes=6, distance_m=(2.0,), cone_deg=40.0, off_axis_deg=10.0)
    made = design_layout(request, folder / "mockup.xml", False, lambda text: None)
    values = Values()
    values.tree("layout", made.figures)
    sites = re.findall(r"<site [^>]*>", (folder / "mockup.xml").read_text(encoding="utf-8"))
    values.tree("model", {"sites": sites})
    return values


def _calibration(folder: Path) -> Values:
    overrides = (
        "duration_s=4",
        "swarm.motion.points_m=[[0,0,1.3],[1.2,0.9,1.5],[-1.1,1.0,1.3],[-1.3,-1.1,1.7],[1.2,-1.1,1.2],[0.1,0,2.2]]",
        "swarm.motion.times_s=[0.0,0.8,1.6,2.4,3.2,4.0]",
        "swarm.motion.attitude.spin_deg_s=150",
    )
    run = swarm.simulate(swarm.load("survey", overrides), out=folder / "run", record=False)
    values = Values()
    seen = swarm.observe_run(run.folder)
    for how in ("truth", "own"):
        found = swarm.calibrate_survey(seen, how)
        for part, of in (("result", found.result), ("before", found.before), ("after", found.after)):
            for name, array in _arrays(of):
                value = Value()
                value.numbers(array)
                values[f"{how}/{part}.{name}"] = value.kept()
    return values


def _arrays(record: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    """Everything that is a number in a record of records, by name."""
    for name in getattr(record, "_fields", ()):
        inner = getattr(record, name)
        if hasattr(inner, "_fields"):
            yield from _arrays(inner, f"{path}{name}.")
        elif isinstance(inner, np.ndarray | float | int):
            yield f"{path}{name}", np.asarray(inner)


def _replay(object_name: str, source: Any, folder: Path) -> Values:
    if not REAL.exists():
        raise Absent(f"there is no {REAL}")
    settings = for_replay(REAL, ["recording.angles=true"])
    out = folder / "run"
    run = swarm.replay(
        REAL, object_name=object_name, lighthouse=0, source=source, scenario=settings, out=out, record=False
    )
    values = Values()
    values.run("", run)
    return values


REST: dict[str, Callable[[Path], Values]] = {
    **{name: partial(_record, flight) for name, flight in RECORDED.items()},
    **{f"experiment-{name}": partial(_experiment, name) for name in EXPERIMENTS},
    "study": _study,
    "calibration": _calibration,
    **{
        f"replay-{name}-{source}": partial(_replay, name, source)
        for name in ("HMD", "T20")
        for source in ("pulses", "angles")
    },
}
LONG_REST: dict[str, Callable[[Path], Values]] = {
    "layout": _layout,
    **{
        f"experiment-{name}": REST.pop(f"experiment-{name}")
        for name in ("lighthouse-dynamic", "stereo-fallback", "stereo-noise", "lidar-turn", "lidar-shapes")
    },
}
"""Costly as small as they can be, or close to what another case computes."""


# --- keeping and comparing --------------------------------------------------------------------------------------------


def machine() -> dict[str, str]:
    """What bits depend on beside the code."""
    try:
        about = dict(re.findall(r"^(model name|flags)\s*: (.*)$", Path("/proc/cpuinfo").read_text(), re.MULTILINE))
    except OSError:
        about = {}
    flags = hashlib.sha256(" ".join(sorted(about.get("flags", "").split())).encode()).hexdigest()[:16]
    packages = ("numpy", "scipy", "numba", "llvmlite", "mujoco", "filterpy", "pyarrow", "rerun-sdk", "matplotlib")
    return {
        "processor": f"{about.get('model name', platform.processor())}, flags {flags}",
        "python": platform.python_version(),
        **{package: _version(package) for package in packages},
        **{name: os.environ.get(name, "") for name in ("OPENBLAS_CORETYPE", "NUMBA_CPU_NAME", "NUMBA_CPU_FEATURES")},
    }


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return ""


def compute(case: str) -> Values:
    """The values of a case, now. Raises Absent."""
    with tempfile.TemporaryDirectory(prefix="golden-") as place:
        if case in REST or case in LONG_REST:
            return (REST | LONG_REST)[case](Path(place))
        return _fly((FLIGHTS | LONG)[case], Path(place))


def _file(case: str) -> Path:
    return KEPT / ("long" if case in LONG or case in LONG_REST else "") / f"{case}.json"


def keep(case: str) -> None:
    """Keep what the case gives now."""
    content = {"machine": machine(), "values": compute(case)}
    _file(case).parent.mkdir(exist_ok=True)
    _file(case).write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")


class Verdict(NamedTuple):
    """differences: a line each. exact: whether bits were compared, or only figures."""

    differences: list[str]
    exact: bool


def check(case: str) -> Verdict:
    """Compare the case with what is kept. Raises Absent."""
    if not _file(case).exists():
        return Verdict([f"nothing is kept: python -m tests.golden --update {case}"], True)
    kept = json.loads(_file(case).read_text(encoding="utf-8"))
    now, then, exact = compute(case), kept["values"], kept["machine"] == machine()
    lines = [f"{name}: is new" for name in now if name not in then]
    lines += [f"{name}: is missing" for name in then if name not in now]
    for name in then:
        same = _equal if exact or name in WORDS else alike
        if name in now and not same(then[name], now[name]):
            lines.append(f"{name}: {then[name]} was kept, now {now[name]}")
    return Verdict(lines, exact)


def _equal(then: str, now: str) -> bool:
    return then.split()[0] == now.split()[0]


def alike(then: str, now: str) -> bool:
    """Within `TOLERANCE`."""
    before, after = ([float(x) for x in text.split()[1:]] for text in (then, now))
    if not before or not after:
        return bool(before) == bool(after)
    (n, mean, rms), (m, new_mean, new_rms) = before, after
    room = TOLERANCE * rms + 1e-12
    return abs(m - n) <= max(2, TOLERANCE * n) and abs(new_mean - mean) <= room and abs(new_rms - rms) <= room


def other_machine(case: str) -> str:
    """What differs from the machine that the case was kept on; empty: nothing."""
    then, now = json.loads(_file(case).read_text(encoding="utf-8"))["machine"], machine()
    return "; ".join(f"{k}: {then.get(k)!r} then, {now.get(k)!r} here" for k in now if then.get(k) != now[k])


def demand(case: str) -> None:
    """As a test: fails where something differs, is skipped where the machine cannot compute it."""
    import pytest

    try:
        verdict = check(case)
    except Absent as reason:
        pytest.skip(str(reason))
    if verdict.differences:
        how = "bit for bit" if verdict.exact else f"within {100 * TOLERANCE:.0f} %, as {other_machine(case)}"
        pytest.fail("\n".join([f"{case}, compared {how}:", *verdict.differences]), pytrace=False)
    if not verdict.exact:
        print(f"{case}: only figures compared, within {100 * TOLERANCE:.0f} %: {other_machine(case)}")


def main() -> int:
    """The command; 1 where something differs."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("case", nargs="*")
    parser.add_argument("--update", action="store_true", help="keep what is computed now")
    parser.add_argument("--long", action="store_true", help="the longer flights too")
    parser.add_argument("--list", action="store_true", help="print the names and stop")
    asked = parser.parse_args()
    cases = [*FLIGHTS, *REST, *([*LONG_REST, *LONG] if asked.long else ())]
    if unknown := set(asked.case) - {*FLIGHTS, *REST, *LONG, *LONG_REST}:
        parser.error(f"no case {', '.join(sorted(unknown))}; --list shows them")
    cases = asked.case or cases
    if asked.list:
        print("\n".join(cases))
        return 0
    different = inexact = 0
    began = time.process_time()
    for case in cases:
        start = time.process_time()
        try:
            if asked.update:
                keep(case)
                verdict = None
            else:
                verdict = check(case)
        except Absent as reason:
            print(f"{case}: left out: {reason}")
            continue
        except Exception as error:
            print(f"{case}: failed: {type(error).__name__}: {error}", flush=True)
            different += 1
            continue
        spent = f"{time.process_time() - start:.1f} s"
        if verdict is None:
            print(f"{case}: kept ({spent})", flush=True)
            continue
        word = (
            f"{len(verdict.differences)} differences" if verdict.differences else "equal" if verdict.exact else "alike"
        )
        print(f"{case}: {word} ({spent})", flush=True)
        for line in verdict.differences:
            print(f"    {line}")
        different += bool(verdict.differences)
        inexact += not verdict.exact
    if inexact:
        print(f"{inexact} cases were kept on another machine ({other_machine(cases[0])}):")
        print(f"only counts, means and rms were compared, within {100 * TOLERANCE:.0f} %")
    print(f"{len(cases)} cases, {different} different, {time.process_time() - began:.0f} s of CPU")
    return int(different > 0)


if __name__ == "__main__":
    sys.exit(main())
