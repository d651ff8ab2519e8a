"""Surfaces fitted to chains whose truth is known, with noise and without, and to quotes that are wrong or few."""

import math

import numpy as np
import pytest

from pricing_core.american import Market
from pricing_core.american.implied.black_spread import black_spread, black_time_value
from pricing_core.chains.surface.coordinates import Coordinates
from pricing_core.chains.surface.dupire import local_volatility_error, spot_volatility
from pricing_core.chains.surface.fit import fit_surface
from pricing_core.chains.surface.smile_quotes import SmileQuotes
from pricing_core.errors import InvalidInputError, NumericalError
from tests.problems.nightly import nightly
from tests.problems.smiles import EXPIRIES, TRUTHS, smile_quotes, spread_at

MARKET = Market(100.0, rate=0.03, volatility=0.2, dividend_yield=0.01)
SSVI = TRUTHS[0]


def within_two_deviations(truth, expiry):
    """Return coordinates, strikes and true volatilities up to two deviations from the forward."""
    x = np.linspace(-2.0, 2.0, 21) * spread_at(truth, expiry)
    forward = MARKET.spot * math.exp(0.02 * expiry)
    return x, forward * np.exp(x), np.sqrt(truth.total_variance(x, expiry) / expiry)


@pytest.mark.parametrize("truth", TRUTHS, ids=lambda truth: truth.name)
def test_without_noise_volatilities_are_those_of_the_model_and_arbitrage_is_proved_absent(truth):
    surface = fit_surface(smile_quotes(truth, MARKET), MARKET)
    assert surface.proof.holds
    for expiry in EXPIRIES:
        _, strike, true = within_two_deviations(truth, expiry)
        assert surface.volatility(strike, expiry) == pytest.approx(true, abs=2e-4)


@pytest.mark.parametrize("truth", [*TRUTHS[:2], *nightly(TRUTHS[2:])], ids=lambda truth: truth.name)
def test_with_noise_errors_lie_within_two_standard_errors_in_95_of_100_cases(truth):
    inside, sizes, local_inside = [], [], []
    for seed in range(5):
        surface = fit_surface(smile_quotes(truth, MARKET, noise=1.0, seed=seed), MARKET)
        assert surface.proof.holds
        for expiry in EXPIRIES:
            x, strike, true = within_two_deviations(truth, expiry)
            ratio = (surface.volatility(strike, expiry) - true) / surface.standard_error(strike, expiry)
            inside.append(np.mean(np.abs(ratio) <= 2.0))
            sizes.append(np.mean(ratio**2))
            found = spot_volatility(surface, Coordinates(MARKET, EXPIRIES[-1]), strike, expiry)
            error = local_volatility_error(surface, MARKET, strike, expiry)
            local_inside.append(np.mean(np.abs(found - truth.local_volatility(x, expiry)) <= 2.0 * error))
    # 30 smiles of some five independent errors each: the shares scatter by about 0.02, the mean square by 0.12.
    assert np.mean(inside) > 0.90
    assert np.mean(local_inside) > 0.90
    assert 0.6 < np.mean(sizes) < 1.4


@pytest.mark.nightly
@pytest.mark.parametrize("truth", TRUTHS, ids=lambda truth: truth.name)
def test_over_many_chains_the_share_within_two_standard_errors_is_near_95(truth):
    inside = []
    for seed in range(40):
        surface = fit_surface(smile_quotes(truth, MARKET, noise=1.0, seed=100 + seed), MARKET)
        for expiry in EXPIRIES:
            _, strike, true = within_two_deviations(truth, expiry)
            error = surface.standard_error(strike, expiry)
            inside.append(np.mean(np.abs(surface.volatility(strike, expiry) - true) <= 2.0 * error))
    assert 0.93 < np.mean(inside) < 0.98


def test_outliers_do_not_move_the_surface():
    quotes = smile_quotes(SSVI, MARKET, noise=0.3, seed=5)
    clean = fit_surface(quotes, MARKET)
    spoiled = []
    for smile in quotes:
        volatility = np.array(smile.volatility)
        volatility[::12] += 15.0 * smile.deviation[::12]
        spoiled.append(
            SmileQuotes(
                smile.expiry, smile.forward, smile.log_moneyness, smile.strike, volatility, smile.deviation
            )
        )
    surface = fit_surface(spoiled, MARKET)
    assert surface.proof.holds
    for smile in quotes:
        shift = surface.volatility(smile.strike, smile.expiry) - clean.volatility(smile.strike, smile.expiry)
        assert np.median(np.abs(shift) / smile.deviation) < 0.3


def test_thin_and_wrong_expiries_say_so_and_do_not_stop_the_others():
    quotes = smile_quotes(SSVI, MARKET)
    two, one_side, none = quotes[1], quotes[3], quotes[4]
    few = SmileQuotes(two.expiry, two.forward, *(c[10:30:15] for c in columns(two)))
    calls = SmileQuotes(one_side.expiry, one_side.forward, *(c[25:] for c in columns(one_side)))
    wrong = SmileQuotes(none.expiry, none.forward, *(np.full(3, np.nan) for _ in range(4)))
    surface = fit_surface([quotes[0], few, quotes[2], calls, wrong, quotes[5]], MARKET)
    assert [fit.status for fit in surface.statuses] == ["ok", "thin", "ok", "thin", "invalid_input", "ok"]
    assert surface.proof.holds
    assert surface.expiries.tolist() == [EXPIRIES[i] for i in (0, 1, 2, 3, 5)]
    for expiry in EXPIRIES:
        _, strike, true = within_two_deviations(SSVI, expiry)
        assert surface.volatility(strike, expiry) == pytest.approx(true, abs=0.02)
    error = surface.standard_error(two.strike, two.expiry)
    assert np.all(error[[10, 25]] < 1e-4)
    assert error.max() > 10.0 * error[[10, 25]].max()


def columns(smile):
    """Return the columns of a smile."""
    return smile.log_moneyness, smile.strike, smile.volatility, smile.deviation


def test_one_expiry_alone_is_a_surface():
    quotes = smile_quotes(SSVI, MARKET, expiries=(0.5,))
    surface = fit_surface(quotes, MARKET)
    assert surface.proof.holds
    assert surface.total_variance(0.0, 0.25) == pytest.approx(0.5 * SSVI.total_variance(0.0, 0.5), rel=1e-4)


def test_quotes_that_cross_or_bend_too_far_are_moved_until_arbitrage_is_proved_absent():
    quotes = []
    for i, smile in enumerate(smile_quotes(SSVI, MARKET, noise=2.0, seed=7)):
        volatility = smile.volatility * (1.3 if i == 2 else 1.0) + (0.05 if i == 4 else 0.0) * np.cos(
            8.0 * np.linspace(-2.5, 2.0, 37)
        )
        quotes.append(
            SmileQuotes(
                smile.expiry, smile.forward, smile.log_moneyness, smile.strike, volatility, smile.deviation
            )
        )
    surface = fit_surface(quotes, MARKET)
    assert surface.programmes > 0
    assert surface.proof.holds
    for late, early in zip(EXPIRIES[1:], EXPIRIES, strict=False):
        x = np.linspace(-1.0, 1.0, 81)
        assert np.all(surface.derivatives(x, late)[0] > surface.derivatives(x, early)[0])


def test_with_cash_dividends_the_surface_returns_the_volatilities_of_the_spot():
    dividends = [{"time": time, "amount": 1.2} for time in (0.2, 0.45, 0.7, 0.95)]
    market = Market(100.0, rate=0.03, volatility=0.2, cash_dividends=dividends)
    coordinates, quotes = Coordinates(market, 2.0), []
    for expiry in EXPIRIES:
        x = np.linspace(-2.5, 2.0, 33) * spread_at(SSVI, expiry)
        strike, forward = coordinates.strike(x, expiry), coordinates.forward(expiry)
        volatility = coordinates.volatility(SSVI.total_variance(x, expiry), strike, expiry)[0]
        quotes.append(
            SmileQuotes(expiry, forward, np.log(strike / forward), strike, volatility, np.full(x.size, 0.003))
        )
    surface = fit_surface(quotes, market)
    assert surface.proof.holds
    for smile in quotes:
        k = smile.log_moneyness
        assert surface.volatility(smile.strike, smile.expiry) == pytest.approx(smile.volatility, abs=1e-4)
        expected = smile.volatility**2 * smile.expiry
        assert surface.total_variance(k, smile.expiry) == pytest.approx(expected, rel=1e-3)


def test_wrong_input_has_a_clear_message():
    quotes = smile_quotes(SSVI, MARKET, expiries=(0.5,))
    with pytest.raises(InvalidInputError, match=r"expiry = 0\.5: must be given once"):
        fit_surface(quotes * 2, MARKET)
    with pytest.raises(InvalidInputError, match="quotes = 0 expiries"):
        fit_surface([], MARKET)
    with pytest.raises(InvalidInputError, match="strike"):
        SmileQuotes(0.5, 100.0, np.zeros(3), np.ones(2), np.ones(3), np.ones(3))
    with pytest.raises(InvalidInputError, match="expiry = -1"):
        fit_surface(quotes, MARKET).volatility(100.0, -1.0)


@pytest.mark.parametrize("seed", [*range(3), *nightly(range(3, 6))])
def test_quotes_that_contradict_each_other_still_give_a_proved_surface(seed):
    generator, quotes = np.random.default_rng(seed), []
    for expiry in (0.01, 0.1, 0.5, 2.0):
        x = np.sort(generator.uniform(-4.0, 3.0, generator.integers(1, 30))) * 0.3 * math.sqrt(expiry)
        volatility = 0.3 * np.exp(0.3 * generator.standard_normal(x.size))
        deviation = 10.0 ** generator.uniform(-6.0, -2.0, x.size)
        quotes.append(SmileQuotes(expiry, 100.0, x, 100.0 * np.exp(x), volatility, deviation))
    surface = fit_surface(quotes, Market(100.0, rate=0.0, volatility=0.2))
    assert surface.proof.holds
    for expiry in (0.005, 0.01, 0.3, 2.0, 3.0):
        volatility = surface.volatility(np.array([60.0, 90.0, 100.0, 110.0, 160.0]), expiry)
        assert np.all((volatility > 0.0) & (volatility < 5.0))


def of_a_jump(x):
    """Return the volatilities over five hours of a spot that in one of ten cases moves three times as far."""
    root = math.sqrt(0.0006)
    usual, far = (black_time_value(np.abs(x), np.full(x.size, size * root))[0] for size in (0.25, 0.75))
    return black_spread(np.abs(x), 0.9 * usual + 0.1 * far) / root


@pytest.mark.parametrize("kind", ["usual", "jump", "above the next expiry"])
def test_an_expiry_within_a_day_is_fitted_alone_and_changes_no_other(kind):
    longer, (soon,) = smile_quotes(SSVI, MARKET), smile_quotes(SSVI, MARKET, expiries=(0.0006,))
    volatility = {
        "usual": soon.volatility,
        "jump": of_a_jump(soon.log_moneyness),
        "above the next expiry": 20.0 * soon.volatility,
    }[kind]
    quotes = SmileQuotes(
        soon.expiry, soon.forward, soon.log_moneyness, soon.strike, volatility, soon.deviation
    )
    alone, together = fit_surface(longer, MARKET), fit_surface([quotes, *longer], MARKET)
    assert together.proof.holds
    assert len(together.statuses) == len(longer) + 1
    for expiry in EXPIRIES:
        _, strike, _ = within_two_deviations(SSVI, expiry)
        assert together.volatility(strike, expiry) == pytest.approx(
            alone.volatility(strike, expiry), abs=5e-5
        )
    if kind != "above the next expiry":
        assert together.statuses[0].status == "ok"
        near = np.abs(soon.log_moneyness) < 2.0 * spread_at(SSVI, soon.expiry)
        found = together.volatility(quotes.strike[near], quotes.expiry)
        assert found == pytest.approx(volatility[near], abs=4e-4)


@pytest.mark.parametrize("asked", [1, 8, 20, 80])
def test_every_iteration_asks_whether_to_go_on(asked):
    answers = iter([False] * asked)
    with pytest.raises(NumericalError, match="interrupted"):
        fit_surface(smile_quotes(SSVI, MARKET), MARKET, interrupt=lambda: next(answers, True))
