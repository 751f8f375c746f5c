"""The damping policy: one step of every fate."""

import numpy as np
import pytest

from estimators.levenberg_marquardt import FIRST_DAMPING, RISE, STEP_SMALL, ends, judged, raised


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
    assert ends(0.99 * small, 0.99 * small, 0.0, 0.0)
    for turn, way in ((1.01, 0.5), (0.5, 1.01)):
        assert not ends(turn * small, way * small, 0.0, 0.0), "nothing to compare with"
    # Steps that shrink to a thousandth: the next would be 1e-9, or 8e-9 if it shrank eight times less.
    assert ends((1e-6) ** 2, (1e-6) ** 2, (1e-3) ** 2, (1e-3) ** 2)
    assert not ends((2e-5) ** 2, (2e-5) ** 2, (2e-3) ** 2, (2e-3) ** 2)
    # The slower one tells the rate of both: the attitude shrinks to a tenth only, and position will follow it.
    assert not ends((1e-7) ** 2, (1e-6) ** 2, (1e-6) ** 2, (1e-3) ** 2)
    assert not ends((1e-6) ** 2, (1e-7) ** 2, (1e-3) ** 2, (1e-6) ** 2)
    # Ones that shrink to a half go on until they are small.
    assert not ends((1.5e-7) ** 2, (1.5e-7) ** 2, (3e-7) ** 2, (3e-7) ** 2)
    for odd in ((np.nan, 1.0, 1.0, 1.0), (1.0, np.nan, 1.0, 1.0)):
        assert not ends(*odd)


def test_what_is_left_after_the_end_is_below_the_bound() -> None:
    for rate in (1e-4, 1e-2, 0.1, 0.24):
        before, step = 0.0, 1e-2
        while not ends(step**2, step**2, before**2, before**2):
            before, step = step, rate * step
        slower = min(RISE * rate, 0.5)
        assert slower * step / (1 - slower) < 1.5 * STEP_SMALL
