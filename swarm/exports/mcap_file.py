"""An MCAP file of a run, for Foxglove and other readers of MCAP: poses and transforms as JSON, by the library `mcap`.

Per craft and source a topic `/CRAFT/SOURCE` of `foxglove.PoseInFrame`, and on `/tf` `foxglove.FrameTransform` from the
frame `lighthouse` to `CRAFT/SOURCE`; times are those of the run, from its epoch on where one is given. The scenario and
the summary are attachments. The only file that imports mcap.
"""

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from estimators.rotation import xyzw_from_wxyz
from swarm.errors import SwarmError
from swarm.exports.trajectory import Trajectory
from swarm.results.run_folder import Run

FRAME = "lighthouse"
_TIME = {"type": "object", "properties": {"sec": {"type": "integer"}, "nsec": {"type": "integer"}}}


def _vector(axes: str) -> dict[str, Any]:
    return {"type": "object", "properties": {axis: {"type": "number"} for axis in axes}}


SCHEMAS = {
    "foxglove.PoseInFrame": {
        "timestamp": _TIME,
        "frame_id": {"type": "string"},
        "pose": {"type": "object", "properties": {"position": _vector("xyz"), "orientation": _vector("xyzw")}},
    },
    "foxglove.FrameTransform": {
        "timestamp": _TIME,
        "parent_frame_id": {"type": "string"},
        "child_frame_id": {"type": "string"},
        "translation": _vector("xyz"),
        "rotation": _vector("xyzw"),
    },
}
"""Properties of the messages, as JSON schemas, by the names that Foxglove knows."""
ATTACHED = ("scenario.toml", "summary.json")


def check_library() -> None:
    """Raise SwarmError where the library is not installed."""
    try:
        import mcap  # noqa: F401
    except ImportError:
        raise SwarmError("--to mcap needs the library mcap: pip install '.[mcap]' in the clone") from None


def write_mcap(file: Path, run: Run, trajectories: Sequence[Trajectory], unix_ns: Callable[[float], int]) -> None:
    """Write the file.

    Args:
        file: Where to write it.
        run: The run.
        trajectories: What it contains.
        unix_ns: The nanoseconds of a file's time so many seconds after the start.
    """
    from mcap.writer import Writer

    with file.open("wb") as stream:
        writer: Any = Writer(stream)
        writer.start(profile="", library="lighthouse-swarm")
        schemas = {
            name: writer.register_schema(name, "jsonschema", json.dumps(_schema(name, properties)).encode())
            for name, properties in SCHEMAS.items()
        }
        transforms = writer.register_channel("/tf", "json", schemas["foxglove.FrameTransform"])
        poses = [
            writer.register_channel(f"/{one.craft}/{one.source}", "json", schemas["foxglove.PoseInFrame"])
            for one in trajectories
        ]
        rows = [_rows(one, unix_ns) for one in trajectories]
        order = sorted((row[0], i, n) for i, each in enumerate(rows) for n, row in enumerate(each))
        for log_time, i, n in order:
            stamp = {"sec": log_time // 1_000_000_000, "nsec": log_time % 1_000_000_000}
            position, orientation = rows[i][n][1:]
            child = f"{trajectories[i].craft}/{trajectories[i].source}"
            pose = {"timestamp": stamp, "frame_id": FRAME, "pose": {"position": position, "orientation": orientation}}
            frames = {"timestamp": stamp, "parent_frame_id": FRAME, "child_frame_id": child}
            for channel, message in (
                (poses[i], pose),
                (transforms, {**frames, "translation": position, "rotation": orientation}),
            ):
                data = json.dumps(message).encode()
                writer.add_message(channel, log_time=log_time, publish_time=log_time, data=data, sequence=n)
        for name in ATTACHED:
            if (run.folder / name).is_file():
                content = (run.folder / name).read_bytes()
                kind = "application/json" if name.endswith(".json") else "application/toml"
                writer.add_attachment(create_time=0, log_time=0, name=name, media_type=kind, data=content)
        writer.finish()


def _schema(name: str, properties: dict[str, Any]) -> dict[str, Any]:
    return {"title": name, "type": "object", "properties": properties}


def _rows(trajectory: Trajectory, unix_ns: Callable[[float], int]) -> list[tuple[int, Any, Any]]:
    """Return time [ns], position and orientation of each pose, the last two as Foxglove writes them."""
    return [
        (unix_ns(time_s), dict(zip("xyz", position, strict=True)), dict(zip("xyzw", quaternion, strict=True)))
        for time_s, position, quaternion in zip(
            trajectory.time_s.tolist(),
            trajectory.position.tolist(),
            xyzw_from_wxyz(trajectory.quaternion).tolist(),
            strict=True,
        )
    ]
