"""Chains of American quotes from known local volatilities, with and without cash dividends, priced by the engine."""

import datetime as dt
import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from pricing_core.american import LocalVolatility, Market, price_many
from pricing_core.american.implied.black_spread import black_spread
from pricing_core.chains.surface.coordinates import Coordinates
from tests.problems.smiles import ssvi_local

SPOT, RATE, YIELD, TOLERANCE = 100.0, 0.04, 0.01, 1e-6
EXPIRIES = np.array([14, 30, 60, 120, 240, 365, 730]) / 365.0
DIVIDENDS = [{"time": day / 365.0, "amount": 0.8} for day in range(45, 730, 90)]
DATE = dt.date(2026, 3, 2)
WIDEST = 0.55  # ln(strike/forward) of the outermost strikes, over the root of time
SPOTS = SPOT * np.exp(
    np.concatenate([np.linspace(-2.5, -1.2, 13), np.linspace(-1.15, 1.15, 155), np.linspace(1.2, 2.5, 13)])
)


@dataclass(frozen=True)
class KnownChain:
    """Options in columns of shape (n,), their American prices, and European volatilities, Black's of the forward."""

    market: Market
    option_type: np.ndarray
    strike: np.ndarray
    expiry: np.ndarray
    price: np.ndarray
    forward: np.ndarray
    volatility: np.ndarray

    @property
    def local_volatility(self) -> LocalVolatility:
        """The truth."""
        assert isinstance(self.market.volatility, LocalVolatility)
        return self.market.volatility

    @property
    def half_spread(self) -> np.ndarray:
        """Half of what bid and ask differ by, money."""
        return 0.01 + 0.005 * np.sqrt(self.price)

    @property
    def near(self) -> np.ndarray:
        """Which lie within two deviations of the forward."""
        return np.abs(np.log(self.strike / self.forward)) <= 2.0 * self.deviation(self.expiry)

    @property
    def out_of_the_money(self) -> np.ndarray:
        """Which are out of the money."""
        return (self.option_type == "call") == (self.strike >= self.forward)

    def deviation(self, time: np.ndarray) -> np.ndarray:
        """Return the standard deviation of the logarithm of the spot at times."""
        at_money = [np.interp(0.0, *self._smile(expiry)) for expiry in EXPIRIES.tolist()]
        return np.interp(time, EXPIRIES, at_money) * np.sqrt(time)

    def _smile(self, expiry: float) -> tuple[np.ndarray, np.ndarray]:
        rows = (self.expiry == expiry) & (self.option_type == "call")
        return np.log(self.strike / self.forward)[rows], self.volatility[rows]

    def table(self, mid: np.ndarray) -> dict:
        """Return quotes around these mids as `fit_chain` takes them."""
        count = mid.size
        return {
            "symbol": ["XYZ"] * count,
            "underlying_price": [SPOT] * count,
            "quote_date": [DATE] * count,
            "expiration": [DATE + dt.timedelta(days=day) for day in np.rint(365.0 * self.expiry).tolist()],
            "strike": self.strike,
            "option_type": self.option_type,
            "bid": np.maximum(mid - self.half_spread, 0.0),
            "ask": mid + self.half_spread,
        }


def displaced_volatility(shift: float, level: float) -> Callable:
    """Return sigma(S) of dS = ... + level (S + shift) dW."""
    return lambda _, spots: np.maximum(level * (spots + shift) / spots, 0.02)


def elastic_volatility(_: float, spots: np.ndarray) -> np.ndarray:
    """Return sigma(S) of constant elasticity: 0.25 at the spot, falling as its root."""
    return 0.25 * np.sqrt(SPOT / spots)


def ssvi_volatility(market: Market) -> LocalVolatility:
    """Return Dupire's local volatility of SSVI in the coordinate of the martingale."""
    coordinates, jumps = (
        Coordinates(market, float(EXPIRIES[-1])),
        [each.time for each in market.cash_dividends],
    )
    times = [0.0005, 0.002, 0.005, 0.01, 0.02, *np.linspace(0.03, 2.0, 60), *jumps]
    times = np.unique([*times, *(time - 1e-7 for time in jumps)])

    def of(time: float, spots: np.ndarray) -> np.ndarray:
        far = 1.25 * math.sqrt(time)
        x = np.clip(coordinates.x(spots, time), -far, far)
        return ssvi_local(x, time) * np.maximum(1.0 - coordinates.due(time) / spots, 0.05)

    return LocalVolatility.from_function(of, times, SPOTS)


CLASSES = ("displaced up", "displaced down", "constant elasticity", "ssvi")


def known_chain(name: str, *, dividends: bool, strikes: int = 15) -> KnownChain:
    """Return calls and puts of so many strikes per expiry.

    The truths are those of `tests.problems.smiles`: a displacement of 50 or -30, an elasticity of 1/2, and SSVI.
    """
    bare = Market(
        SPOT, rate=RATE, volatility=0.2, dividend_yield=YIELD, cash_dividends=DIVIDENDS if dividends else []
    )
    functions = {
        "displaced up": displaced_volatility(50.0, 0.18),
        "displaced down": displaced_volatility(-30.0, 0.25),
        "constant elasticity": elastic_volatility,
    }
    if name == "ssvi":
        local = ssvi_volatility(bare)
    else:
        local = LocalVolatility.from_function(functions[name], [0.0, 2.0], SPOTS)
    coordinates = Coordinates(bare, float(EXPIRIES[-1]))
    forward = np.array([coordinates.forward(time) for time in EXPIRIES.tolist()])
    steps = np.linspace(-WIDEST, WIDEST, strikes)
    strike = np.round(forward[:, None] * np.exp(steps * np.sqrt(EXPIRIES)[:, None]), 1)
    columns = {
        "option_type": np.tile(np.repeat(["call", "put"], strikes), EXPIRIES.size),
        "strike": np.tile(strike, 2).ravel(),
        "expiry": np.repeat(EXPIRIES, 2 * strikes),
    }
    shared = {"spot": SPOT, "rate": RATE, "dividend_yield": YIELD, "volatility": local}
    if dividends:
        shared["cash_dividends"] = DIVIDENDS
    table = price_many({**columns, **shared}, tolerance=TOLERANCE, greeks="none")
    forwards = np.repeat(forward, 2 * strikes)
    discount = np.exp(-RATE * columns["expiry"])
    sign = np.where(columns["option_type"] == "call", 1.0, -1.0)
    exercised = discount * np.maximum(sign * (forwards - columns["strike"]), 0.0)
    time_value = (table["european_price"] - exercised) / (discount * np.minimum(forwards, columns["strike"]))
    spread = black_spread(np.abs(np.log(columns["strike"] / forwards)), time_value)
    market = Market(
        SPOT, rate=RATE, volatility=local, dividend_yield=YIELD, cash_dividends=DIVIDENDS if dividends else []
    )
    return KnownChain(
        market,
        **columns,
        price=table["price"],
        forward=forwards,
        volatility=spread / np.sqrt(columns["expiry"]),
    )
