"""Short flights give what they gave, bit for bit: see golden.py."""

import golden
import pytest


@pytest.mark.parametrize("case", golden.FLIGHTS)
def test_flight_gives_what_is_kept(case: str) -> None:
    golden.demand(case)
