"""Puts marched to a tolerance: errors, their estimates, and what every American option obeys."""

from dataclasses import replace

import numpy as np
import pytest

from pricing_core.american import price_many
from pricing_core.american.engines.premium_march.flat_contracts import Puts
from pricing_core.american.engines.premium_march.puts import solve_puts
from pricing_core.arrays import BoolVector, Matrix, Vector
from tests.problems.needs_kernel import needs_kernel
from tests.problems.true_values import true_values

pytestmark = needs_kernel
TRUE_VALUES = true_values()[::3]
PARAMETERS = {"vega": "volatility", "rho": "rate", "dividend_rho": "dividend_yield"}
ROUNDING = 1e-13


def parameters(*numbers: float) -> Puts:
    """Return one put."""
    return Puts(*np.array(numbers).reshape(4, 1))


def random_puts(count: int, seed: int) -> Puts:
    """Return served puts of 5 days to 10 years, 3 % to 150 % volatility, rates and yields up to 15 %."""
    random = np.random.default_rng(seed)
    expiry = np.exp(random.uniform(np.log(5 / 365), np.log(10.0), count))
    spread = np.exp(random.uniform(np.log(0.03), np.log(1.5), count)) * np.sqrt(expiry)
    rate, dividend = random.uniform(0.0, 0.15, (2, count)) * expiry
    puts = Puts(np.log(random.uniform(0.4, 2.5, count)), rate, dividend, spread)
    return puts.take(np.flatnonzero(is_served(puts)))


def is_served(puts: Puts) -> BoolVector:
    """Whether the march takes the put."""
    return solve_puts(puts, np.full(puts.x.size, 1e-2), limits=None, most=4).steps > 0


def random_table(count: int, seed: int) -> dict[str, Vector]:
    """Return American puts and calls with a strike of 100."""
    random = np.random.default_rng(seed)
    return {
        "option_type": random.choice(["put", "call"], count),
        "spot": random.uniform(60.0, 150.0, count),
        "strike": np.full(count, 100.0),
        "expiry": random.uniform(0.02, 3.0, count),
        "rate": random.uniform(0.005, 0.12, count),
        "dividend_yield": random.uniform(0.005, 0.12, count),
        "volatility": random.uniform(0.1, 0.6, count),
    }


def distance_to_boundary(table: dict[str, Vector], boundary: Vector) -> Vector:
    """Return |ln(S/S*)| in standard deviations."""
    spread = table["volatility"] * np.sqrt(table["expiry"])
    return np.abs(np.log(table["spot"] / boundary)) / spread


def theta_identity(table: dict[str, Vector], found: dict[str, Vector]) -> Vector:
    """Return the residual of r rho + q dividend_rho + sigma vega/2 = T dV/dT, over the strike.

    V is homogeneous: it depends on r T, q T and sigma sqrt(T) alone, besides S and K.
    """
    residual = (
        table["rate"] * found["rho"]
        + table["dividend_yield"] * found["dividend_rho"]
        + 0.5 * table["volatility"] * found["vega"]
        + table["expiry"] * found["theta"]
    )
    return np.asarray(residual / table["strike"])


def reference_table() -> dict[str, list[object]]:
    return {
        "option_type": [case.option.option_type for case in TRUE_VALUES],
        "strike": [case.option.strike for case in TRUE_VALUES],
        "expiry": [case.option.expiry for case in TRUE_VALUES],
        "spot": [case.market.spot for case in TRUE_VALUES],
        "rate": [case.market.rate for case in TRUE_VALUES],
        "dividend_yield": [case.market.dividend_yield for case in TRUE_VALUES],
        "volatility": [case.market.volatility for case in TRUE_VALUES],
    }


@pytest.mark.parametrize("tolerance", [1e-4, 1e-5, 1e-6])
def test_the_stated_error_covers_the_true_one(tolerance):
    found = price_many(reference_table(), tolerance=tolerance, greeks="none")
    strike = np.array([case.option.strike for case in TRUE_VALUES])
    known = np.array([case.reference_error for case in TRUE_VALUES])
    error = np.abs(found["price"] - [case.price for case in TRUE_VALUES]) / strike
    stated = found["error_estimate"] / strike
    assert np.all(error <= tolerance + known)
    if tolerance <= 1e-6:
        assert np.all(error <= stated + known)
    elif tolerance <= 1e-5:
        assert np.all(error <= 2.0 * stated + known)
        assert np.mean(error <= stated + known) >= 0.95
    else:  # two marches only: nothing checks that they do not agree by accident
        assert np.mean(error <= 2.0 * stated + known) >= 0.95


def march(puts: Puts, steps: int) -> tuple[Matrix, Vector, Vector]:
    """Return values, boundary and stated error with so many steps, on a grid that reaches far."""
    found = solve_puts(puts, np.full(puts.x.size, 1e-10), limits=None, fewest=steps, most=steps)
    assert found.settled.all()
    return found.values, found.boundary, found.error


def test_the_error_falls_at_order_two_and_the_stated_one_follows_it():
    random = np.random.default_rng(1)
    expiry = random.uniform(0.1, 3.0, 60)
    rate, dividend = random.uniform(0.01, 0.12, 60) * expiry, random.uniform(0.0, 0.12, 60) * expiry
    spread = random.uniform(0.1, 0.6, 60) * np.sqrt(expiry)
    puts = Puts(random.uniform(-0.3, 1.5, 60) * spread, rate, dividend, spread)
    values, boundary, _ = march(puts, 192)
    held = puts.x > boundary + 0.02 * spread
    errors = []
    for steps in (8, 16, 32, 64):
        coarse_values, coarse_boundary, coarse_error = march(puts, steps)
        price = (coarse_values - values)[0, held]
        stated = np.sqrt(np.mean(coarse_error[held] ** 2))
        errors.append((np.sqrt(np.mean(price**2)), np.abs(coarse_boundary - boundary).max(), stated))
    price_error, boundary_error, stated_error = np.array(errors).T
    assert np.all(stated_error >= price_error)
    assert np.all(stated_error <= 30.0 * price_error)
    assert np.all(np.log2(price_error[:-1] / price_error[1:]) >= 2.0)
    # The boundary of eight steps is far from the asymptotic regime.
    assert np.log2(boundary_error[1] / boundary_error[3]) / 2.0 >= 1.75


def test_stated_errors_meet_the_tolerance_or_the_finest_mesh_was_used():
    puts = random_puts(60, seed=2)
    tolerance = np.full(puts.x.size, 1e-5)
    found = solve_puts(puts, tolerance, limits=None)
    met = found.error <= tolerance
    assert np.mean(found.settled & met) >= 0.97
    assert np.all(found.steps[~(found.settled & met)] >= 256)


def test_neither_payoff_nor_european_value_exceeds_the_unclamped_value_by_more_than_the_error():
    puts = random_puts(60, seed=3)
    tolerance = 1e-5
    found = solve_puts(puts, np.full(puts.x.size, tolerance), limits=None, threads=2)
    used = found.settled & ~found.exercised
    value, european = found.values[0, used], found.values[3, used]
    error = found.error[used] + ROUNDING
    assert np.all(-np.expm1(puts.x[used]) - value <= error)
    # Where the premium is far below the tolerance, it may miss 0 by three times its stated error.
    assert np.mean(european - value <= error) >= 0.98
    assert np.all(european - value <= np.maximum(error, 0.01 * tolerance))


@pytest.mark.parametrize("option_type", ["put", "call"])
@pytest.mark.parametrize("share_solves", [False, True])
@pytest.mark.parametrize(
    ("expiry", "rate", "dividend_yield", "volatility"),
    [(0.05, 0.03, 0.06, 0.3), (1.0, 0.08, 0.02, 0.2), (5.0, 0.05, 0.05, 0.5)],
)
def test_prices_are_monotone_and_convex_in_the_strike(
    option_type, share_solves, expiry, rate, dividend_yield, volatility
):
    strike = np.linspace(60.0, 160.0, 41)
    market = {"rate": rate, "dividend_yield": dividend_yield, "volatility": volatility}
    found = price_many(
        {"option_type": option_type, "spot": 100.0, "strike": strike, "expiry": expiry, **market},
        tolerance=1e-5,
        greeks="none",
        share_solves=share_solves,
    )
    assert set(found["status"]) == {"ok"}
    price, error = found["price"], found["error_estimate"] + ROUNDING * strike
    rise = np.diff(price) if option_type == "put" else -np.diff(price)
    allowed = error[1:] + error[:-1]
    assert np.all(rise >= -allowed)
    assert np.all(rise <= np.diff(strike) + allowed)
    assert np.all(np.diff(price, 2) >= -(error[2:] + 2.0 * error[1:-1] + error[:-2]))


def test_calls_are_puts_with_spot_and_strike_and_rate_and_yield_exchanged():
    """McDonald and Schroder 1998: call(S, K, r, q) = put(K, S, q, r)."""
    table = random_table(30, seed=4)
    tolerance = 10.0 ** np.random.default_rng(5).uniform(-6.0, -3.0, 30)
    exchanged = {
        **table,
        "option_type": np.where(table["option_type"] == "put", "call", "put"),
        "spot": table["strike"],
        "strike": table["spot"],
        "rate": table["dividend_yield"],
        "dividend_yield": table["rate"],
    }
    S, K = table["spot"], table["strike"]
    one = price_many({**table, "tolerance": tolerance})
    other = price_many({**exchanged, "tolerance": tolerance * K / S})
    for name, mirrored in (
        ("price", "price"),
        ("european_price", "european_price"),
        ("vega", "vega"),
        ("rho", "dividend_rho"),
        ("dividend_rho", "rho"),
        ("error_estimate", "error_estimate"),
    ):
        np.testing.assert_allclose(one[name], other[mirrored], rtol=0.0, atol=1e-12 * K.max())
    boundaries = one["exercise_boundary"] * other["exercise_boundary"]
    np.testing.assert_allclose(boundaries, S * K, rtol=1e-12)
    for name in ("status", "exercise_now"):
        np.testing.assert_array_equal(one[name], other[name])
    # V is homogeneous in S and K; where the price was lifted to a bound, its derivative was not.
    lifted = np.maximum(one["intrinsic_value"], one["european_price"]) == one["price"]
    whole = S * one["delta"] + K * other["delta"]
    np.testing.assert_allclose(whole[~lifted], one["price"][~lifted], rtol=0.0, atol=1e-12 * K.max())


def test_the_greeks_by_the_parameters_and_theta_belong_together():
    table = random_table(30, seed=6)
    found = price_many(table)
    away = distance_to_boundary(table, found["exercise_boundary"]) > 0.1
    assert np.count_nonzero(away & ~found["exercise_now"]) >= 20
    residual = np.abs(theta_identity(table, found))
    assert residual[away].max() <= 1e-5
    assert residual.max() <= 1e-4


def test_theta_is_as_exact_next_to_the_boundary():
    """1.2 % above a boundary of 63.94."""
    numbers = (64.69586318788329, 100.0, 2.6077818756983633, 0.1177442417863441, 0.10972509631708367)
    names = ("spot", "strike", "expiry", "rate", "dividend_yield")
    table = {name: np.array([number]) for name, number in zip(names, numbers, strict=True)}
    table["volatility"] = np.array([0.2706940058775208])
    found = price_many({"option_type": "put", **table})
    assert np.abs(theta_identity(table, found)).max() <= 1e-5


SMOOTH = {  # away from the boundary, and from r = q, where the boundary's start is not smooth in r and q
    "option_type": np.array(["put", "call", "put"]),
    "spot": np.array([100.0, 95.0, 100.0]),
    "strike": np.full(3, 100.0),
    "expiry": np.array([1.0, 0.5, 0.75]),
    "rate": np.array([0.08, 0.03, 0.04]),
    "dividend_yield": np.array([0.02, 0.09, 0.09]),
    "volatility": np.array([0.25, 0.3, 0.3]),
}


def derivatives(table: dict[str, Vector], steps: dict[str, Vector]) -> dict[str, Vector]:
    """Return dV/d(name) for each name by central differences of fourth order, at the smallest tolerance."""
    bumped = []
    for name, step in steps.items():
        for shift in (-2.0, -1.0, 1.0, 2.0):
            bumped.append({**table, name: table[name] + shift * step})
    book = {key: np.concatenate([each[key] for each in bumped]) for key in table}
    price = price_many(book, tolerance=1e-8, greeks="none")["price"].reshape(len(steps), 4, -1)
    differences = np.array([1.0, -8.0, 8.0, -1.0]) @ price
    return {
        name: difference / (12.0 * steps[name]) for name, difference in zip(steps, differences, strict=True)
    }


def test_the_greeks_are_the_derivatives_of_the_price():
    found = price_many(SMOOTH)
    assert distance_to_boundary(SMOOTH, found["exercise_boundary"]).min() > 0.5
    expected = derivatives(SMOOTH, {name: 0.05 * SMOOTH[name] for name in PARAMETERS.values()})
    for greek, name in PARAMETERS.items():
        np.testing.assert_allclose(found[greek], expected[name], rtol=0.0, atol=1e-5 * 100.0)


@pytest.mark.parametrize("greek", ["rho", "dividend_rho"])
def test_the_rhos_are_as_exact_for_a_call_with_a_yield_a_little_below_the_rate(greek):
    numbers = (73.82446900114677, 100.0, 1.4950885712503, 0.030128074813373, 0.029486949151832, 0.35941054673)
    names = ("spot", "strike", "expiry", "rate", "dividend_yield", "volatility")
    table = {name: np.array([number]) for name, number in zip(names, numbers, strict=True)}
    table["option_type"] = np.array(["call"])
    name = PARAMETERS[greek]
    expected = derivatives(table, {name: np.array([2e-4])})[name]
    np.testing.assert_allclose(price_many(table)[greek], expected, rtol=0.0, atol=1e-5 * 100.0)


@pytest.mark.parametrize(
    ("option_type", "spot", "delta"), [("put", [1e-3, 40.0, 60.0], -1.0), ("call", [180.0, 250.0, 1e4], 1.0)]
)
def test_in_the_exercise_region_everything_is_the_payoff(option_type, spot, delta):
    found = price_many(
        {
            "option_type": option_type,
            "spot": spot,
            "strike": 100.0,
            "expiry": 1.0,
            "rate": 0.06,
            "dividend_yield": 0.07,
            "volatility": 0.2,
        },
        tolerance=1e-5,
    )
    assert set(found["method"]) == {"premium-march"}
    assert found["exercise_now"].all()
    np.testing.assert_array_equal(found["price"], np.abs(np.array(spot) - 100.0))
    np.testing.assert_array_equal(found["price"], found["intrinsic_value"])
    np.testing.assert_array_equal(found["delta"], delta)
    for name in ("gamma", "theta", "theta_per_day", "vega", "vega_per_point", "rho", "rho_per_point"):
        np.testing.assert_array_equal(found[name], 0.0)
    np.testing.assert_array_equal(found["dividend_rho"], 0.0)
    assert found["error_estimate"].max() <= 1e-5 * 100.0


def test_exercised_puts_are_worth_one_minus_the_spot_before_they_are_scaled():
    puts = Puts(np.array([-1.0, -0.5]), *np.full((2, 2), 0.05), np.full(2, 0.2))
    found = solve_puts(puts, np.full(2, 1e-6), limits=np.full((2, 7), np.inf))
    assert found.exercised.all()
    np.testing.assert_allclose(found.values[0], 1.0 - np.exp(puts.x), rtol=1e-15)
    np.testing.assert_allclose(found.values[1], -np.exp(puts.x), rtol=1e-15)
    np.testing.assert_array_equal(found.values[4:], 0.0)


@pytest.mark.parametrize(
    ("rate", "dividend", "spread"),
    [
        (0.0, 0.0, 0.2),  # never exercised
        (-0.01, -0.05, 0.2),  # two boundaries
        (1e-10, 0.0, 0.2),
        (8.1, 0.0, 0.5),
        (0.05, 8.1, 0.5),
        (0.05, -8.1, 0.5),
        (0.05, 0.0, 1e-8),
        (0.05, 0.0, 16.1),
        (0.5, 0.0, 1e-3),  # a premium that decays within less than a cell
        (np.nan, 0.0, 0.2),
        (0.05, np.nan, 0.2),
        (0.05, 0.0, np.nan),
        (0.05, 0.0, 0.0),
        (np.inf, 0.0, 0.2),
    ],
)
def test_what_the_march_cannot_take_is_not_served(rate, dividend, spread):
    assert not is_served(parameters(0.0, rate, dividend, spread))[0]


@pytest.mark.parametrize(
    ("rate", "dividend", "spread"), [(0.05, 0.0, 0.2), (3.0, 3.0, 4.0), (1e-9, -0.01, 0.2), (0.01, 0.3, 0.3)]
)
def test_what_has_one_boundary_that_the_grid_resolves_is_served(rate, dividend, spread):
    assert is_served(parameters(0.0, rate, dividend, spread))[0]


def wide_puts(count: int, seed: int) -> tuple[Puts, Vector]:
    """Return the puts of contracts and their strikes in those of the contracts.

    Two days to five years, 5 % to 80 % volatility, rates and yields from -5 % to 20 %; a call is the put with spot and
    strike, and rate and yield, exchanged.
    """
    random = np.random.default_rng(seed)
    expiry = np.exp(random.uniform(np.log(2 / 365), np.log(5.0), count))
    spread = random.uniform(0.05, 0.8, count) * np.sqrt(expiry)
    rate, dividend = random.uniform(-0.05, 0.2, (2, count)) * expiry
    spot, is_put = random.uniform(0.5, 1.5, count), random.random(count) < 0.5
    x = np.log(spot)
    puts = Puts(
        np.where(is_put, x, -x), np.where(is_put, rate, dividend), np.where(is_put, dividend, rate), spread
    )
    rows = np.flatnonzero(puts.rate >= 0.0)
    return puts.take(rows), np.where(is_put, 1.0, spot)[rows]


def test_stated_errors_are_honest_on_a_wide_book():
    puts, strike = wide_puts(4_000, seed=20)
    truth = solve_puts(puts, np.full(puts.x.size, 1e-10), limits=None)
    assert truth.settled.all()
    for tolerance in (1e-3, 1e-4, 1e-5, 1e-6, 1e-7):
        found = solve_puts(puts, tolerance / strike, limits=None)
        error = np.abs(found.values[0] - truth.values[0])
        known = truth.error + ROUNDING
        assert found.settled.all()
        assert np.mean(error > 2.0 * found.error + known) <= 1.0 / 2000.0
        met = strike * found.error <= tolerance
        assert met.mean() >= 0.998
        assert np.all((strike * (error - known))[met] <= tolerance)


def near_puts(count: int, seed: int) -> tuple[Puts, Vector]:
    """Return puts whose yield is within a tenth of a per cent to some per cent of the rate, and their years."""
    random = np.random.default_rng(seed)
    expiry = np.exp(random.uniform(np.log(2 / 365), np.log(5.0), count))
    spread = random.uniform(0.05, 0.8, count) * np.sqrt(expiry)
    rate = random.uniform(0.001, 0.2, count)
    apart = 10.0 ** random.uniform(-7.0, -2.0, count) * random.choice([-1.0, 0.0, 1.0, 1.0], count)
    x = random.uniform(-3.0, 3.0, count) * spread
    dividend = np.maximum(rate + apart, 0.0)
    return Puts(np.clip(x, -0.7, 0.4), rate * expiry, dividend * expiry, spread), expiry


@pytest.mark.parametrize("steps", [24, 96, 384])
def test_no_march_loses_a_boundary_that_leaves_its_limit_at_expiry(steps):
    apart = np.concatenate([[0.0], 10.0 ** np.linspace(-8.0, 0.0, 161)])
    for rate, spread in ((5e-5, 0.0122), (3.3e-4, 0.0239), (0.054, 0.485), (0.3, 0.2)):
        columns = [np.full(apart.size, number) for number in (0.2 * spread, rate, spread)]
        puts = Puts(columns[0], columns[1], rate * (1.0 + apart), columns[2])
        found = solve_puts(puts, np.full(apart.size, 1e-14), limits=None, fewest=steps, most=steps)
        assert found.settled.all()
        # The value is smooth in the yield.
        value = found.values[0]
        assert np.all(np.diff(value)[puts.dividend[1:] > 0.0] >= -1e-12)
        assert np.all(found.error <= 1e-4)


@pytest.mark.parametrize(("name", "row"), [("rate", 4), ("dividend", 5)])
def test_the_rhos_are_right_where_rate_and_yield_are_close(name, row):
    puts, expiry = near_puts(1500, seed=21)
    allowed = 1e-5  # strikes per 1.00 of rate or yield
    limits = np.full((expiry.size, 7), np.inf)
    limits[:, row] = allowed / expiry
    found = solve_puts(puts, np.full(expiry.size, 1e-6), limits=limits)
    old, rhos = getattr(puts, name), []
    settled = found.settled & ~found.exercised
    for share in (4e-3, 2e-3):
        step = np.minimum(share * puts.rate, 0.05 * share * expiry)
        up, down, up_twice, down_twice = (
            solve_puts(
                replace(puts, **{name: old + times * step}),
                np.full(expiry.size, 1e-14),
                limits=None,
                fewest=128,
                most=128,
            )
            for times in (1.0, -1.0, 2.0, -2.0)
        )
        for side in (up, down, up_twice, down_twice):
            assert side.settled.all()
            settled &= ~side.exercised
        near, far = (one.values[0] - other.values[0] for one, other in ((up, down), (up_twice, down_twice)))
        rhos.append(expiry * (8.0 * near - far) / (12.0 * step))
    settled &= np.abs(rhos[0] - rhos[1]) <= 0.3 * allowed
    assert settled.sum() >= 1200
    error = np.abs(expiry * found.values[row] - rhos[0])[settled]
    assert np.mean(error <= 1.3 * allowed) >= 0.997
    assert np.all(error <= 10.0 * allowed)


@pytest.mark.parametrize("tolerance", [1e-3, 1e-4, 1e-6])
def test_puts_that_even_without_expiry_are_exercised_have_no_error(tolerance):
    puts = random_puts(2000, seed=22)
    drift = (puts.rate - puts.dividend) / puts.spread - 0.5 * puts.spread
    decay = drift + np.sqrt(drift * drift + 2.0 * puts.rate)  # of the premium without expiry, over the spread
    perpetual = -np.log1p(puts.spread / decay)
    deep = puts.take(np.flatnonzero(puts.x <= perpetual))
    assert deep.x.size >= 100
    found = solve_puts(deep, np.full(deep.x.size, tolerance), limits=None)
    assert found.exercised.all()
    assert np.all(found.error <= 1e-14)
