"""Every number of a scenario has limits with reasons, which messages give, and flies at them."""

import math
from pathlib import Path

import pytest
from bounds import COSTLY, Case, cases, infinite_columns, load_case

from swarm.errors import SwarmError
from swarm.scenario import load
from swarm.scenario.limits import limits_of
from swarm.scenario.reference import every_number

ALL = list(cases())
CHEAP = [case for case in ALL if case[:3] not in COSTLY]
FLOWN = 6
"""Number of cases that are flown, spread over all tables; `python tests/bounds.py` flies every one."""


def test_every_number_has_a_lower_and_an_upper_limit_and_a_reason_for_each() -> None:
    numbers = [(table.__name__, key, limits) for table, key, field in every_number() for limits in limits_of(field)]
    assert len(numbers) > 190
    for name, key, (low, high, why) in numbers:
        where = f"{name}.{key}"
        assert low is not None and high is not None and math.isfinite(low) and math.isfinite(high), where  # noqa: PT018
        assert low < high, where
        assert why is not None, where
        assert min(len(why.low), len(why.high)) > 15, where


def test_a_value_at_a_limit_is_taken_and_one_beyond_is_refused_with_the_reason(tmp_path: Path) -> None:
    reasons = {(table.__name__, key): next(limits_of(field)).why for table, key, field in every_number()}
    for case in ALL:
        load_case(case, tmp_path)
        with pytest.raises(SwarmError) as caught:
            load_case(case, tmp_path, beyond=True)
        why = reasons[case.table, case.key]
        assert why is not None
        assert f": {why.low if case.side == 'low' else why.high}" in str(caught.value), (case, str(caught.value))
        assert case.key in str(caught.value)


@pytest.mark.parametrize("case", CHEAP[:: (len(CHEAP) - 1) // (FLOWN - 1)][:FLOWN], ids=lambda c: "-".join(c[:3]))
def test_a_value_at_a_limit_flies(case: Case, tmp_path: Path) -> None:
    assert infinite_columns(load_case(case, tmp_path), tmp_path) == []


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ("criteria=[{measure='nees', max=1, to_s=0.0}]", "at least 0.001 s: a shorter time falls between two periods"),
        ("navigation.integrity.integrity_risk=0.2", "below 0.2: the bound of a protection level is proven for errors"),
        ("swarm.motion={kind='wander', turn_deg=-1}", "at least 0 deg: a largest turn is not negative"),
        ("swarm.motion={kind='wander', turn_deg=181}", "at most 180 deg: half a turn to either side"),
    ],
)
def test_the_reason_is_that_of_the_number(change: str, reason: str) -> None:
    with pytest.raises(SwarmError) as caught:
        load("formation", [change])
    assert f"must be {reason}" in str(caught.value)


def test_an_assumed_noise_far_below_that_of_the_light_is_refused() -> None:
    with pytest.raises(SwarmError, match=r"navigation\.angle_noise_arcsec = 1: must be at least 1\.76 arcsec"):
        load("static", ["navigation.angle_noise_arcsec=1"])
    assert load("static", ["navigation.angle_noise_arcsec=1", "lighthouse.angle_noise_arcsec=2"])
