"""The lighthouse: its body, its field, its axes, and two fans that turn as the real ones do, slowed down.

The fans are one branch of the viewer's tree, `world/fans`, whose eye switches them off.
"""

import numpy as np
import rerun as rr

from estimators.arrays import Bools, Floats
from swarm.results.recording import drawing
from swarm.results.recording.batch import Batch
from swarm.results.recording.canvas import Canvas, Send, ink, mesh
from swarm.results.recording.layer import Stage

FAN_TURN_S, REAL_FAN_TURN_S = 4.0, 1 / 60
SPOKES = 8
"""One of so many corners of a fan's rim is joined with the lighthouse."""


class Lighthouse:
    """world/lighthouse; world/fans."""

    def __init__(self, stage: Stage) -> None:
        self._stage, self._field_rad = stage, float(np.radians(stage.scene.field_deg))
        self._first: Send | None = None

    def begin(self, canvas: Canvas) -> None:
        """Draw the body, the field, the axes and the fans' sectors."""
        reach_m = self._stage.reach_m
        if (body := drawing.solid(self._stage.scene.lighthouse)) is not None:
            canvas.static("world/lighthouse/body", mesh(body))
        strips = drawing.field(self._field_rad, 0.06 * reach_m)
        canvas.static("world/lighthouse/field", rr.LineStrips3D(strips, colors=[0xB0BEC560], radii=-0.6))
        axes, inks = 0.08 * reach_m * np.eye(3), ink(0xEF5350FF, 0x66BB6AFF, 0x42A5F5FF)
        canvas.static("world/lighthouse/axes", rr.Arrows3D(vectors=axes, colors=inks, radii=0.003 * reach_m))
        vertex, face = drawing.fan(self._field_rad, reach_m)
        for fan, points, colour in (("x", vertex, 0xFF8A6501), ("y", vertex[:, [1, 0, 2]], 0x4FC3F701)):
            light = rr.Mesh3D(vertex_positions=points, triangle_indices=face, albedo_factor=colour)
            canvas.static(f"world/fans/{fan}/light", light)
            strip = np.roll(points, -1, axis=0).astype(np.float32)
            spokes = [points[[0, k]].astype(np.float32) for k in range(1 + SPOKES, len(points) - 1, SPOKES)]
            inks = ink(colour | 0x60, *[colour | 0x28] * len(spokes))
            canvas.static(f"world/fans/{fan}/rim", rr.LineStrips3D([strip, *spokes], colors=inks, radii=-0.5))
        if 0 < self._stage.begin_s < 0.1:
            # The timeline begins with the run, not with the middle of its first period.
            self._first = canvas.at(np.zeros(1), np.zeros(1, dtype=np.int64))

    def send(self, send: Send, batch: Batch) -> None:
        """Turn the fans."""
        if self._first is not None:
            self._turn(self._first, np.zeros(1), batch.dark[:1])
            self._first = None
        self._turn(send, batch.time_s, batch.dark)

    def _turn(self, send: Send, time_s: Floats, dark: Bools) -> None:
        """Draw the fans at times (n,) [s], none where it is dark (n,).

        Sweep angle a from boresight: x/z = -tan a is a turn of -a about Y, y/z = -tan a one of a about X.
        """
        turns = time_s / FAN_TURN_S
        for fan, offset, axis, sign in (("x", 0.25, 1, -1.0), ("y", 0.75, 0, 1.0)):
            a = 2 * np.pi * ((turns - offset + 0.5) % 1 - 0.5)
            quaternion = np.zeros((len(a), 4))
            quaternion[:, axis], quaternion[:, 3] = np.sin(sign * a / 2), np.cos(a / 2)
            hidden = dark | (np.abs(a) > self._field_rad / 2)
            at = np.where(hidden[:, None], np.nan, np.zeros((len(a), 3)))
            send(f"world/fans/{fan}", rr.Transform3D.columns(translation=at, quaternion=quaternion))
