"""Acquisition by several scans of a target that one scan leaves ambiguous."""

import numpy as np
import pytest
from lidar_target import DISTANCE, attitudes, crooked, scan_of

from estimators.lidar.acquisition import AcquisitionSettings, Verdict
from estimators.lidar.evidence import Evidence
from estimators.rotation import angle_between, exp

TURN = exp(np.radians([0.3, -0.2, 0.3]))
"""How the target turns from scan to scan."""
STRICT = AcquisitionSettings(starts=800, candidates=6, rays_against=450)
"""So many rays must decide as no scan of the target has."""


def test_scans_that_are_ambiguous_one_by_one_decide_together_while_the_scanner_moves():
    shape, rng, truth, place = crooked(), np.random.default_rng(5), attitudes(3, seed=2)[2], DISTANCE
    evidence, turn, shift = Evidence(shape, STRICT), exp(np.array([0.0, 0.02, 0.05])), np.array([0.1, -0.05, 0.02])
    margins = []
    for _ in range(8):
        found = evidence.take(scan_of(shape, truth, place, rng), turn, shift)
        margins.append(found.margin)
        assert np.degrees(angle_between(found.rotation, truth)) < 1
        assert np.linalg.norm(found.position - place) < 0.02
        if found.found:
            break
        assert found.verdict is Verdict.AMBIGUOUS
        truth, place = turn @ TURN @ truth, turn @ place + shift
    assert found.found
    assert len(margins) > 2
    assert margins == sorted(margins)
    # Whatever was found, the next scan begins anew.
    assert evidence.scans == 0
    assert evidence.take(scan_of(shape, truth, place, rng)).margin == pytest.approx(margins[0], rel=0.5)


def test_a_target_that_is_another_one_begins_anew():
    shape, rng, there = crooked(), np.random.default_rng(6), attitudes(2, seed=7)
    evidence = Evidence(shape, STRICT)
    assert evidence.take(scan_of(shape, there[0], DISTANCE, rng)).verdict is Verdict.AMBIGUOUS
    found = evidence.take(scan_of(shape, there[1], DISTANCE, rng))
    assert np.degrees(angle_between(found.rotation, there[1])) < 1
    assert evidence.scans == 1
    assert evidence.take(scan_of(shape, there[1], np.array([0.0, 900.0, 0.0]), rng)).verdict is Verdict.TOO_FEW
