"""The log of a period's pulses, against Python's stable sort."""

import numpy as np
import pytest

from swarm.messages import Pulses
from swarm.sensors.crossing import side_by_side
from swarm.sensors.pulses import pack_into, pulse_room

TICK_S = 1e-6


@pytest.mark.parametrize(("craft", "photodiodes"), [(1, 1), (3, 5), (9, 12), (4, 30)])
def test_pulses_are_those_of_a_stable_sort(craft: int, photodiodes: int) -> None:
    """Instants of a few ticks only, so that many pulses of every kind rise together, and sweeps before a flash."""
    rng = np.random.default_rng(photodiodes)
    shape = craft, photodiodes, 2
    flashed = rng.random(shape) < 0.8
    instant = TICK_S * rng.integers(0, 9, shape).astype(np.float64)
    width = TICK_S * rng.integers(0, 7, shape).astype(np.float64)
    instant[rng.random(shape) < 0.3] = np.nan
    strays = rng.integers(0, 4, craft)
    stray = np.stack([rng.integers(0, photodiodes, (craft, 3)), *(TICK_S * rng.integers(0, 9, (2, craft, 3)))], axis=2)
    flash, flash_width = TICK_S * np.array([1.0, 5.0]), np.array([60, 70])
    start = rng.integers(0, 1000, craft).astype(np.float64) + 1e9 + 0.25
    most = 4 * photodiodes + 3
    out = Pulses(
        np.empty((craft, most), dtype=np.int16),
        np.empty((craft, most), dtype=np.int64),
        np.empty((craft, most), dtype=np.int32),
        np.empty(craft, dtype=np.int32),
    )
    sweeps = side_by_side(instant), side_by_side(width)
    pack_into(flashed, *sweeps, strays, stray, flash, flash_width, start, TICK_S, pulse_room(photodiodes), out)
    for c in range(craft):
        begin = int(np.floor(start[c]))
        pulses = [
            (begin + round(flash[fan] / TICK_S), int(k), int(flash_width[fan]))
            for fan in range(2)
            for k in np.flatnonzero(flashed[c, :, fan])
        ]
        for k, fan in np.argwhere(np.isfinite(instant[c])):
            ticks = max(1, round(width[c, k, fan] / TICK_S))
            pulses.append((round(start[c] + instant[c, k, fan] / TICK_S - ticks / 2), int(k), ticks))
        for k, at, wide in stray[c, : strays[c]]:
            pulses.append((begin + round(at / TICK_S), int(k), max(1, round(wide / TICK_S))))
        pulses.sort(key=lambda pulse: pulse[0])
        found = list(
            zip(out.rise_tick[c].tolist(), out.photodiode[c].tolist(), out.width_tick[c].tolist(), strict=True)
        )
        assert out.total[c] == len(pulses)
        assert found == pulses + (most - len(pulses)) * [(0, -1, 0)]
