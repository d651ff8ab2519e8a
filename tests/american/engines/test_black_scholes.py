"""Greeks of the formula and their rounding errors against differences of the value in 100 decimal digits."""

from decimal import Decimal, localcontext

import numpy as np
import pytest

from pricing_core.american import Market, Option
from pricing_core.american.book.book import Book
from pricing_core.american.book.prices import error_of
from pricing_core.american.engines.black_scholes import european_columns

STEP = Decimal("1e-20")
PI = Decimal(
    "3.14159265358979323846264338327950288419716939937510582097494459230781640628620899862803482534211706798"
)
# Each Greek as a mixed derivative of the value by these of (spot, rate, volatility, dividend yield, expiry), and sign.
DERIVATIVES = {
    "delta": ((0,), 1),
    "gamma": ((0, 0), 1),
    "theta": ((4,), -1),
    "vega": ((2,), 1),
    "rho": ((1,), 1),
    "dividend_rho": ((3,), 1),
    "vanna": ((0, 2), 1),
    "volga": ((2, 2), 1),
    "charm": ((0, 4), -1),
}


def normal(x):
    """Return the normal distribution function by its power series."""
    term = total = x
    k = 1
    while abs(term) > Decimal("1e-90"):
        k += 2
        term *= x * x / k
        total += term
    return Decimal("0.5") + total * (-x * x / 2).exp() / (2 * PI).sqrt()


def exact_value(sign, strike, parameters):
    """Return the value; `sign` is 1 for a call."""
    spot, rate, volatility, dividend_yield, expiry = parameters
    spread = volatility * expiry.sqrt()
    d1 = ((spot / strike).ln() + (rate - dividend_yield) * expiry) / spread + spread / 2
    stock = spot * (-dividend_yield * expiry).exp() * normal(sign * d1)
    return sign * (stock - strike * (-rate * expiry).exp() * normal(sign * (d1 - spread)))


def difference(of, at, by):
    """Return the central difference of a function by each of these arguments in turn."""
    if not by:
        return of(at)
    up, down = list(at), list(at)
    up[by[0]] += STEP
    down[by[0]] -= STEP
    return (difference(of, up, by[1:]) - difference(of, down, by[1:])) / (2 * STEP)


@pytest.mark.parametrize("greek", DERIVATIVES)
def test_a_greek_is_within_its_rounding_error_of_the_derivative(greek):
    rng = np.random.default_rng(7)
    estimates, errors = [], []
    by, factor = DERIVATIVES[greek]
    for _ in range(100):
        expiry, volatility = float(np.exp(rng.uniform(np.log(1e-4), np.log(10.0)))), rng.uniform(0.05, 1.0)
        rate, dividend_yield = rng.uniform(-0.05, 0.2, 2)
        spot = 100.0 * float(np.exp(rng.uniform(-3.0, 3.0) * volatility * np.sqrt(expiry)))
        kind = str(rng.choice(["put", "call"]))
        contract = Option(kind, 100.0, expiry, "european"), Market(spot, rate, volatility, dividend_yield)
        found = european_columns(Book.of([contract]), "extended")
        with localcontext() as context:
            context.prec = 100
            at = [Decimal(float(number)) for number in (spot, rate, volatility, dividend_yield, expiry)]
            sign = 1 if kind == "call" else -1
            wanted = factor * difference(lambda p, s=sign: exact_value(s, Decimal(100), p), at, by)
            errors.append(float(abs(Decimal(float(found[greek][0])) - wanted)))
        estimates.append(found[error_of(greek)][0])
    assert (np.array(errors) <= estimates).mean() >= 0.98
    assert np.median(estimates) <= 30.0 * np.median(errors)
