"""The orbit of the lighthouse: a view of its own with the Earth, and arrows at the lighthouse that say what is where.

    orbit/earth          the Earth in true size, its night side dark where the scenario says where the sun is
    orbit/path           the orbit; its part in the Earth's shadow is dark
    orbit/station        the lighthouse on it, with its direction of flight
    orbit/sun            the direction of the sun
    world/directions     at the lighthouse: to the Earth, along the flight, to the sun

The view's axes keep their directions among the stars, in units of 1000 km: x from the Earth's centre to the lighthouse
at the start, y along its flight there, z along the angular momentum. With the mean motion n the lighthouse is at
a (cos n t, sin n t, 0). Which continent is below is not known: a scenario has neither inclination nor date.
"""

from typing import NamedTuple

import numpy as np
import rerun as rr

from estimators.arrays import Bools, Floats
from estimators.relative_orbit import EARTH_RADIUS_M
from estimators.rotation import exp, quaternion_from_matrix, xyzw_from_wxyz
from swarm.results.recording.batch import Batch
from swarm.results.recording.canvas import Canvas, Send, ink
from swarm.results.recording.layer import Stage
from swarm.results.scene import OrbitScene

UNIT_M = 1e6
RADIUS = EARTH_RADIUS_M / UNIT_M
STEPS = 180
ARROW = 0.2
"""Length of the arrows at the lighthouse, as a share of the scene's reach."""
EARTH, SUN, FLIGHT = 0x42A5F5FF, 0xFFD54FFF, 0x81C784FF
DAY, NIGHT = np.array([66.0, 135.0, 205.0]), np.array([16.0, 30.0, 54.0])
UP = np.array([0.0, 0.0, 1.0])


class Globe(NamedTuple):
    """A sphere: vertices on the unit sphere (V, 3) and faces (F, 3)."""

    vertex: Floats
    face: Floats


def globe(rings: int = 36) -> Globe:
    """Return a sphere of so many rings of latitude, and twice as many of longitude."""
    latitude = np.linspace(-np.pi / 2, np.pi / 2, rings + 1)
    longitude = np.linspace(0, 2 * np.pi, 2 * rings + 1)
    lat, lon = (part.ravel() for part in np.meshgrid(latitude, longitude, indexing="ij"))
    vertex = np.stack([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)], axis=1)
    row, column = (part.ravel() for part in np.meshgrid(np.arange(rings), np.arange(2 * rings), indexing="ij"))
    corner = row * (2 * rings + 1) + column
    above = corner + 2 * rings + 1
    face = np.concatenate([np.stack([corner, corner + 1, above + 1], 1), np.stack([corner, above + 1, above], 1)])
    return Globe(vertex, face)


def towards_sun(orbit: OrbitScene) -> Floats | None:
    """Return the direction of the sun in the view's axes, (3,); None where the scenario does not say."""
    if orbit.sun_phase_rad is None:
        return None
    flat = np.cos(orbit.sun_beta_rad)
    return np.array(
        [flat * np.cos(orbit.sun_phase_rad), flat * np.sin(orbit.sun_phase_rad), np.sin(orbit.sun_beta_rad)]
    )


def in_shadow(place: Floats, sun: Floats, radius: float = RADIUS) -> Bools:
    """Tell which places (n, 3) are in the cylinder of the Earth's shadow.

    Args:
        place: in the view's axes and unit.
        sun: direction of the sun, (3,).
        radius: of the Earth.
    """
    ahead = place @ sun
    out: Bools = (ahead < 0) & (np.linalg.norm(place - ahead[:, None] * sun, axis=1) < radius)
    return out


def tips(orbit: OrbitScene, reach_m: float) -> Floats:
    """Return where the arrows at the lighthouse end that do not turn, (2, 3) [m]."""
    return ARROW * reach_m * orbit.axes[[0, 2]]


class Orbit:
    """orbit; world/directions."""

    def __init__(self, stage: Stage, orbit: OrbitScene) -> None:
        self._orbit, self._reach_m = orbit, stage.reach_m
        self._sun = towards_sun(orbit)
        self._radius = RADIUS + orbit.altitude_m / UNIT_M

    def begin(self, canvas: Canvas) -> None:
        """Draw what does not move."""
        sphere, sun, radius = globe(), self._sun, self._radius
        light = np.full(len(sphere.vertex), 0.75)
        if sun is not None:
            # The terminator is a few degrees wide, as twilight is.
            light = np.clip(0.5 + 4.0 * (sphere.vertex @ sun), 0.0, 1.0)
        colour = np.rint(NIGHT + light[:, None] * (DAY - NIGHT)).astype(np.uint8)
        canvas.static(
            "orbit/earth",
            rr.Mesh3D(vertex_positions=RADIUS * sphere.vertex, triangle_indices=sphere.face, vertex_colors=colour),
        )
        circles = [RADIUS * 1.002 * circle for circle in _graticule()]
        canvas.static("orbit/earth/grid", rr.LineStrips3D(circles, colors=[0xFFFFFF28], radii=-0.4))
        angle = np.linspace(0, 2 * np.pi, STEPS + 1)
        path = radius * np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)], axis=1)
        pieces = np.stack([path[:-1], path[1:]], axis=1)
        dark = in_shadow(pieces.mean(axis=1), sun) if sun is not None else np.zeros(STEPS, dtype=np.bool_)
        inks = np.where(dark, np.uint32(0x546E7AFF), np.uint32(0xECEFF1FF))
        canvas.static("orbit/path", rr.LineStrips3D(list(pieces), colors=inks, radii=-1.0))
        canvas.static(
            "orbit/station/body", rr.Points3D([[0, 0, 0]], radii=-6.0, colors=[0xFF8A65FF], labels=["lighthouse"])
        )
        flight = rr.Arrows3D(vectors=[[0, 0.45 * radius, 0]], colors=ink(FLIGHT), radii=-3.0)
        canvas.static("orbit/station/flight", flight)
        if sun is not None:
            arrow = rr.Arrows3D(
                origins=[1.15 * RADIUS * sun], vectors=[0.7 * RADIUS * sun], colors=ink(SUN), radii=-3.0, labels=["sun"]
            )
            canvas.static("orbit/sun", arrow)
        along, _, down = self._orbit.axes
        self._arrow(canvas, "earth", down, EARTH, "Earth")
        self._arrow(canvas, "flight", along, FLIGHT, "flight")
        if sun is not None:
            self._arrow(canvas, "sun/arrow", self._seen(sun), SUN, "sun")

    def send(self, send: Send, batch: Batch) -> None:
        """Move the lighthouse on its orbit, and turn the sun about the lighthouse's axes."""
        angle = self._orbit.mean_motion_rad_s * batch.time_s
        place = self._radius * np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)], axis=1)
        send("orbit/station", rr.Transform3D.columns(translation=place, quaternion=_turns(UP, angle)))
        if self._sun is not None:
            # Against the angular momentum, H-bar; seen from axes that turn with the orbit, the sky turns back.
            turns = _turns(self._orbit.axes[1], angle)
            send(
                "world/directions/sun", rr.Transform3D.columns(translation=np.zeros((len(angle), 3)), quaternion=turns)
            )

    def _seen(self, sun: Floats) -> Floats:
        """Return a direction of the view's axes in the lighthouse frame, at the start."""
        along, across, down = self._orbit.axes
        out: Floats = -sun[0] * down + sun[1] * along - sun[2] * across
        return out

    def _arrow(self, canvas: Canvas, name: str, direction: Floats, colour: int, label: str) -> None:
        vector = ARROW * self._reach_m * direction
        arrow = rr.Arrows3D(vectors=[vector], colors=ink(colour), radii=0.002 * self._reach_m, labels=[label])
        canvas.static(f"world/directions/{name}", arrow)


def _turns(axis: Floats, angle: Floats) -> Floats:
    """Return turns about an axis by angles (n,) as quaternions xyzw, (n, 4)."""
    out: Floats = xyzw_from_wxyz(quaternion_from_matrix(exp(angle[:, None] * axis)))
    return out


def _graticule() -> list[Floats]:
    """Return circles of latitude and longitude about the orbit's axis, on the unit sphere."""
    around = np.linspace(0, 2 * np.pi, 73)
    out = []
    for latitude in np.radians([-60, -30, 0, 30, 60]):
        flat = np.cos(latitude) * np.stack([np.cos(around), np.sin(around)], axis=1)
        out.append(np.column_stack([flat, np.full(len(around), np.sin(latitude))]))
    for longitude in np.radians(np.arange(0, 180, 30)):
        half = np.stack(
            [np.cos(around) * np.cos(longitude), np.cos(around) * np.sin(longitude), np.sin(around)], axis=1
        )
        out.append(half)
    return out
