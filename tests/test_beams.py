"""The circuits before Lighthouse 2.0: which plane of light a hit is of, and which sweep one without bits."""

import numpy as np
import pytest

from estimators.arrays import Floats, Ints
from estimators.lighthouse.rotor import share_of
from estimators.lighthouse.rows import Rows
from estimators.lighthouse.sweep import lighthouse_2, measured_angles
from estimators.lighthouse.tilted import TiltedErrors
from swarm.messages import BeamHits
from swarm.onboard.beams import BeamDecoder

TICK_S, TURN_S = 1 / 48e6, 0.02


class Expecting:
    """What a craft expects: every photodiode at two angles (2,) [rad], and hits within `sigma` [rad] of them."""

    def __init__(self, angles: Floats, sigma: float) -> None:
        self.angles, self.sigma = angles, sigma

    def expected_angles(self, craft: Ints, station: Ints, photodiode: Ints, offset_s: Floats) -> Floats:
        return np.tile(self.angles, (len(craft), 1))

    def sigmas_away(self, craft: Ints, rows: Rows) -> Floats:
        out: Floats = np.abs(rows.angle - self.angles[rows.fan]) / self.sigma
        return out


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

    rows = decoder.decode(hits_of(angles), Expecting(angles + 0.03, 1.0)).rows
    np.testing.assert_allclose(rows.angle[np.argsort(rows.fan)], angles, atol=1e-5)
    alone = decoder.decode(hits_of(angles)).rows
    if abs(elevation_deg) < 56:
        np.testing.assert_allclose(alone.angle[np.argsort(alone.fan)], angles, atol=1e-5)


@pytest.mark.parametrize("known", [3, 4])
def test_a_hit_without_bits_is_only_where_a_craft_expects_it(known: int) -> None:
    """Its neighbours are of one sweep, but it may be of another station that no hit of the period tells of."""
    place = np.arange(known + 1, dtype=np.float64) * 3e-3 - 0.3
    offset = np.rint(share_of(place, np.zeros(known + 1, dtype=np.int64)) * TURN_S / TICK_S).astype(np.int64)
    bare = np.arange(known + 1) == 1
    hits = BeamHits(
        photodiode=np.arange(known + 1, dtype=np.int16)[None],
        rise_tick=offset[None] - 50,
        width_tick=np.full((1, known + 1), 100, dtype=np.int32),
        channel=np.where(bare, 0, 1).astype(np.int16)[None],
        offset_tick=np.where(bare, -1, offset)[None],
        total=np.array([known + 1], dtype=np.int32),
        epoch_tick=np.zeros(1, dtype=np.int64),
    )
    decoder = BeamDecoder(np.ones((1, known + 1), dtype=np.bool_), TICK_S, [1], [TURN_S])
    here, elsewhere = (Expecting(np.array([place[1] + off, 0.5]), 1e-4) for off in (4e-4, 6e-4))
    nothing = Expecting(np.full(2, np.nan), 1e-4)
    for expected, taken in ((None, True), (here, True), (elsewhere, False), (nothing, known < 4)):
        light = decoder.decode(hits, expected)
        assert (1 in light.rows.photodiode) == taken, expected
        assert light.rejected.tolist() == [0 if taken else 1]
        assert len(light.rows.angle) == known + taken
