"""The market the option is valued in: spot, rate, yield, volatility and dividends."""

from __future__ import annotations

from dataclasses import InitVar, dataclass

from pricing_core.american.contracts.carry import carry_yield
from pricing_core.american.contracts.checks import range_in_words
from pricing_core.american.contracts.curves import Curve, PiecewiseConstant, read_curve
from pricing_core.american.contracts.dates import AnyDate, moment_of_valuation
from pricing_core.american.contracts.dividends import (
    CashDividend,
    ProportionalDividend,
    read_cash_dividends,
    read_proportional_dividends,
)
from pricing_core.american.contracts.fields import (
    BORROW_RATE,
    DIVIDEND_MODEL,
    DIVIDEND_YIELD,
    FOREIGN_RATE,
    QUANTO_COVARIANCE,
    RATE,
    SPOT,
    UNDERLYING,
    DividendModel,
    Underlying,
)
from pricing_core.american.contracts.local_volatility import Volatility, read_volatility
from pricing_core.american.contracts.names import arguments_named
from pricing_core.errors import InvalidInputError

# Largest rate or yield that counts as zero, in 1/year: ratios of smaller ones would overflow.
NEGLIGIBLE_RATE = 1e-30
# What a futures price has nothing of, and what adds to the dividend yield.
NOT_OF_FUTURES = ("dividend_yield", "borrow_rate", "foreign_rate", "cash_dividends", "proportional_dividends")
ADDED = ("borrow_rate", "rate less foreign_rate", "quanto_covariance")


@arguments_named
@dataclass(frozen=True, slots=True)
class Market:
    """Spot, continuously compounded rate and yield, the volatility of ln(spot), and dividends at known times.

    Parameters
    ----------
    spot : float
        Money per unit of underlying, 0 to 1e30.
    rate, dividend_yield : float or PiecewiseConstant
        1/year, continuously compounded, -0.5 to 2.
    volatility : float, PiecewiseConstant or LocalVolatility
        1/sqrt(year), 0 to 15.
    cash_dividends : sequence of CashDividend, {"time": ..., "amount": ...} or (time, amount)
        Kept in the order of their times.
    proportional_dividends : sequence of ProportionalDividend, {"time": ..., "fraction": ...} or (time, fraction)
        Kept in the order of their times; on one date they come before the cash dividends.
    dividend_model : {"spot", "escrowed"}
        "spot": the spot drops by each amount, and is lognormal in between. "escrowed": the spot less the present
        value of the cash dividends due by expiry is lognormal.
    underlying : {"spot", "future"}
        "future": the spot is a futures price; no yield, borrow rate, foreign rate or dividend may be given.
    borrow_rate : float or PiecewiseConstant
        1/year: the cost of borrowing the underlying, which adds to the yield.
    foreign_rate : float or PiecewiseConstant, optional
        1/year: of a quanto option, which pays the numbers of one currency in another, the rate of the underlying's.
    quanto_covariance : float
        1/year: correlation of ln(spot) and the logarithm of the price of the underlying's currency, times both
        volatilities. `carry_yield` says how these three enter.
    valuation_date : str, datetime.date, datetime.datetime or numpy.datetime64, optional
        Where it is given, dividends may have ex-dates in the place of times, as {"ex_date": ..., "amount": ...} or
        (date, amount); one before it has gone from the spot already, as one at time 0. It is not kept.

    Curves may also be given as {"times": [...], "values": [...]}, a local volatility as
    {"times": [...], "spots": [...], "values": [[...], ...]}; curves and lists also as JSON text.

    Raises
    ------
    InvalidInputError
        A field lies outside what is allowed.
    """

    spot: float
    rate: Curve
    volatility: Volatility
    dividend_yield: Curve = 0.0
    cash_dividends: tuple[CashDividend, ...] = ()
    proportional_dividends: tuple[ProportionalDividend, ...] = ()
    dividend_model: DividendModel = "spot"
    underlying: Underlying = "spot"
    borrow_rate: Curve = 0.0
    foreign_rate: Curve | None = None
    quanto_covariance: float = 0.0
    valuation_date: InitVar[AnyDate | None] = None

    def __post_init__(self, valuation_date: AnyDate | None) -> None:
        now = moment_of_valuation(valuation_date)
        object.__setattr__(self, "spot", SPOT.check(self.spot))
        for field in (RATE, DIVIDEND_YIELD):
            rate = read_curve(field, getattr(self, field.name))
            negligible = isinstance(rate, float) and abs(rate) < NEGLIGIBLE_RATE
            object.__setattr__(self, field.name, 0.0 if negligible else rate)
        object.__setattr__(self, "volatility", read_volatility(self.volatility))
        if type(self.cash_dividends) is not tuple or self.cash_dividends:
            object.__setattr__(self, "cash_dividends", read_cash_dividends(self.cash_dividends, now))
        if type(self.proportional_dividends) is not tuple or self.proportional_dividends:
            read = read_proportional_dividends(self.proportional_dividends, now)
            object.__setattr__(self, "proportional_dividends", read)
        object.__setattr__(self, "dividend_model", DIVIDEND_MODEL.check_choice(self.dividend_model))
        numbers = (self.borrow_rate, self.quanto_covariance)
        is_usual = self.underlying == "spot" and self.foreign_rate is None
        if not (is_usual and all(type(number) is float and number == 0.0 for number in numbers)):
            self._check_carry()

    def _check_carry(self) -> None:
        """Check what the yield is made of, and the yield."""
        object.__setattr__(self, "underlying", UNDERLYING.check_choice(self.underlying))
        object.__setattr__(self, "borrow_rate", read_curve(BORROW_RATE, self.borrow_rate))
        object.__setattr__(self, "quanto_covariance", QUANTO_COVARIANCE.check(self.quanto_covariance))
        if self.foreign_rate is not None:
            object.__setattr__(self, "foreign_rate", read_curve(FOREIGN_RATE, self.foreign_rate))
        if self.underlying == "future":
            for name in NOT_OF_FUTURES:
                value = getattr(self, name)
                if value not in (0.0, (), None):
                    raise InvalidInputError(name, value, "left out where the underlying is a future")
        carry = carry_yield(self)
        for number in carry.values if isinstance(carry, PiecewiseConstant) else (carry,):
            if not DIVIDEND_YIELD.least <= number <= DIVIDEND_YIELD.most:
                limits = range_in_words(*DIVIDEND_YIELD.limits)
                allowed = f"{limits}, together with all that adds to it: {', '.join(ADDED)}"
                raise InvalidInputError("dividend_yield", number, allowed)

    def has_curves(self) -> bool:
        """Whether a rate, the yield or the volatility changes with time."""
        return any(
            isinstance(curve, PiecewiseConstant)
            for curve in (
                self.rate,
                self.dividend_yield,
                self.volatility,
                self.borrow_rate,
                self.foreign_rate,
            )
        )
