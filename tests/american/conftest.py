import pytest

from pricing_core.american import Market, Option


@pytest.fixture
def put():
    return Option("put", strike=100.0, expiry=1.0)


@pytest.fixture
def market():
    return Market(spot=100.0, rate=0.05, volatility=0.2)
