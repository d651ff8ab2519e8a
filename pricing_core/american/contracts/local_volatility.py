"""Volatilities that depend on the spot and on time, given at nodes: local volatility."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from pricing_core.american.contracts.carry import carry_yield
from pricing_core.american.contracts.checks import real_number
from pricing_core.american.contracts.curves import Curve, integral, read_curve, seen_from
from pricing_core.american.contracts.fields import LOCAL_SPOTS, LOCAL_TIMES, LOCAL_VALUES, VOLATILITY
from pricing_core.american.contracts.json_text import from_text
from pricing_core.arrays import Matrix, Vector
from pricing_core.errors import InvalidInputError, Told

if TYPE_CHECKING:
    from pricing_core.american.contracts.market import Market

MOST_NUMBERS = 100_000  # Largest number of values of a surface; chosen.
KEYS = {"times", "spots", "values"}
SLOPE_STEP = 1e-5  # Step of the spot for the slope of the variance, as a share of it; chosen.


@dataclass(frozen=True, eq=False)
class LocalVolatility:
    """The volatility sigma(t, S) of dS = (r - q) S dt + sigma(t, S) S dW (Dupire 1994), given at nodes.

    At each of the times sigma is a monotone cubic in ln S through the values (Fritsch and Butland 1984), and in between
    sigma**2 is linear in time; outside the nodes it is that of the nearest one. With escrowed dividends S is the spot
    less what these are worth.

    Parameters
    ----------
    times : array_like, shape (m,)
        Years from now, increasing, 0 or more.
    spots : array_like, shape (n,)
        Money, increasing, above 0.
    values : array_like, shape (m, n)
        1/sqrt(year), 0 to 15, by time and then by spot. At most 100,000.

    Raises
    ------
    InvalidInputError
        An axis does not increase, a number lies outside what is allowed, or the shapes do not fit.

    Examples
    --------
    >>> surface = LocalVolatility([0.0, 1.0], [80.0, 100.0, 120.0], [[0.3, 0.2, 0.2], [0.4, 0.3, 0.3]])
    >>> float(surface.at(0.0, 80.0)), surface.at(2.0, [100.0, 500.0]).tolist()
    (0.3, [0.3, 0.3])
    """

    times: Vector
    spots: Vector
    values: Matrix

    def __post_init__(self) -> None:
        times = _axis("times", self.times, *LOCAL_TIMES.limits, LOCAL_TIMES.most_entries)
        spots = _axis("spots", self.spots, *LOCAL_SPOTS.limits, LOCAL_SPOTS.most_entries)
        values = _values(self.values, times.size, spots.size)
        for name, array in (("times", times), ("spots", spots), ("values", values)):
            array.flags.writeable = False
            object.__setattr__(self, name, array)

    @cached_property
    def slopes(self) -> Matrix:
        """The slopes of the cubics by ln S at the nodes, shape (m, n)."""
        return _monotone_slopes(np.log(self.spots), self.values)

    @cached_property
    def is_steady(self) -> bool:
        """Whether it is the same at all times."""
        return bool((self.values == self.values[0]).all())

    @cached_property
    def _key(self) -> int:
        return hash((self.times.tobytes(), self.spots.tobytes(), self.values.tobytes()))

    @classmethod
    def from_function(
        cls, function: Callable[[float, Vector], ArrayLike], times: ArrayLike, spots: ArrayLike
    ) -> LocalVolatility:
        """Return the surface that agrees with `function(time, spots)` at the nodes.

        Parameters
        ----------
        function : callable
            Takes a time and an array of spots, and returns an array of volatilities, or one for all.
        """
        axes = [np.array(axis, dtype=np.float64) for axis in (times, spots)]
        rows = [np.broadcast_to(function(float(time), axes[1]), axes[1].shape) for time in axes[0]]
        return cls(axes[0], axes[1], np.array(rows))

    @classmethod
    def from_forward_moneyness(
        cls, times: ArrayLike, log_moneyness: ArrayLike, values: ArrayLike, market: Market
    ) -> LocalVolatility:
        """Return the surface given at k = ln(S/F(t)), F(t) the market's forward without discrete dividends.

        Its spots are those of all nodes, e^k F(t) for every k and t, at each time flat outside that time's own.

        Parameters
        ----------
        times : array_like, shape (m,)
        log_moneyness : array_like, shape (n,)
            Increasing.
        values : array_like, shape (m, n)
        market : Market
            Its volatility and dividends at known times are not used.
        """
        years = _axis("times", times, *LOCAL_TIMES.limits, LOCAL_TIMES.most_entries)
        moneyness = _axis("log_moneyness", log_moneyness, -50.0, 50.0, LOCAL_SPOTS.most_entries)
        given = _values(values, years.size, moneyness.size)
        growth = [integral(market.rate, t) - integral(carry_yield(market), t) for t in years.tolist()]
        logs = moneyness[None, :] + np.log(market.spot) + np.array(growth)[:, None]
        together = np.unique(np.round(logs, 12))
        if together.size > LOCAL_SPOTS.most_entries or together.size * years.size > MOST_NUMBERS:
            most = min(LOCAL_SPOTS.most_entries, MOST_NUMBERS // years.size)
            together = np.linspace(together[0], together[-1], most)
        slopes = _monotone_slopes(moneyness, given)
        rows = [
            _interpolated(own, value[None], slope[None], together)[0]
            for own, value, slope in zip(logs, given, slopes, strict=True)
        ]
        return cls(years, np.exp(together), np.array(rows))

    def __repr__(self) -> str:
        """Return the numbers of its nodes."""
        return f"LocalVolatility({self.times.size} times, {self.spots.size} spots)"

    def __eq__(self, other: object) -> bool:
        """Whether all nodes and values are the same."""
        if not isinstance(other, LocalVolatility):
            return NotImplemented
        pairs = ((getattr(self, name), getattr(other, name)) for name in ("times", "spots", "values"))
        return all(np.array_equal(mine, theirs) for mine, theirs in pairs)

    def __hash__(self) -> int:
        """Return a number that equal surfaces share."""
        return self._key

    def at(self, time: float, spots: ArrayLike) -> Any:
        """Return sigma at a time, years from now, and at spots of any shape, money, 0 or more."""
        places = np.asarray(spots, dtype=np.float64)
        variance = hat_weights(self.times, np.array([time])) @ self.at_nodes_of_time(places.ravel()) ** 2
        return np.sqrt(variance).reshape(places.shape)

    def at_nodes_of_time(self, spots: Vector) -> Matrix:
        """Return sigma at each of its times and at k spots, shape (m, k)."""
        with np.errstate(divide="ignore"):
            return _interpolated(np.log(self.spots), self.values, self.slopes, np.log(spots))

    def extrapolated(self, spot: float, strike: float, expiry: float) -> str:
        """Return one sentence that names what lies outside the nodes, of a contract's spot, strike and expiry.

        The sentence is empty where all three lie inside.
        """
        axes = (("spot", spot, self.spots), ("strike", strike, self.spots), ("expiry", expiry, self.times))
        outside = [
            name
            for name, place, nodes in axes
            if nodes.size > 1 and (place > nodes[-1] or (name != "expiry" and place < nodes[0]))
        ]
        if not outside:
            return ""
        verb = "lies" if len(outside) == 1 else "lie"
        return (
            f"{' and '.join(outside)} {verb} outside the nodes of the local volatility, which is flat there"
        )

    def variance_slope(self, spot: float) -> float:
        """Return d sigma**2 / dS now."""
        step = SLOPE_STEP * spot
        low, high = self.at(0.0, np.array([spot - step, spot + step])) ** 2
        return float((high - low) / (2.0 * step))

    def moved(self, factor: float) -> LocalVolatility:
        """Return the surface with every spot multiplied by `factor`, a number above 0."""
        return LocalVolatility(self.times, factor * self.spots, self.values)

    def shifted(self, by: float) -> LocalVolatility:
        """Return the surface with a number added to every value.

        Raises
        ------
        InvalidInputError
            A value becomes negative, or larger than allowed.
        """
        return LocalVolatility(self.times, self.spots, self.values + by)

    def seen_from(self, time: float) -> LocalVolatility:
        """Return the surface as a function of the years after `time`, at the same spots."""
        later = self.times > time
        times = np.concatenate([[0.0], self.times[later] - time])
        values = np.concatenate([self.at(time, self.spots)[None], self.values[later]])
        return LocalVolatility(times, self.spots, values)

    def reference(self, spot: float, strike: float, expiry: float) -> float:
        """Return one volatility that may stand for all of them where only the order of magnitude matters.

        It is the root mean square up to `expiry` at the spot, the strike and their geometric mean, or the largest value
        where that is 0.
        """
        places = np.array([spot, strike, np.sqrt(spot) * np.sqrt(strike)])
        mean = np.mean(
            mean_weights(self.times, np.array([0.0]), np.array([expiry])) @ self.at_nodes_of_time(places) ** 2
        )
        return float(np.sqrt(mean)) or float(self.values.max())


Volatility: TypeAlias = Curve | LocalVolatility


def read_volatility(value: object) -> Volatility:
    """Return a number, a curve or a surface as it is meant, see `read_curve`.

    Raises
    ------
    InvalidInputError
        It is none of them; the message names the field.
    """
    if isinstance(value, LocalVolatility):
        return value
    if isinstance(value, str) and '"spots"' in value:
        return _surface(value)
    if isinstance(value, Mapping) and set(value) == KEYS:
        try:
            return LocalVolatility(value["times"], value["spots"], value["values"])
        except InvalidInputError as fault:
            raise fault.called(f"{VOLATILITY.name}.{fault.field}") from None
    return read_curve(VOLATILITY, value)


@lru_cache(maxsize=16)
def _surface(text: str) -> Volatility:
    """Return the surface that a text is the JSON of, which may be long, and that of many contracts."""
    return read_volatility(from_text(VOLATILITY, text))


def volatility_seen_from(volatility: Volatility, time: float) -> Volatility:
    """Return the volatility as a function of the years after `time`."""
    if isinstance(volatility, LocalVolatility):
        return volatility.seen_from(time)
    return seen_from(volatility, time)


def hat_weights(nodes: Vector, times: Vector) -> Matrix:
    """Return the weights of the values at m nodes in their linear interpolant at k times, shape (k, m)."""
    weights = np.zeros((times.size, nodes.size))
    rows, inside = np.arange(times.size), np.clip(times, nodes[0], nodes[-1])
    above = np.clip(np.searchsorted(nodes, inside), 1, max(nodes.size - 1, 1))
    if nodes.size == 1:
        return weights + 1.0
    share = (inside - nodes[above - 1]) / (nodes[above] - nodes[above - 1])
    weights[rows, above - 1], weights[rows, above] = 1.0 - share, share
    return weights


def mean_weights(nodes: Vector, starts: Vector, ends: Vector) -> Matrix:
    """Return the weights of these values in the mean of the interpolant over k intervals, shape (k, m)."""
    weights = hat_weights(nodes, 0.5 * (starts + ends))
    first, last = np.searchsorted(nodes, starts, side="right"), np.searchsorted(nodes, ends)
    rows = np.flatnonzero((last > first) & (ends > starts)).tolist()
    if not rows:
        return weights
    cuts = [np.concatenate([[starts[row]], nodes[first[row] : last[row]], [ends[row]]]) for row in rows]
    middles = hat_weights(nodes, np.concatenate([0.5 * (cut[1:] + cut[:-1]) for cut in cuts]))
    done = 0
    for row, cut in zip(rows, cuts, strict=True):
        widths = np.diff(cut) / (ends[row] - starts[row])
        weights[row] = widths @ middles[done : done + widths.size]
        done += widths.size
    return weights


def _axis(name: str, given: object, least: float, most: float, longest: int) -> Vector:
    """Return an axis of a surface, checked."""
    axis: Vector = _numbers(name, given, 1)
    if not 1 <= axis.size <= longest:
        raise InvalidInputError(name, Told(f"{axis.size} entries"), f"1 to {longest} numbers")
    outside = ~((axis >= least) & (axis <= most))
    if outside.any():
        at = int(np.argmax(outside))
        raise InvalidInputError(f"{name}[{at}]", axis.item(at), f"a number from {least:g} to {most:g}")
    if (np.diff(axis) <= 0.0).any():
        raise InvalidInputError(name, Told("an axis that does not increase"), "increasing")
    return axis


def _values(given: object, times: int, spots: int) -> Matrix:
    """Return the values of a surface, checked."""
    allowed = f"{times} lists, one for each time, of {spots} numbers, one for each spot"
    if times * spots > MOST_NUMBERS:
        raise InvalidInputError("values", Told(f"{times * spots} numbers"), f"at most {MOST_NUMBERS} numbers")
    size = given.size if isinstance(given, np.ndarray) else 0
    if size > MOST_NUMBERS:
        raise InvalidInputError("values", Told(f"{size} numbers"), f"at most {MOST_NUMBERS} numbers")
    if isinstance(given, list | tuple):
        if len(given) != times:
            raise InvalidInputError("values", Told(f"{len(given)} lists"), allowed)
        for place, row in enumerate(given):
            if not isinstance(row, list | tuple | np.ndarray) or len(row) != spots:
                length = len(row) if isinstance(row, list | tuple | np.ndarray) else 0
                told = Told(f"{length} numbers")
                raise InvalidInputError(f"values[{place}]", told, f"a list of {spots} numbers")
    values: Matrix = _numbers("values", given, 2)
    if values.shape != (times, spots):
        raise InvalidInputError("values", Told(f"an array of shape {values.shape}"), allowed)
    least, most = LOCAL_VALUES.limits
    outside = ~((values >= least) & (values <= most))
    if outside.any():
        at, column = np.argwhere(outside)[0].tolist()
        allowed = f"a number from {least:g} to {most:g}"
        raise InvalidInputError(f"values[{at}][{column}]", values.item(at, column), allowed)
    return values


def _numbers(name: str, given: object, axes: int) -> Any:
    """Return numbers as a new array of float with so many axes."""
    allowed = "a list of numbers" if axes == 1 else "a list of lists of numbers"
    if not isinstance(given, list | tuple | np.ndarray):
        raise InvalidInputError(name, given, allowed)
    try:
        array = np.array(given)
    except ValueError:
        raise InvalidInputError(name, Told("lists of different lengths"), allowed) from None
    if array.dtype.kind == "O":
        array = np.array([real_number(name, entry) for entry in array.ravel()]).reshape(array.shape)
    if array.dtype.kind not in "fiu" or array.ndim != axes or array.size == 0:
        raise InvalidInputError(name, Told("something else"), allowed)
    return array.astype(np.float64)


def _monotone_slopes(x: Vector, values: Matrix) -> Matrix:
    """Return the slopes at the nodes of a cubic that is monotone where the values are, shape (m, n).

    Fritsch and Butland (1984); at the two ends the three-point formula, cut so that the cubic stays monotone.
    """
    slopes = np.zeros_like(values)
    if x.size == 1:
        return slopes
    h, secants = np.diff(x), np.diff(values, axis=1) / np.diff(x)
    if x.size == 2:
        return slopes + secants
    left, right = secants[:, :-1], secants[:, 1:]
    first, second = 2.0 * h[1:] + h[:-1], h[1:] + 2.0 * h[:-1]
    same = left * right > 0.0
    one = np.ones_like(left)
    harmonic = first / np.where(same, left, one) + second / np.where(same, right, one)
    slopes[:, 1:-1] = np.where(same, (first + second) / harmonic, 0.0)
    for end, near, far in ((0, 0, 1), (-1, -1, -2)):
        own, other = secants[:, near], secants[:, far]
        slope = ((2.0 * h[near] + h[far]) * own - h[near] * other) / (h[near] + h[far])
        slope = np.where(slope * own <= 0.0, 0.0, slope)
        steep = (own * other < 0.0) & (np.abs(slope) > 3.0 * np.abs(own))
        slopes[:, end] = np.where(steep, 3.0 * own, slope)
    return slopes


def _interpolated(x: Vector, values: Matrix, slopes: Matrix, places: Vector) -> Matrix:
    """Return the cubics through the nodes at k places, flat outside, shape (m, k)."""
    if x.size == 1:
        return np.repeat(values, places.size, axis=1)
    inside = np.clip(places, x[0], x[-1])
    k = np.clip(np.searchsorted(x, inside) - 1, 0, x.size - 2)
    h = x[k + 1] - x[k]
    u = (inside - x[k]) / h
    rise = u * u * (3.0 - 2.0 * u)
    start, end = u * (1.0 - u) ** 2 * h, u * u * (u - 1.0) * h
    low, high = values[:, k], values[:, k + 1]
    found: Matrix = low + rise * (high - low) + start * slopes[:, k] + end * slopes[:, k + 1]
    return np.clip(found, np.minimum(low, high), np.maximum(low, high))
