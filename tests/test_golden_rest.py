"""Recordings, experiments, a study, a calibration and replays give what they gave, bit for bit: see golden.py."""

import golden
import pytest


@pytest.mark.parametrize("case", golden.REST)
def test_the_rest_gives_what_is_kept(case: str) -> None:
    golden.demand(case)


def test_what_is_kept_is_what_there_is() -> None:
    for folder, cases in (("", golden.FLIGHTS | golden.REST), ("long", golden.LONG | golden.LONG_REST)):
        assert {file.stem for file in (golden.KEPT / folder).glob("*.json")} == set(cases)


def test_another_machine_is_compared_by_figures() -> None:
    assert golden.alike("aa 100 1.0 2.0", "bb 101 1.01 2.01")
    assert not golden.alike("aa 100 1.0 2.0", "bb 100 1.1 2.0")
    assert not golden.alike("aa 100 1.0 2.0", "bb 100 1.0 2.1")
    assert not golden.alike("aa 100 1.0 2.0", "bb 120 1.0 2.0")
    assert golden.alike("aa", "bb")
    assert not golden.alike("aa", "bb 1 1.0 1.0")
