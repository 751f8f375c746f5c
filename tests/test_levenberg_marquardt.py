"""The damping policy: one step of every fate."""

import numpy as np
import pytest

from estimators.levenberg_marquardt import FIRST_DAMPING, judged, raised


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
