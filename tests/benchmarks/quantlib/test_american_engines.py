from dataclasses import replace

import numpy as np
import pytest

from benchmarks.measuring.timing import least_seconds
from benchmarks.option_engine.peer_methods import peer_methods, screened_schemes
from benchmarks.problems.portfolios import Portfolio, everyday
from benchmarks.quantlib.american_engines import (
    FINITE_DIFFERENCES,
    GRIDS,
    LEISEN_REIMER,
    QD_FP,
    TREE_STEPS,
    Instruments,
    call_overhead,
    named_schemes,
    other_methods,
    reference_prices,
)
from tests.problems.true_values import TrueValue, true_values

pytest.importorskip("QuantLib")


def whole_days() -> list[TrueValue]:
    return [known for known in true_values() if (360 * known.option.expiry) % 1 == 0]


def known_portfolio() -> Portfolio:
    known = whole_days()
    options, markets = [one.option for one in known], [one.market for one in known]
    return Portfolio(
        np.array([option.option_type for option in options]),
        np.array([market.spot for market in markets]),
        np.array([option.strike for option in options]),
        np.array([round(360 * option.expiry) for option in options]),
        np.array([market.rate for market in markets]),
        np.array([market.dividend_yield for market in markets]),
        np.array([market.volatility for market in markets]),
    )


def test_the_reference_agrees_with_known_values():
    known, contracts = whole_days(), known_portfolio()
    assert len(known) > 20
    reference = reference_prices(contracts)
    assert reference.agreed.mean() > 0.9
    errors = np.abs(reference.price - [one.price for one in known] / contracts.strike)
    allowed = (
        np.array([one.reference_error for one in known]) + reference.disagreement + 1e-9
    )  # the table's last digit
    assert (errors <= allowed)[reference.agreed].all()


def test_every_other_method_comes_near_the_reference():
    contracts = everyday(4)
    reference = reference_prices(contracts).price
    instruments = Instruments.of(contracts)
    for peer in (*named_schemes(), *other_methods()):
        assert np.abs(instruments.prices(peer.engine) - reference).max() < 1e-3, peer.setting


def test_the_methods_of_a_portfolio_cover_every_family_and_are_named_apart():
    contracts = everyday(5)
    reference = reference_prices(contracts).price
    methods = peer_methods(contracts, reference, screened=3, slow=2, overhead=0.0)
    assert len({(method.family, method.setting) for method in methods}) == len(methods)
    families = [method.family for method in methods]
    assert families.count(FINITE_DIFFERENCES) == len(GRIDS)
    assert families.count(LEISEN_REIMER) == len(TREE_STEPS)
    assert families.count(QD_FP) > 5
    assert {len(method.rows) for method in methods} == {5, 2}


def test_the_screening_keeps_an_accurate_scheme_and_drops_most():
    contracts = everyday(6)
    reference = reference_prices(contracts).price
    kept = screened_schemes(contracts, reference, np.arange(6), overhead=0.0)
    errors = [np.abs(Instruments.of(contracts).prices(peer.engine) - reference).max() for peer in kept]
    assert min(errors) < 1e-6
    assert len(kept) < 100


def test_a_contract_quantlib_cannot_price_is_missing_and_stops_nothing():
    contracts = everyday(3)
    spoilt = replace(contracts, spot=np.array([90.0, -1.0, 110.0]))
    instruments, fast = Instruments.of(spoilt), named_schemes()[0]
    assert np.isnan(instruments.prices(fast.engine)).tolist() == [False, True, False]
    (time,) = least_seconds([instruments.task(fast)], turns=1)
    assert time > 0.0
    assert not reference_prices(spoilt).agreed[1]


def test_a_call_that_calculates_nothing_costs_less_than_a_value():
    overhead = call_overhead(everyday(20))
    assert 0.0 < overhead.empty < overhead.european
