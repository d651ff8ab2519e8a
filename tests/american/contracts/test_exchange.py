"""The option to exchange one asset for another."""

import math
import random

import pytest

from pricing_core.american import exchange_option, price
from pricing_core.errors import InvalidInputError
from tests.problems.needs_kernel import needs_kernel


def normal(x: float) -> float:
    return 0.5 * math.erfc(-x / math.sqrt(2.0))


def drawn(seed: int) -> dict[str, float]:
    choose = random.Random(seed)
    return {
        "received_volatility": choose.uniform(0.1, 0.5),
        "given_volatility": choose.uniform(0.1, 0.5),
        "correlation": choose.uniform(-0.9, 0.9),
        "received_yield": choose.uniform(0.0, 0.1),
        "given_yield": choose.uniform(0.0, 0.1),
    }


@pytest.mark.parametrize("seed", range(8))
def test_the_european_one_is_worth_margrabes_formula(seed):
    terms, S1, S2, T = drawn(seed), 100.0, 95.0 + seed, 0.3 + 0.2 * seed
    s1, s2 = terms["received_volatility"], terms["given_volatility"]
    spread = math.sqrt((s1**2 + s2**2 - 2.0 * terms["correlation"] * s1 * s2) * T)
    one, other = S1 * math.exp(-terms["received_yield"] * T), S2 * math.exp(-terms["given_yield"] * T)
    d = math.log(one / other) / spread + 0.5 * spread
    expected = one * normal(d) - other * normal(d - spread)
    found = price(*exchange_option(S1, S2, T, **terms, exercise="european"))
    assert found.price == pytest.approx(expected, abs=1e-10)


@needs_kernel
@pytest.mark.parametrize("seed", range(8))
def test_giving_one_asset_for_another_is_a_put_on_the_one_given(seed):
    terms = drawn(seed)
    option, market = exchange_option(100.0, 97.0, 1.0, **terms)
    found = price(option, market, tolerance=1e-8)
    put = type(option)("put", strike=100.0, expiry=1.0)
    seen = type(market)(97.0, terms["received_yield"], market.volatility, terms["given_yield"])
    other = price(put, seen, tolerance=1e-8)
    assert abs(found.price - other.price) <= found.error_estimate + other.error_estimate
    by_given = (found.price - 100.0 * found.delta) / 97.0
    assert by_given == pytest.approx(other.delta, abs=1e-6)


def test_an_asset_that_moves_with_the_other_has_no_volatility():
    found = price(
        *exchange_option(110.0, 100.0, 1.0, received_volatility=0.3, given_volatility=0.3, correlation=1.0)
    )
    assert found.price == pytest.approx(10.0, abs=1e-12)


@pytest.mark.parametrize("field", ["received_volatility", "given_volatility", "correlation"])
def test_what_is_wrong_is_named(field):
    terms = {"received_volatility": 0.2, "given_volatility": 0.2, "correlation": 0.5, field: 16.0}
    with pytest.raises(InvalidInputError, match=f"{field} = 16"):
        exchange_option(100.0, 100.0, 1.0, **terms)
