"""Events so close together that they are taken as one: nothing changes but the time that a price takes."""

import numpy as np
import pytest

from pricing_core.american import price_many
from tests.problems.needs_kernel import needs_kernel

pytestmark = needs_kernel
KINDS = (
    "two cash dividends",
    "cash, then a fraction",
    "a fraction, then cash",
    "escrowed",
    "dividend, then expiry",
    "dividend, then knot",
    "knot, then dividend",
    "dividend, then exercise date",
    "exercise date, then dividend",
)
# What waits for an exercise date after a dividend, and could not before it, is not one event with that.
APART = "dividend, then exercise date"


def contract(random, kind, years):
    """Return a random contract with two events of a kind so many years apart."""
    expiry = random.uniform(0.3, 3.0)
    first = random.uniform(0.1, 0.9) * expiry
    second, (amount, other) = first + years, random.uniform(0.2, 3.0, 2)
    row = {
        "option_type": str(random.choice(["put", "call"])),
        "spot": random.uniform(70.0, 140.0),
        "strike": 100.0,
        "expiry": expiry,
        "rate": random.uniform(0.0, 0.08),
        "dividend_yield": random.uniform(0.0, 0.06),
        "volatility": random.uniform(0.1, 0.7),
        "cash_dividends": [{"time": first, "amount": amount}],
    }
    curve = {"times": [first, expiry], "values": [0.03, 0.05]}
    paid_second = [{"time": second, "amount": amount}]
    return (
        row
        | {
            "two cash dividends": {
                "cash_dividends": [*row["cash_dividends"], {"time": second, "amount": other}]
            },
            "cash, then a fraction": {"proportional_dividends": [{"time": second, "fraction": 0.01 * other}]},
            "a fraction, then cash": {
                "cash_dividends": paid_second,
                "proportional_dividends": [{"time": first, "fraction": 0.01 * other}],
            },
            "escrowed": {
                "cash_dividends": [*row["cash_dividends"], {"time": second, "amount": other}],
                "dividend_model": "escrowed",
            },
            "dividend, then expiry": {"cash_dividends": [{"time": expiry - years, "amount": amount}]},
            "dividend, then knot": {"rate": {**curve, "times": [second, expiry]}},
            "knot, then dividend": {"cash_dividends": paid_second, "rate": curve},
            "dividend, then exercise date": {"exercise": "bermudan", "exercise_times": [second, expiry]},
            "exercise date, then dividend": {
                "cash_dividends": paid_second,
                "exercise": "bermudan",
                "exercise_times": [first, expiry],
            },
        }[kind]
    )


def table(row, **asked):
    return price_many({name: [value] for name, value in row.items()}, threads=1, **asked)


@pytest.mark.parametrize("count", [5, pytest.param(24, marks=pytest.mark.nightly)])
@pytest.mark.parametrize("kind", KINDS)
def test_the_price_is_that_of_the_march_of_obstacle_problems(kind, count):
    random = np.random.default_rng(KINDS.index(kind))
    for _ in range(count):
        row = contract(random, kind, 10.0 ** random.uniform(-11.0, -5.0))
        found, fine = table(row, greeks="none"), table(row, greeks="none", tolerance=1e-7, method="lcs")
        assert found["status"][0] == "ok"
        allowed = found["error_estimate"][0] + fine["error_estimate"][0]
        assert abs(found["price"][0] - fine["price"][0]) <= allowed, row


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind != APART])
def test_seconds_apart_they_are_priced_by_the_collocation(kind):
    random = np.random.default_rng(100 + KINDS.index(kind))
    for _ in range(20):
        row = contract(random, kind, 10.0 ** random.uniform(-11.0, -8.0))
        assert table(row, greeks="none")["method"][0] in ("multiplier-collocation", "closed-form"), row


@pytest.mark.parametrize("option_type", ["put", "call"])
@pytest.mark.parametrize("model", ["spot", "escrowed"])
def test_greeks_are_those_of_events_at_the_same_time(option_type, model):
    names = ("delta", "gamma", "theta", "vega", "rho", "dividend_rho", "vanna", "charm")
    random = np.random.default_rng(7)
    kind = "escrowed" if model == "escrowed" else "two cash dividends"
    for _ in range(10):
        row = contract(random, kind, 0.0) | {"option_type": option_type}
        first, second = row["cash_dividends"]
        apart = row | {"cash_dividends": [first, {**second, "time": first["time"] + 2e-7}]}
        same, close = (table(each, greeks="extended", greek_errors=True) for each in (row, apart))
        for name in names:
            allowed = 1e-6 * 100.0 + same[f"{name}_error"][0] + close[f"{name}_error"][0]
            assert abs(close[name][0] - same[name][0]) <= allowed, (name, row)
        listed = "dividend_sensitivities"
        allowed = 1e-6 + np.add(close[f"{listed}_error"][0], same[f"{listed}_error"][0])
        assert np.all(np.abs(np.subtract(close[listed][0], same[listed][0])) <= allowed), row
