"""Angles of Lighthouse 1.0 in a Crazyflie's log: instants, and what only the pulses tell."""

import numpy as np

from swarm.flight.recordings.hits import Hits
from swarm.flight.recordings.rotor_light import FRAME_HZ, FrameLog
from swarm.flight.recordings.sweep_instants import PERIOD_TICKS, timed

PERIODS, LATE_S = 90, 0.009


def test_angles_that_the_firmware_did_not_log_come_from_the_pulses() -> None:
    """Two stations in turns, a slow clock, jitter of the flashes; a third of the periods has no angles in the log."""
    rng = np.random.default_rng(3)
    angles, pulses = [], []
    for n in range(PERIODS):
        for key, (number, axis) in enumerate(((0, 0), (0, 1), (1, 0), (1, 1))):
            flash = 1e5 + n * (PERIOD_TICKS + 20) + key * PERIOD_TICKS / 4 + 4 * rng.standard_normal()
            for k in range(4):
                angle = 0.3 * np.sin(0.1 * n + number) + 0.01 * k - 0.2 * axis
                tick = flash + (angle + np.pi / 2) / np.pi * FRAME_HZ / 120
                pulses += [(flash, k), (tick, k)]
                angles.append((number, axis, k, tick, angle, n))
    table, light = np.array(angles), np.array(sorted(pulses))
    logged = table[table[:, 5] % 3 != 1]
    station, fan, photodiode = logged[:, :3].astype(np.int64).T
    hits = Hits(station, fan, photodiode, np.round(1e6 * (logged[:, 3] / FRAME_HZ + LATE_S)), logged[:, 4])
    order = np.argsort(hits.tick, kind="stable")
    none = np.zeros(len(light), dtype=np.int64)
    frames = FrameLog(light[:, 0] / FRAME_HZ, light[:, 1].astype(np.int64), none - 1, none, light[:, 0])
    found = timed(hits.of(order), 1e-6, frames)
    assert found.exact
    assert found.untimed == 0
    # The first and the last sweep of a fan are known from logged angles.
    within = table[(table[:, 5] % 3 == 1) & (table[:, 5] < PERIODS - 1)]
    assert found.added == len(within)
    order = np.lexsort((found.hits.photodiode, found.hits.fan, found.hits.station, np.round(found.hits.tick)))
    want = table[(table[:, 5] % 3 != 1) | (table[:, 5] < PERIODS - 1)]
    want = want[np.lexsort((want[:, 2], want[:, 1], want[:, 0], np.round(want[:, 3])))]
    np.testing.assert_array_equal(found.hits.station[order], want[:, 0])
    np.testing.assert_array_equal(found.hits.photodiode[order], want[:, 2])
    np.testing.assert_allclose(found.hits.angle[order], want[:, 4], atol=5e-5)
