import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pricing_core.american.engines.perpetual import perpetual_boundary


@pytest.mark.parametrize("is_put", [True, False])
@given(rate=st.floats(0.001, 0.5), dividend_yield=st.floats(0.001, 0.5), volatility=st.floats(0.001, 3.0))
def test_the_boundary_satisfies_its_quadratic(is_put, rate, dividend_yield, volatility):
    boundary = perpetual_boundary(
        is_put=is_put, rate=rate, dividend_yield=dividend_yield, volatility=volatility
    )
    assert boundary < 1.0 if is_put else boundary > 1.0
    L = boundary / (boundary - 1.0)  # for both: S*/K = L/(L - 1)
    drift = rate - dividend_yield - 0.5 * volatility**2
    terms = (0.5 * volatility**2 * L * L, drift * L, -rate)
    assert sum(terms) == pytest.approx(0.0, abs=1e-6 * max(map(abs, terms)))


def test_the_boundary_is_where_nothing_is_exercised():
    assert perpetual_boundary(is_put=True, rate=0.0, dividend_yield=0.05, volatility=0.2) == 0.0
    assert perpetual_boundary(is_put=False, rate=0.05, dividend_yield=0.0, volatility=0.2) == math.inf
