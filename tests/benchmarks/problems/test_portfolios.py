import numpy as np
import pytest

from benchmarks.problems.portfolios import (
    Portfolio,
    andersen_lake_offengenden,
    everyday,
    option_chains,
    spot_ladders,
    wide,
)
from pricing_core.american import price_many


def test_the_published_grid_is_the_product_of_its_values():
    puts = andersen_lake_offengenden()
    assert len(puts) == 10 * 5 * 5 * 4 * 6
    assert set(puts.option_type) == {"put"}
    assert sorted(set(puts.expiry)) == [1 / 12, 1 / 4, 1 / 2, 3 / 4, 1.0]
    assert sorted(set(puts.rate)) == [0.02, 0.04, 0.06, 0.08, 0.10]
    assert len(set(zip(*puts.columns().values(), strict=True))) == len(puts)


@pytest.mark.parametrize(
    ("contracts", "ranges"),
    [
        (
            everyday(400),
            {"spot": (60, 160), "expiry": (10 / 360, 3), "rate": (0.005, 0.1), "volatility": (0.1, 0.6)},
        ),
        (
            wide(400),
            {"spot": (40, 250), "expiry": (5 / 360, 10), "rate": (0, 0.15), "volatility": (0.03, 1.5)},
        ),
    ],
    ids=["everyday", "wide"],
)
def test_random_contracts_fill_their_ranges_with_both_types(contracts: Portfolio, ranges):
    assert {"put", "call"} == set(contracts.option_type)
    for name, (low, high) in ranges.items():
        column = contracts.columns()[name]
        assert low <= column.min() <= low + 0.1 * (high - low)
        assert high - 0.1 * (high - low) <= column.max() <= high


@pytest.mark.parametrize("make", [everyday, wide, lambda count: spot_ladders(count, 4)])
def test_the_same_contracts_are_drawn_every_time(make):
    one, other = make(7), make(7)
    for name, column in one.columns().items():
        assert np.array_equal(column, other.columns()[name])


def test_a_sample_is_repeatable_and_ordered_and_without_doubles():
    contracts = everyday(50)
    rows = contracts.sample(20)
    assert np.array_equal(rows, contracts.sample(20))
    assert (np.diff(rows) > 0).all()
    assert np.array_equal(contracts.sample(99), np.arange(50))


def test_the_rows_of_a_ladder_or_chain_share_all_but_their_place_in_it():
    ladders, chains = spot_ladders(3, 5), option_chains(2, 4, 3)
    assert len(ladders) == 15
    assert len(set(zip(ladders.strike, ladders.days, ladders.rate, ladders.volatility, strict=True))) == 3
    assert len(chains) == 24
    assert len(set(zip(chains.spot, chains.option_type, chains.rate, chains.volatility, strict=True))) == 2
    assert len(set(zip(chains.strike[:12], chains.days[:12], strict=True))) == 12


def test_the_engine_takes_the_columns():
    table = price_many(everyday(3).columns(), tolerance=1e-2, greeks="none")
    assert set(table["status"]) == {"ok"}
