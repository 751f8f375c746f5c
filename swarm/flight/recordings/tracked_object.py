"""Configuration of a tracked object: the positions of its photodiodes, their channels, and the pose of its head.

It is the JSON of a libsurvive recording's CONFIG line, as the manufacturer stored it in the object. Model frame b: that
of `modelPoints` [m]. libsurvive outputs poses of the head frame h, which is given either as the quaternion (x, y, z, w)
and position of `trackref_from_head`, or as the axes and position of `head`; without either, h is b.
"""

from typing import Any, NamedTuple

import numpy as np

from estimators import rotation as rot
from estimators.arrays import Floats
from swarm.errors import SwarmError, did_you_mean
from swarm.flight.recordings.imu_lines import ImuMount, imu_mount
from swarm.user_text import parse_json, short


class TrackedObject(NamedTuple):
    """One tracked object.

    point_m: positions of the photodiodes, (K, 3) [m]. normal: unit normals, (K, 3). channels: channel of each, (K,).
    head_rotation: R_b_h, (3, 3). head_position: of the head in the model frame, (3,) [m]. imu: its gyroscope and
    accelerometer, None where CONFIG does not tell where they sit.
    """

    point_m: Floats
    normal: Floats
    channels: list[int]
    head_rotation: Floats
    head_position: Floats
    imu: ImuMount | None


def read_config(text: str, where: str) -> TrackedObject:
    """Read a CONFIG line's JSON; `where` opens every error message.

    Raises:
        SwarmError: the JSON is damaged, or a key is missing or invalid; the message names the key and the mistake.
    """
    config = parse_json(text, where)
    table = config.get("lighthouse_config") if isinstance(config, dict) else None
    if not isinstance(config, dict) or not isinstance(table, dict):
        near = did_you_mean("lighthouse_config", config) if isinstance(config, dict) else ""
        raise SwarmError(f"{where} has no table lighthouse_config{near}")
    point = _numbers(table, "modelPoints", (-1, 3), where)
    normal = _numbers(table, "modelNormals", (len(point), 3), where)
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    if np.any(length < 0.5):
        raise SwarmError(f"{where}: modelNormals[{int(np.argmin(length))}] is no direction")
    channels = table.get("channelMap", list(range(len(point))))
    whole = isinstance(channels, list) and all(isinstance(c, int) and not isinstance(c, bool) for c in channels)
    if not whole or len(set(channels)) != len(channels) or len(channels) != len(point):
        raise SwarmError(
            f"{where}: channelMap must be {len(point)} different whole numbers, not {short(str(channels))}"
        )
    return TrackedObject(point, normal / length, channels, *_head(config, where), _imu(config, where))


def _head(config: dict[str, Any], where: str) -> tuple[Floats, Floats]:
    """Return R_b_h (3, 3) and the head's position (3,) [m]."""
    return _pose(config, "head", where) or (np.eye(3), np.zeros(3))


def _imu(config: dict[str, Any], where: str) -> ImuMount | None:
    """Return the inertial sensors; None where CONFIG does not tell where they sit, or nothing that makes sense."""
    try:
        pose = _pose(config, "imu", where)
    except SwarmError:
        return None
    return None if pose is None else imu_mount(config, pose)


def _pose(config: dict[str, Any], name: str, where: str) -> tuple[Floats, Floats] | None:
    """Return the rotation to the model frame (3, 3) of a part of the object and its position (3,) [m], if it is there.

    Args:
        config: the JSON of CONFIG.
        name: of the part, "head" or "imu".
        where: opens the message.

    Raises:
        SwarmError: what is there is no pose.
    """
    key = f"trackref_from_{name}"
    if key in config:
        values = _numbers(config, key, (7,), where)
        quaternion = rot.wxyz_from_xyzw(values[:4])
        return rot.matrix_from_quaternion(quaternion / _length(quaternion, key, where)), values[4:]
    head = config.get(name)
    if not isinstance(head, dict):
        return None
    x, z = (_numbers(head, key, (3,), where) for key in ("plus_x", "plus_z"))
    x, z = x / _length(x, "plus_x", where), z / _length(z, "plus_z", where)
    if abs(x @ z) > 1e-2:
        raise SwarmError(f"{where}: {name}'s plus_x and plus_z must be at right angles, their product is {x @ z:.3g}")
    axes = np.column_stack([x, np.cross(z, x), z])
    # The nearest rotation: stored axes are at right angles to some 1e-8 only.
    return rot.mean_rotation(axes[None]), _numbers(head, "position", (3,), where)


def _length(vector: Floats, key: str, where: str) -> float:
    length = float(np.linalg.norm(vector))
    if abs(length - 1) > 1e-2:
        raise SwarmError(f"{where}: {key} must have length 1, not {length:.3g}")
    return length


def _numbers(table: dict[str, Any], key: str, shape: tuple[int, ...], where: str) -> Floats:
    """Return the finite numbers under a key, of a shape in which -1 stands for any size."""
    if key not in table:
        raise SwarmError(f"{where} has no {key}{did_you_mean(key, table)}")
    try:
        values = np.array(table[key], dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        values = np.empty(0)
    fits = values.ndim == len(shape) and all(s in (-1, v) for s, v in zip(shape, values.shape, strict=True))
    if not fits or not np.isfinite(values).all():
        wanted = " x ".join("n" if s == -1 else str(s) for s in shape)
        raise SwarmError(f"{where}: {key} must be {wanted} finite numbers")
    return values
