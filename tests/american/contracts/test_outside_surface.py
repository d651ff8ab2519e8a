"""What lies outside a local volatility's nodes is said with the price."""

import numpy as np
import pytest

from pricing_core.american import LocalVolatility, Market, Option, price, price_many
from tests.problems.needs_kernel import needs_kernel

pytestmark = needs_kernel

SURFACE = LocalVolatility([0.0, 1.0], [80.0, 100.0, 120.0], [[0.3, 0.25, 0.2], [0.3, 0.25, 0.2]])


@pytest.mark.parametrize(
    ("spot", "strike", "expiry", "told"),
    [
        (100.0, 100.0, 1.0, ""),
        (79.0, 100.0, 1.0, "spot lies outside"),
        (100.0, 121.0, 0.5, "strike lies outside"),
        (125.0, 70.0, 1.5, "spot and strike and expiry lie outside"),
    ],
)
def test_what_lies_outside_is_named(spot, strike, expiry, told):
    found = price(Option("put", strike, expiry), Market(spot, 0.05, SURFACE))
    assert found.status == "ok"
    message = found.diagnostics.message
    assert message.startswith(told)
    assert bool(message) == bool(told)
    table = price_many(
        {
            "option_type": "put",
            "spot": spot,
            "strike": strike,
            "expiry": expiry,
            "rate": 0.05,
            "volatility": [SURFACE],
        }
    )
    assert table["message"].tolist() == [message]


def test_a_surface_with_one_node_has_no_outside():
    flat = LocalVolatility([0.0], [100.0], np.array([[0.2]]))
    assert price(Option("put", 90.0, 2.0), Market(70.0, 0.05, flat)).diagnostics.message == ""
