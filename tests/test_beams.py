"""The circuits before Lighthouse 2.0: which plane of light a hit is of."""

import numpy as np
import pytest

from estimators.arrays import Floats, Ints
from estimators.lighthouse.rotor import share_of
from estimators.lighthouse.sweep import lighthouse_2, measured_angles
from estimators.lighthouse.tilted import TiltedErrors
from swarm.messages import BeamHits
from swarm.onboard.beams import BeamDecoder

TICK_S, TURN_S = 1 / 48e6, 0.02


def hits_of(angles: Floats) -> BeamHits:
    """Return two hits of one photodiode in one turn, that of each plane at its angle (2,) [rad]."""
    offset = np.sort(np.rint(share_of(angles, np.arange(2)) * TURN_S / TICK_S).astype(np.int64))
    return BeamHits(
        photodiode=np.zeros((1, 2), dtype=np.int16),
        rise_tick=offset[None] - 50,
        width_tick=np.full((1, 2), 100, dtype=np.int32),
        channel=np.ones((1, 2), dtype=np.int16),
        offset_tick=offset[None],
        total=np.array([2], dtype=np.int32),
        epoch_tick=np.zeros(1, dtype=np.int64),
    )


@pytest.mark.parametrize("elevation_deg", [40.0, 52.0, 58.5, -58.5])
def test_planes_that_have_crossed_are_told_by_what_a_craft_expects(elevation_deg: float) -> None:
    """From 56 degrees on the second plane comes first, 15 degrees and more before the other one from 58 on."""
    elevation = np.radians(elevation_deg)
    place = np.array([0.0, -np.sin(elevation), np.cos(elevation)])
    angles = measured_angles(place, lighthouse_2(TiltedErrors(), TiltedErrors()))
    decoder = BeamDecoder(np.ones((1, 1), dtype=np.bool_), TICK_S, [1], [TURN_S])

    def expect(craft: Ints, station: Ints, photodiode: Ints, offset_s: Floats) -> Floats:
        return np.tile(angles + 0.03, (len(craft), 1))

    rows = decoder.decode(hits_of(angles), expect).rows
    np.testing.assert_allclose(rows.angle[np.argsort(rows.fan)], angles, atol=1e-5)
    alone = decoder.decode(hits_of(angles)).rows
    if abs(elevation_deg) < 56:
        np.testing.assert_allclose(alone.angle[np.argsort(alone.fan)], angles, atol=1e-5)
