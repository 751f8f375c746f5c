"""The orbit as a recording draws it: where the sun is seen from the lighthouse, and where the Earth's shadow is."""

import numpy as np
import pytest

from estimators.relative_orbit import BORESIGHTS, EARTH_RADIUS_M, circular
from estimators.rotation import exp
from swarm.flight.flight import Flight
from swarm.flight.scene import scene
from swarm.results.recording.drawing import palette
from swarm.results.recording.layer import Stage
from swarm.results.recording.orbit import Orbit, globe, in_shadow, tips, towards_sun
from swarm.results.scene import OrbitScene
from swarm.scenario import load


@pytest.mark.parametrize("boresight", BORESIGHTS)
def test_the_sun_is_seen_from_the_lighthouse_where_it_is_among_the_stars(boresight: str) -> None:
    """At the angle a of its orbit the lighthouse sees the sun ahead by sin(phase - a), and below by -cos(phase - a)."""
    relative, phase, beta = circular(500e3, boresight), 0.7, 0.3
    orbit = OrbitScene(500e3, relative.mean_motion_rad_s, relative.axes, beta, phase)
    plain = load("static")
    stage = Stage(scene(plain, Flight(plain)), np.zeros(0, dtype=np.int64), False, [], palette(1), 3.0, 0.0)
    drawn = Orbit(stage, orbit)
    sun = towards_sun(orbit)
    assert sun is not None
    for angle in (0.0, 0.4, 2.0, 5.0):
        # As the recording turns it, about H-bar.
        seen = exp(angle * relative.axes[1]) @ drawn._seen(sun)
        along, across, down = relative.axes @ seen
        assert along == pytest.approx(np.cos(beta) * np.sin(phase - angle), abs=1e-12)
        assert across == pytest.approx(-np.sin(beta), abs=1e-12)
        assert down == pytest.approx(-np.cos(beta) * np.cos(phase - angle), abs=1e-12)


def test_the_shadow_of_the_earth_covers_the_known_share_of_an_orbit() -> None:
    """With the sun in the plane, asin(R / a) / pi of the orbit is dark; a sun high above it darkens nothing."""
    angle = np.linspace(0, 2 * np.pi, 100001)[:-1]
    radius = (EARTH_RADIUS_M + 500e3) / 1e6
    place = radius * np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)], axis=1)
    dark = in_shadow(place, np.array([1.0, 0.0, 0.0]))
    assert dark.mean() == pytest.approx(np.arcsin(EARTH_RADIUS_M / 1e6 / radius) / np.pi, abs=1e-4)
    assert dark[50000]
    assert not in_shadow(place, np.array([0.0, 0.0, 1.0])).any()


def test_the_globe_is_closed_and_its_faces_look_outwards() -> None:
    vertex, face = globe(12)
    corner = vertex[face]
    normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    volume = np.einsum("fi,fi->f", corner[:, 0], normal) / 6
    assert np.all(volume > -1e-12)
    assert volume.sum() == pytest.approx(4 * np.pi / 3, rel=0.03)


def test_a_scene_has_the_orbit_of_its_scenario_and_none_in_weightless_space() -> None:
    settings = load("orbit", {"orbit.sun_phase_deg": 90.0, "orbit.sun_beta_deg": 30.0})
    orbit = scene(settings, Flight(settings)).orbit
    assert orbit is not None
    assert towards_sun(orbit) == pytest.approx([0.0, np.cos(np.pi / 6), 0.5])
    # The lighthouse looks back along its flight, with the Earth below it.
    assert tips(orbit, 10.0) == pytest.approx(np.array([[0, 0, -2.0], [0, 2.0, 0]]))
    assert towards_sun(orbit._replace(sun_phase_rad=None)) is None
    plain = load("static")
    assert scene(plain, Flight(plain)).orbit is None
