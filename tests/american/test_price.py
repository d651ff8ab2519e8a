import math
import pickle
from dataclasses import replace

import numpy as np
import pytest

from pricing_core.american import Market, Option, Resolution, price
from pricing_core.errors import InvalidInputError, NumericalError
from tests.problems.engine_with_errors import ERRORS
from tests.problems.needs_kernel import needs_kernel
from tests.problems.true_values import true_values
from tests.problems.zero_volatility import OPTIMAL_STOPPING

DEFAULT_TOLERANCE = 1e-6
TRUE_VALUES = true_values()


# Every sixth one without the compiled engines, where each takes seconds.
CASES = [
    pytest.param(case, id=case.name, marks=[needs_kernel] * (k % 6 != 0))
    for k, case in enumerate(TRUE_VALUES)
]


@pytest.mark.parametrize("case", CASES)
def test_price_is_within_its_tolerance_of_the_true_value(case):
    valuation = price(case.option, case.market)
    error = abs(valuation.price - case.price) / case.option.strike
    allowed = max(DEFAULT_TOLERANCE, valuation.error_estimate / case.option.strike)
    assert error <= allowed + case.reference_error
    assert error <= 5e-6 + case.reference_error
    assert valuation.status in ("ok", "tolerance_not_met")


@needs_kernel
def test_almost_every_reference_contract_meets_the_default_tolerance():
    statuses = [price(case.option, case.market, greeks="none").status for case in TRUE_VALUES]
    assert statuses.count("ok") >= 0.9 * len(statuses)


@pytest.mark.parametrize("case", TRUE_VALUES[27:47:4], ids=lambda case: case.name)
def test_put_call_symmetry(case):
    """Call(S, K, r, q) = put(K, S, q, r): McDonald and Schroder 1998."""
    option, market = case.option, case.market
    mirrored = Option("put", market.spot, option.expiry)
    mirrored_market = Market(option.strike, market.dividend_yield, market.volatility, market.rate)
    one, other = price(option, market), price(mirrored, mirrored_market)
    assert one.price == pytest.approx(other.price, abs=one.error_estimate + other.error_estimate)
    assert one.exercise_boundary / option.strike == pytest.approx(
        mirrored.strike / other.exercise_boundary, rel=2e-3
    )


@pytest.mark.parametrize("lcp_method", ["policy", "psor", "lemke"])
@pytest.mark.parametrize("option_type", ["put", "call"])
def test_every_lcp_method_gives_the_same_price_on_the_same_grid(lcp_method, option_type):
    option, market = Option(option_type, 100.0, 1.0), Market(98.0, 0.05, 0.25, 0.03)
    resolution = Resolution(intervals=64, steps=16)
    direct = price(option, market, method="lcs", resolution=resolution)
    other = price(option, market, method="lcs", lcp_method=lcp_method, resolution=resolution)
    assert other.price == pytest.approx(direct.price, abs=1e-8 * option.strike)
    assert other.diagnostics.lcp_residual <= 1e-11


@pytest.mark.parametrize("lcp_method", ["policy", "psor", "lemke"])
def test_every_lcp_method_finds_two_boundaries(lcp_method):
    option, market = Option("put", 100.0, 1.0), Market(80.0, -0.005, 0.2, -0.05)
    resolution = Resolution(intervals=96, steps=16)
    direct = price(option, market, method="lcs", resolution=resolution)
    other = price(option, market, method="lcs", lcp_method=lcp_method, resolution=resolution)
    assert other.price == pytest.approx(direct.price, abs=1e-8 * option.strike)


@pytest.mark.parametrize("option_type", ["put", "call"])
def test_crank_nicolson_agrees_within_the_error_estimates(option_type):
    option, market = Option(option_type, 100.0, 1.0), Market(95.0, 0.06, 0.3, 0.03)
    engine, peer = price(option, market), price(option, market, tolerance=1e-5, method="crank-nicolson")
    assert peer.price == pytest.approx(engine.price, abs=engine.error_estimate + peer.error_estimate)
    assert peer.method == "crank-nicolson"
    for greek in ("delta", "vega", "rho", "dividend_rho", "theta"):
        assert getattr(peer, greek) == pytest.approx(getattr(engine, greek), rel=1e-3, abs=1e-3)


@needs_kernel
@pytest.mark.parametrize(
    ("option", "market"),
    [
        (Option("put", 100.0, 1.0), Market(100.0, 0.05, 0.2)),
        (Option("put", 100.0, 3.0), Market(90.0, 0.03, 0.2, 0.07)),
        (Option("call", 100.0, 0.5), Market(110.0, 0.03, 0.35, 0.08)),
        pytest.param(Option("put", 100.0, 1.0), Market(120.0, -0.005, 0.2, -0.05), marks=pytest.mark.nightly),
    ],
    ids=["put", "put with r < q", "call", "put with two boundaries"],
)
def test_greeks_are_the_derivatives_of_the_price(option, market):
    valuation = price(option, market, tolerance=1e-8)

    def value(**changes):
        contract = replace(option, **{k: v for k, v in changes.items() if hasattr(option, k)})
        state = replace(market, **{k: v for k, v in changes.items() if hasattr(market, k)})
        return price(contract, state, tolerance=1e-8, greeks="none").price

    def derivative(name, base, h):
        """Central differences, extrapolated: error O(h**4)."""
        wide, narrow = ((value(**{name: base + d}) - value(**{name: base - d})) / (2 * d) for d in (h, h / 2))
        return (4 * narrow - wide) / 3

    def second_derivative(base, h):
        wide, narrow = (
            (value(spot=base + d) - 2 * value() + value(spot=base - d)) / d**2 for d in (h, h / 2)
        )
        return (4 * narrow - wide) / 3

    S, K = market.spot, option.strike
    assert valuation.delta == pytest.approx(derivative("spot", S, 0.02 * S), abs=1e-5)
    assert valuation.gamma * K == pytest.approx(second_derivative(S, 0.02 * S) * K, abs=1e-3)
    assert valuation.vega / K == pytest.approx(
        derivative("volatility", market.volatility, 0.01) / K, abs=2e-5
    )
    assert valuation.rho / K == pytest.approx(derivative("rate", market.rate, 2e-3) / K, abs=3e-5)
    assert valuation.dividend_rho / K == pytest.approx(
        derivative("dividend_yield", market.dividend_yield, 2e-3) / K, abs=3e-5
    )
    assert valuation.theta / K == pytest.approx(-derivative("expiry", option.expiry, 0.02) / K, abs=1e-5)
    assert valuation.theta_per_day == valuation.theta / 365
    assert valuation.vega_per_point == valuation.vega / 100
    assert valuation.rho_per_point == valuation.rho / 100


def test_in_the_exercise_region_everything_is_the_payoff(put):
    valuation = price(put, Market(70.0, 0.05, 0.2))
    assert valuation.price == 30.0
    assert valuation.exercise_now
    assert (valuation.delta, valuation.gamma, valuation.theta) == (-1.0, 0.0, 0.0)
    assert (valuation.vega, valuation.rho, valuation.dividend_rho) == (0.0, 0.0, 0.0)
    assert valuation.error_estimate <= 1e-6 * 100


@needs_kernel  # the grid's errors are a part of the spot, the tolerance one of the strike
def test_far_inside_the_exercise_region_the_price_is_exact():
    call = price(Option("call", 100.0, 1.0), Market(1e10, 0.01, 0.25, 0.05))
    assert call.price == 1e10 - 100.0
    assert call.status == "ok"


def test_exercise_and_its_boundary_agree(put):
    for spot in (75.0, 80.0, 80.8, 81.0, 85.0):
        valuation = price(put, Market(spot, 0.05, 0.2))
        assert valuation.exercise_now == (spot <= valuation.exercise_boundary)
        assert valuation.price >= valuation.intrinsic_value


@needs_kernel
def test_a_perpetual_option_is_the_limit_of_a_long_one():
    """K = 40, r = 0.06, sigma = 0.2: S* = 30 and V(36) = 10 (30/36)**3 = 5.787037037 (Merton 1973)."""
    valuation = price(Option("put", 40.0, 200.0), Market(36.0, 0.06, 0.2), greeks="none")
    assert valuation.price == pytest.approx(10 * (30 / 36) ** 3, abs=40 * 5e-6)
    assert valuation.exercise_boundary == pytest.approx(30.0, rel=1e-3)


@pytest.mark.parametrize("exercise", ["american", "european"])
@pytest.mark.parametrize("spot", [0.0, 80.0, 100.0, 130.0])
@pytest.mark.parametrize("option_type", ["put", "call"])
def test_at_expiry_the_value_is_the_intrinsic_value(option_type, spot, exercise):
    option = Option(option_type, 100.0, 0.0, exercise)
    valuation = price(option, Market(spot, 0.05, 0.2))
    assert valuation.price == option.payoff(spot) == valuation.european_price
    assert valuation.exercise_now == (option.payoff(spot) > 0)
    assert valuation.error_estimate == pytest.approx(4e-16 * valuation.price)


@pytest.mark.parametrize(
    ("option_type", "spot", "strike", "expiry", "rate", "dividend_yield", "expected"),
    OPTIMAL_STOPPING,
)
def test_zero_volatility_is_optimal_stopping_without_chance(
    option_type, spot, strike, expiry, rate, dividend_yield, expected
):
    valuation = price(Option(option_type, strike, expiry), Market(spot, rate, 0.0, dividend_yield))
    assert valuation.price == pytest.approx(expected, abs=1e-10)
    assert valuation.status == "ok"


@pytest.mark.parametrize("volatility", [1e-8, 1e-5, 1e-3, 5e-3])
@pytest.mark.parametrize(("rate", "dividend_yield"), [(0.05, 0.01), (0.01, 0.2), (0.0, 0.05), (-0.01, -0.05)])
def test_small_volatility_comes_from_above_and_close_to_the_limit(volatility, rate, dividend_yield):
    option = Option("put", 100.0, 2.0)
    limit = price(option, Market(95.0, rate, 0.0, dividend_yield)).price
    valuation = price(option, Market(95.0, rate, volatility, dividend_yield))
    assert -valuation.error_estimate <= valuation.price - limit
    assert valuation.price - limit <= 2 * 95.0 * volatility * math.sqrt(2.0) + valuation.error_estimate
    assert math.isfinite(valuation.delta)


@pytest.mark.parametrize(
    ("option_type", "rate", "dividend_yield"),
    [
        ("put", -0.01, 0.0),
        ("put", 0.0, 0.03),
        ("put", -0.02, -0.01),
        ("call", 0.05, 0.0),
        ("call", 0.0, -0.01),
    ],
)
def test_never_exercised_options_are_european_without_a_boundary(option_type, rate, dividend_yield):
    option, market = Option(option_type, 100.0, 1.0), Market(90.0, rate, 0.3, dividend_yield)
    valuation = price(option, market)
    assert (
        valuation.price
        == valuation.european_price
        == price(replace(option, exercise="european"), market).price
    )
    assert valuation.exercise_boundary is None
    assert valuation.early_exercise_premium == 0.0
    assert not valuation.exercise_now


@needs_kernel
def test_the_error_estimate_falls_with_the_tolerance_and_a_missed_tolerance_is_said(put, market):
    estimates = [price(put, market, tolerance=t).error_estimate for t in (1e-2, 1e-5, 1e-7)]
    assert estimates == sorted(estimates, reverse=True)
    valuation = price(Option("put", 100.0, 200.0), Market(100.0, -0.5, 0.2, -0.5))  # worth e^100 strikes
    assert valuation.status == "tolerance_not_met"
    assert valuation.error_estimate > 1e-6 * 100.0


@pytest.mark.nightly
def test_what_the_chapters_road_misses_is_said():
    option, market = Option("put", 120.0, 10.0), Market(100.0, 0.1, 0.25, 0.03)
    valuation = price(option, market, tolerance=1e-8, method="lcs")
    assert valuation.status == "tolerance_not_met"
    assert valuation.error_estimate > 1e-8 * 120.0
    assert abs(valuation.price - 23.000305) <= valuation.error_estimate + 1e-6


@pytest.mark.parametrize(
    ("option_type", "market", "expected"),
    [
        ("put", Market(100.0, 0.05, 0.2), [100.0, 100.0]),
        ("put", Market(100.0, 0.03, 0.2, 0.07), [100.0 * 3 / 7]),
        ("call", Market(100.0, 0.07, 0.2, 0.03), [100.0 * 7 / 3]),
    ],
)
def test_the_boundary_now_lies_beyond_its_limit_at_expiry(option_type, market, expected):
    boundary = price(Option(option_type, 100.0, 0.5), market).exercise_boundary
    assert boundary < expected[0] if option_type == "put" else boundary > expected[0]


def test_an_interrupt_before_anything_is_known_gives_no_price(put, market):
    valuation = price(put, market, interrupt=lambda: True)
    assert valuation.status == "deadline"
    assert valuation.price is None
    assert valuation.error_estimate is None


def test_an_interrupt_after_a_first_estimate_keeps_it(put, market):
    asked, most = [], math.inf

    def interrupt():
        asked.append(None)
        return len(asked) > most

    price(put, market, tolerance=1e-8, method="lcs", greeks="none", interrupt=interrupt)
    most = int(0.7 * len(asked))  # in the midst of the finest solves
    asked.clear()
    valuation = price(put, market, tolerance=1e-8, method="lcs", interrupt=interrupt)
    assert valuation.status == "deadline"
    assert valuation.price == pytest.approx(6.090371, abs=valuation.error_estimate + 2e-4)


@pytest.mark.parametrize(
    ("field", "bad"),
    [
        ("strike", 0.0),
        ("strike", -1.0),
        ("expiry", -0.1),
        ("expiry", math.nan),
        ("strike", math.inf),
        ("expiry", 201.0),
    ],
)
def test_bad_contracts_are_refused_with_field_and_value(field, bad):
    with pytest.raises(InvalidInputError, match=f"{field} = {bad}"):
        Option(**{"option_type": "put", "strike": 100.0, "expiry": 1.0, field: bad})


@pytest.mark.parametrize(
    ("field", "bad"),
    [
        ("spot", -1.0),
        ("volatility", -0.2),
        ("volatility", 15.1),
        ("rate", math.nan),
        ("rate", 2.1),
        ("spot", "100"),
        ("spot", True),
        ("dividend_yield", None),
    ],
)
def test_bad_markets_are_refused_with_field_and_value(field, bad):
    with pytest.raises(InvalidInputError, match=f"{field} = "):
        Market(**{"spot": 100.0, "rate": 0.05, "volatility": 0.2, field: bad})


@pytest.mark.parametrize(
    "arguments",
    [{"tolerance": 1e-9}, {"tolerance": 0.1}, {"method": "binomial"}, {"lcp_method": "simplex"}],
)
def test_bad_choices_are_refused(put, market, arguments):
    with pytest.raises(InvalidInputError, match=next(iter(arguments))):
        price(put, market, **arguments)


@pytest.mark.parametrize("option_type", ["put", "call"])
def test_price_is_monotone_and_convex_in_spot(option_type):
    option = Option(option_type, 100.0, 1.0)
    spots = np.linspace(60.0, 160.0, 21)
    valuations = [price(option, Market(float(s), 0.06, 0.25, 0.04), greeks="none") for s in spots]
    values = np.array([v.price for v in valuations])
    slack = max(v.error_estimate for v in valuations)
    sign = -1.0 if option_type == "put" else 1.0
    assert np.all(sign * np.diff(values) >= -2 * slack)
    assert np.all(np.diff(values, 2) >= -4 * slack)


# (option, market, a lower bound for the price): boundaries many standard deviations apart
SEPARATED = [
    (Option("put", 100.0, 0.01), Market(100.1, -1e-6, 0.05, -0.05), 0.13349996),
    (Option("put", 100.0, 1e-5), Market(100.0, -1e-9, 0.2, -0.001), 0.02523082),
    (Option("put", 100.0, 1e-9), Market(100.0001, 1e-16, 5.0, 1e-9), 0.0062579605),
    (Option("call", 100.0, 0.01), Market(99.9, -0.05, 0.05, -1e-6), 0.133),
]


@pytest.mark.parametrize(("option", "market", "least"), SEPARATED)
def test_boundaries_far_apart_are_solved_apart(option, market, least):
    valuation = price(option, market)
    assert valuation.price >= max(least, valuation.european_price, valuation.intrinsic_value)
    fine = price(option, market, tolerance=1e-8)
    assert valuation.price == pytest.approx(fine.price, abs=valuation.error_estimate + fine.error_estimate)


def test_the_boundary_near_the_strike_is_reported_from_the_other_side_of_a_wide_region():
    option = Option("put", 100.0, 0.1)
    near, far = (price(option, Market(spot, -0.01, 0.02, -0.04)) for spot in (101.0, 20.0))
    assert near.exercise_boundary == pytest.approx(far.exercise_boundary, rel=2e-3)
    assert price(option, Market(50.0, -0.01, 0.02, -0.04)).exercise_now


def test_a_wide_distribution_has_an_honest_estimate():
    """Long expiry and large volatility; 83.9688 by QuantLib 1.44, QdFp, both fixed-point systems within 3e-6."""
    market = Market(16.860180971975815, 0.12917097857694498, 1.3476298693377604, 0.03256487335717871)
    valuation = price(Option("put", 100.0, 19.75435340204466), market)
    assert abs(valuation.price - 83.9688) <= valuation.error_estimate
    assert abs(valuation.price - 83.9688) <= 1e-3


def test_a_price_at_a_very_coarse_resolution_is_never_called_good(put, market):
    for resolution in (Resolution(8, 4), Resolution(400, 4), Resolution(8, 100)):
        valuation = price(put, market, resolution=resolution)
        assert valuation.status == "tolerance_not_met"
        assert valuation.price >= valuation.european_price
        assert abs(valuation.price - 6.090371) < 1.0


def test_method_and_scheme_must_agree(put, market):
    peer = Resolution(100, 50, scheme="crank-nicolson")
    assert price(put, market, resolution=peer).method == "crank-nicolson"
    assert (
        price(put, market, method="crank-nicolson", resolution=Resolution(100, 50)).method == "crank-nicolson"
    )
    with pytest.raises(InvalidInputError, match="method"):
        price(put, market, method="lcs", resolution=peer)
    with pytest.raises(InvalidInputError, match="method"):
        price(put, market, method="crank-nicolson", resolution=Resolution(100, 50, scheme="sdirk2"))


@pytest.mark.parametrize(("option_type", "dividend_yield"), [("put", 0.0), ("call", 0.03)])
def test_a_worthless_underlying_leaves_the_boundary_where_it_is(option_type, dividend_yield):
    option = Option(option_type, 100.0, 1.0)
    zero, other = (price(option, Market(s, 0.05, 0.2, dividend_yield)) for s in (0.0, 95.0))
    assert zero.price == option.payoff(0.0)
    assert zero.exercise_boundary == pytest.approx(other.exercise_boundary, rel=1e-3)
    assert str(zero.rho) == "0.0"


@pytest.mark.parametrize("ratio", [1e-31, 1e31])
def test_spots_out_of_all_proportion_are_refused(ratio):
    with pytest.raises(InvalidInputError, match="spot"):
        price(Option("put", 1e-5, 1.0), Market(1e-5 * ratio if ratio < 1 else 1e26, 0.05, 0.2))


@pytest.mark.parametrize(
    ("arguments", "keywords", "field"),
    [
        (("put", Market(100.0, 0.05, 0.2)), {}, "option"),
        ((Option("put", 100.0, 1.0), {"spot": 100.0}), {}, "market"),
        ((Option("put", 100.0, 1.0), Market(100.0, 0.05, 0.2)), {"greeks": "no"}, "greeks"),
    ],
)
def test_an_argument_of_another_kind_is_named(arguments, keywords, field):
    with pytest.raises(InvalidInputError, match=f"^{field} = "):
        price(*arguments, **keywords)


GREEKS = (
    "delta",
    "gamma",
    "theta",
    "theta_per_day",
    "vega",
    "vega_per_point",
    "rho",
    "rho_per_point",
    "dividend_rho",
)
LISTS = ("dividend_sensitivities", "rate_buckets", "dividend_yield_buckets", "volatility_buckets")
OF_EVERY_KIND = {
    "march": (Option("put", 100.0, 1.0), Market(100.0, 0.05, 0.2)),
    "formula": (Option("put", 100.0, 1.0, "european"), Market(100.0, 0.05, 0.2)),
    "certain": (Option("put", 120.0, 1.0), Market(100.0, 0.05, 0.0)),
    "exercised": (Option("put", 100.0, 1.0), Market(60.0, 0.05, 0.2)),
    "expired": (Option("put", 100.0, 0.0), Market(60.0, 0.05, 0.2)),
    "grid": (Option("put", 100.0, 1.0), Market(90.0, -0.005, 0.2, -0.05)),
    "collocation": (
        Option("put", 100.0, 1.0),
        Market(
            100.0,
            {"times": [0.5, 1.0], "values": [0.03, 0.06]},
            0.2,
            cash_dividends=[{"time": 0.5, "amount": 2.0}],
        ),
    ),
}


@pytest.mark.parametrize("name", OF_EVERY_KIND)
def test_there_are_the_greeks_that_were_asked_for_and_no_others(name):
    contract = OF_EVERY_KIND[name]
    none, standard, extended = (
        price(*contract, tolerance=1e-4, greeks=g) for g in ("none", "standard", "extended")
    )
    assert none.greek_errors == {}
    for found in (standard, extended):
        for greek, error in found.greek_errors.items():
            value = getattr(found, greek)
            assert np.shape(value) == np.shape(error), greek
            assert np.min(error) >= 0.0, greek
    for greek in (*GREEKS, "vanna", "volga", "charm", *LISTS):
        assert getattr(none, greek) is None, greek
    for greek in GREEKS:
        assert getattr(standard, greek) is not None, greek
        assert getattr(extended, greek) == getattr(standard, greek), greek
    assert standard.vanna is standard.volga is standard.charm is standard.rate_buckets is None
    assert None not in (extended.vanna, extended.volga)
    with_events = name == "collocation"
    assert (standard.dividend_sensitivities is not None) == with_events
    assert (extended.rate_buckets is not None) == with_events
    assert (none.price, none.status) == (standard.price, standard.status)
    with pytest.raises(InvalidInputError, match="greeks"):
        price(*contract, greeks=True)


def test_the_errors_of_greeks_come_by_name_where_there_is_an_estimate(engine_with_errors):
    contract = OF_EVERY_KIND["collocation"]
    extended = price(*contract, greeks="extended")
    assert extended.greek_errors == ERRORS | {"dividend_sensitivities": (2e-5,)}
    assert (extended.gamma, extended.volga, extended.charm) == (0.5, 0.5, 0.5)
    with_curve = replace(contract[1], volatility={"times": [0.5, 1.0], "values": [0.2, 0.3]})
    assert price(contract[0], with_curve, greeks="extended").greek_errors["volatility_buckets"] == (
        3e-5,
        3e-5,
    )
    standard = {name: error for name, error in ERRORS.items() if name not in ("vanna", "charm")}
    assert price(*OF_EVERY_KIND["march"]).greek_errors == standard
    assert price(*contract, greeks="none").greek_errors == {}


def test_a_valuation_can_be_hashed_and_pickled(put, market):
    found = price(put, market, tolerance=1e-3)
    assert hash(found) == hash(pickle.loads(pickle.dumps(found)))


def test_a_contract_that_no_engine_prices_is_an_error_with_the_reason(put, market, monkeypatch):
    def refuse(*arguments, **options):
        raise ArithmeticError("out of reach")

    monkeypatch.setattr("pricing_core.american.engines.chapter.contract_problem", refuse)
    with pytest.raises(NumericalError, match="out of reach"):
        price(put, market, method="lcs")
