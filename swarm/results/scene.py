"""The scene of a run, which does not change, and the interface of a recording, with a null object.

`swarm.results.recording.recording` draws it with rerun, which is imported only by those who record.
"""

from collections.abc import Sequence
from typing import NamedTuple, Protocol

import numpy as np

from estimators.arrays import Floats
from swarm.hardware import Photodiodes
from swarm.results.period import Period
from swarm.results.records import Equipment, Errors
from swarm.world.shapes import Mesh

Visual = tuple[Mesh, Floats]
"""One coloured part of a thing: its mesh [m] in the thing's own frame, and rgba (4,) in 0..1."""


class CcdScene(NamedTuple):
    """One pair of cameras, as drawn: craft and target by index, pinhole_m (2, 3) and rotation (2, 3, 3) R_b_c in the
    craft's body frame, light_m (L, 3) in the target's; field_rad: full width of their field.
    """

    craft: int
    target: int
    pinhole_m: Floats
    rotation: Floats
    light_m: Floats
    field_rad: float


class StationScene(NamedTuple):
    """One station of several, as drawn: name, rotation (3, 3) R_w_s, position (3,) [m], generation ("1.0", "2.0").

    craft: index of the craft that it rides on, in whose frame rotation and position then are; -1: none.
    """

    name: str
    rotation: Floats
    position: Floats
    generation: str
    craft: int = -1


class OrbitScene(NamedTuple):
    """The lighthouse's orbit, as drawn: altitude_m, mean_motion_rad_s, and axes (3, 3), V-bar, H-bar, R-bar as rows in
    the lighthouse frame. sun_beta_rad: the sun above the orbit's plane; sun_phase_rad: in the plane, along the flight
    from the lighthouse at the start; None: not said.
    """

    altitude_m: float
    mean_motion_rad_s: float
    axes: Floats
    sun_beta_rad: float = 0.0
    sun_phase_rad: float | None = None


class Scene(NamedTuple):
    """Everything of a run that does not change.

    craft: names of the C craft. visuals: parts of each craft in its body frame (none: only its photodiodes are drawn).
    photodiodes: their layout. lighthouse: parts in the lighthouse frame. field_deg: full width of its field [deg].
    detail: names of the craft with plots of their own and, in a large swarm, the only ones drawn in detail; if empty,
    the first. ccd: the pairs of cameras, in the order of their images. lidar: craft and target of every LiDAR. replay:
    the run is of a recording, without a truth, and craft are drawn at their estimates. watched: an alert may be raised
    or something fail. actuated: a craft has thrusters or wheels. guided, docking: there are such craft. faults: names
    of what may fail, in the order of the codes in `Period.fault`; empty without faults. angle_noise_rad: standard
    deviation of a sweep angle that the craft assume; None: unknown. stations: all of several stations; none: there is
    one, whose frame is the world. up: axis of the world that points up, "-y" or "z".
    truth: a truth of another system goes with a replay. pairs: (who knows, of whom), craft that navigate relative to
    others. orbit: of the lighthouse; None in weightless space. physics: a sentence about steps and their errors; empty:
    nothing is simulated.
    """

    craft: Sequence[str]
    visuals: Sequence[Sequence[Visual]]
    photodiodes: Photodiodes
    lighthouse: Sequence[Visual]
    field_deg: float
    detail: Sequence[str] = ()
    ccd: Sequence[CcdScene] = ()
    lidar: Sequence[tuple[int, int]] = ()
    replay: bool = False
    watched: bool = False
    actuated: bool = False
    guided: bool = False
    docking: bool = False
    faults: Sequence[str] = ()
    angle_noise_rad: float | None = None
    stations: Sequence[StationScene] = ()
    up: str = "-y"
    truth: bool = False
    pairs: Sequence[tuple[int, int]] = ()
    orbit: OrbitScene | None = None
    physics: str = ""

    @property
    def without_sensors(self) -> list[str]:
        """Craft that carry no sensor and that nobody observes: they navigate by nothing."""
        sensing = {pair.craft for pair in self.ccd} | {i for pair in self.lidar for i in pair}
        dark = np.flatnonzero(~self.photodiodes.present.any(axis=1))
        return [self.craft[i] for i in dark.tolist() if i not in sensing]

    @property
    def equipment(self) -> list[Equipment]:
        """The equipment by which each craft navigates."""
        cameras, observed = {pair.craft for pair in self.ccd}, {target for _, target in self.lidar}
        counts = self.photodiodes.present.sum(axis=1).tolist()
        return [
            Equipment(
                count,
                (
                    *(("lighthouse",) if count else ()),
                    *(("cameras",) if i in cameras else ()),
                    *(("LiDAR of another craft",) if i in observed else ()),
                ),
            )
            for i, count in enumerate(counts)
        ]


class Recorder(Protocol):
    """Takes a run's periods in order. notice: a message for the user, for instance why there is no viewer."""

    notice: str | None

    def append(self, period: Period, errors: Errors) -> None:
        """Take one period."""

    def close(self) -> None:
        """Write what is left; the recording can then be opened."""


class NullRecording:
    """Records nothing."""

    notice: str | None = None

    def append(self, period: Period, errors: Errors) -> None:
        """Do nothing."""

    def close(self) -> None:
        """Do nothing."""
