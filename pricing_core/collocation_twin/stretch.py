"""A stretch of time without events, and the event at its end, in units of the strike and of years."""

import math
from dataclasses import dataclass

from pricing_core.collocation_twin.flow import Flow


@dataclass(frozen=True, slots=True)
class Stretch:
    """As `pricing_core.american.contracts.schedule.Segment`; s is the time to its end.

    Parameters
    ----------
    sign : float
        1 for a put, -1 for a call.
    flow : Flow
    duration : float
    exercisable, exercise_at_end : bool
    fraction, amount : float
        At the end the spot drops from S to max(S (1 - fraction) - amount, 0).
    escrow : float
        At the end, before that drop.
    """

    sign: float
    flow: Flow
    duration: float
    exercisable: bool
    exercise_at_end: bool
    fraction: float
    amount: float
    escrow: float

    @property
    def spread(self) -> float:
        """The deviation of ln(spot) over the stretch."""
        return self.flow.volatility * math.sqrt(self.duration)

    @property
    def is_continuous(self) -> bool:
        """Whether nothing happens to the spot at the end."""
        return self.fraction == 0.0 and self.amount == 0.0

    def strike(self, s: float) -> float:
        """Return what exercise is measured against, K - A over K."""
        return 1.0 - self.escrow * math.exp(-self.flow.rate * s)

    def payoff(self, x: float, s: float) -> float:
        """Return what exercise brings, which may be negative."""
        return self.sign * (self.strike(s) - math.exp(x))

    def can_pay(self) -> bool:
        """Whether holding can cost anything: the multiplier is positive at some spot."""
        rate, dividend, _ = self.flow
        first, second = (rate, dividend) if self.sign > 0.0 else (dividend, rate)
        return first > 0.0 or (first == 0.0 and second < 0.0)

    def is_two_sided(self) -> bool:
        """Whether the contact set can have two ends: q < r < 0 for a put, r < q < 0 for a call."""
        rate, dividend, _ = self.flow
        return (dividend < rate < 0.0) if self.sign > 0.0 else (rate < dividend < 0.0)

    def furthest(self) -> float:
        """Return the x beyond which the multiplier is negative: ln(r/q), infinite where it never is."""
        rate, dividend, _ = self.flow
        if rate > 0.0 and dividend > 0.0:
            return math.log(rate / dividend)
        return self.sign * math.inf

    def perpetual(self) -> float:
        """Return the boundary of the option that never expires, as ln(S*/K); infinite where it is never exercised."""
        rate, _, volatility = self.flow
        square = self.flow.drift**2 + 2.0 * volatility**2 * rate
        if square >= 0.0:
            exponent = (-self.flow.drift - self.sign * math.sqrt(square)) / volatility**2
            if exponent != 1.0 and exponent / (exponent - 1.0) > 0.0:
                return math.log(exponent / (exponent - 1.0))
        return -self.sign * math.inf

    def gone(self) -> float:
        """Return the x up to which the event takes the whole spot."""
        kept = 1.0 - self.fraction
        return math.log(self.amount / kept) if self.amount > 0.0 and kept > 0.0 else -math.inf

    def parted(self, s: float) -> "tuple[Stretch, Stretch]":
        """Cut the stretch at time s to its end: the earlier part and the later one, which keeps the event."""
        earlier = Stretch(
            self.sign, self.flow, self.duration - s, self.exercisable, self.exercisable, 0.0, 0.0,
            self.escrow * math.exp(-self.flow.rate * s),
        )  # fmt: skip
        later = Stretch(
            self.sign,
            self.flow,
            s,
            self.exercisable,
            self.exercise_at_end,
            self.fraction,
            self.amount,
            self.escrow,
        )
        return earlier, later
