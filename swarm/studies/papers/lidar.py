"""The bench of source 3's experiments: a satellite on a turntable, and a 16-line LiDAR that looks at it.

Everything is in the scanner's frame s, x towards the turntable, z up. The satellite's centre is 5 m away; at zero it
turns its top, with dish and panels, to the scanner (body z against s's x, body y along s's y). The turntable turns it
by

    R_s_t = Rz(yaw) Ry(pitch) Rx(roll) R_0                                                              (1)

The scans are cast by MuJoCo at the real meshes (`swarm.sensors.lidar`), with noise, jitter and drop-outs.
"""

from pathlib import Path

import numpy as np

from estimators import rotation as rot
from estimators.arrays import Bools, Floats
from estimators.lidar.feature_templates import Templates, from_angles_zyx
from estimators.lidar.scan import Scan
from estimators.lidar.shape import Shape
from swarm import scenario
from swarm.assets import find_model
from swarm.onboard.lidar import rays
from swarm.sensors.lidar import Lidar, Mount
from swarm.world.surface import known_shape
from swarm.world.world import CraftStart, World

DISTANCE_M = 5.0
AT_ZERO = np.array([[0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]])
"""R_0: body z towards the scanner, body y sideways."""
SCANNER = scenario.Lidar(target="target", horizontal_field_deg=60.0)
"""The scanner: the rest of its turn sees nothing here."""
SIX_VIEWS = np.array([[0, 0, 0], [0, 1, 0], [0, 2, 0], [0, 3, 0], [1, 0, 0], [-1, 0, 0]]) * np.pi / 2
"""Rotation vectors by which the reference cloud's six scans are turned."""
_SCANNER_M = np.array([0.0, 0.0, 30.0])


class Turntable:
    """One scanner and one target; every scan has draws of its own."""

    def __init__(
        self,
        seed: int,
        model: str | Path = "satellite",
        scanner: scenario.Lidar = SCANNER,
        distance_m: float = DISTANCE_M,
    ) -> None:
        """Build the world of scanner and target.

        Args:
            seed: Seed of the scanner's draws.
            model: Name or file of the target's model.
            scanner: The LiDAR's settings; default: the paper's, with a field of 60 deg.
            distance_m: Distance of the target's centre from the scanner [m].
        """
        path = find_model(model)
        self.shape: Shape = known_shape(path)
        self.position: Floats = np.array([distance_m, 0.0, 0.0])
        still = np.zeros(3)
        upright = np.array([1.0, 0.0, 0.0, 0.0])
        away = _SCANNER_M + np.array([0.0, 0.0, 50.0 + 5 * distance_m])
        world = World(
            [
                CraftStart("scanner", find_model("inspector"), _SCANNER_M, upright, still, still),
                CraftStart("target", path, away, upright, still, still, passive=True),
            ],
            find_model("lighthouse"),
        )
        site = world.lidars[0]
        assert site is not None
        self._mount = Mount(0, *site)
        self._lidar = Lidar(world.model, world.craft_bodies, [self._mount], scanner, seed, [0])
        self._pattern = self._lidar.pattern(0)

    def scan(self, rotation: Floats) -> Scan:
        """Scan the target at rest, turned by `rotation` (3, 3) R_s_t."""
        # The scanner's body is upright: its frame is the world's, but for the mount.
        body = self._mount.rotation
        place = _SCANNER_M + self._mount.position + body @ self.position
        turn = rot.quaternion_from_matrix(np.stack([np.eye(3), body @ rotation]))
        return rays(self._lidar.still(np.stack([_SCANNER_M, place]), turn)[0], self._pattern)

    def reference(self) -> Floats:
        """Return the paper's reference cloud: scans from six sides merged, (n, 3) [m], in the target's frame."""
        clouds = [(self.scan(turn).point - self.position) @ turn for turn in rot.exp(SIX_VIEWS) @ AT_ZERO]
        return np.concatenate(clouds)

    def templates(self) -> Templates:
        """Return the paper's templates, made of the reference cloud."""
        return Templates(self.reference())


def turned(angles_deg: Floats) -> Floats:
    """Return R_s_t (..., 3, 3) of the turntable at (roll, pitch, yaw) [deg] (..., 3)."""
    out: Floats = from_angles_zyx(np.radians(angles_deg)) @ AT_ZERO
    return out


def error_deg(true: Floats, found: Floats) -> Floats:
    """Return the angles [deg] between attitudes (..., 3, 3), NaN where none was found."""
    known: Bools = np.asarray(np.isfinite(found).all(axis=(-2, -1)))
    filled = np.where(known[..., None, None], found, np.eye(3))
    out: Floats = np.where(known, np.degrees(rot.angle_between(true, filled)), np.nan)
    return out
