"""The damping policy: one step of every fate."""

import numpy as np
import pytest

from estimators.levenberg_marquardt import FIRST_DAMPING, STEP_SMALL, ends, judged, raised


def test_damping_rises_from_nothing_and_tenfold() -> None:
    assert raised(0.0) == FIRST_DAMPING
    assert raised(FIRST_DAMPING) == 10 * FIRST_DAMPING


@pytest.mark.parametrize("next_cost", [1.5, np.inf, np.nan])
def test_a_step_that_does_not_lower_the_cost_is_refused(next_cost: float) -> None:
    assert judged(1.0, next_cost, 0.0) == (False, FIRST_DAMPING)


def test_damping_falls_tenfold_and_ends_at_zero() -> None:
    assert judged(1.0, 0.5, 0.1) == pytest.approx((True, 0.01))
    assert judged(1.0, 0.5, FIRST_DAMPING**2) == (True, 0.0)


def test_a_gain_below_rounding_is_accepted() -> None:
    assert judged(1e-10, 1e-10 + 1e-21, 0.0) == (True, 0.0)
    assert judged(1e-10, 1e-10 + 1e-19, 0.0) == (False, FIRST_DAMPING)


def test_a_small_step_ends_and_so_does_one_whose_next_would_be_small() -> None:
    small = STEP_SMALL**2
    assert ends(0.99 * small, 0.0)
    assert not ends(1.01 * small, 0.0), "nothing to compare with"
    # Steps that shrink to a hundredth: the third is 2e-7, the fourth would be 2e-9.
    assert ends((2e-7) ** 2, (2e-5) ** 2)
    assert not ends((2e-5) ** 2, (2e-3) ** 2)
    # Ones that shrink to a half go on for as long again.
    assert not ends((1.5e-7) ** 2, (3e-7) ** 2)
    assert not ends(np.nan, 1.0)


def test_what_is_left_after_the_end_is_below_the_bound() -> None:
    for rate in (1e-4, 1e-2, 0.1, 0.24):
        before, step = 0.0, 1e-2
        while not ends(step**2, before**2):
            before, step = step, rate * step
        assert rate * step / (1 - rate) < STEP_SMALL * 4 / 3
