"""QuantLib's American engines on the same contracts: prices, times, and reference values (extra [bench]).

Curves are flat and continuously compounded, days are counted Actual/360, so that both sides see the same numbers.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import partial
from importlib import import_module
from importlib.util import find_spec
from itertools import product
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmarks.measuring.timing import Task, least_seconds
from benchmarks.problems.portfolios import Portfolio
from pricing_core.arrays import Vector

AVAILABLE = find_spec("QuantLib") is not None
ql: Any = import_module("QuantLib") if AVAILABLE else None

QD_FP = "QuantLib QdFp"
FINITE_DIFFERENCES = "QuantLib finite differences"
LEISEN_REIMER = "QuantLib Leisen-Reimer"

# Largest difference of the two fixed-point systems for a reference value, as a fraction of the strike.
AGREEMENT = 1e-8
CONTRACTS_PER_CALL = 64  # timed at a time: short enough to escape most interruptions
GRIDS = ((50, 100), (100, 100), (200, 200), (400, 400))  # time steps, space steps
TREE_STEPS = (51, 101, 201, 401, 801)


@dataclass(frozen=True, slots=True)
class Peer:
    """A method of QuantLib and its setting; `engine` makes the pricing engine of a process."""

    family: str
    setting: str
    engine: Callable[[Any], Any]


@dataclass(frozen=True, slots=True)
class Instruments:
    """One QuantLib option and its process per row of a portfolio."""

    options: tuple[Any, ...]
    processes: tuple[Any, ...]
    strikes: Vector

    @classmethod
    def of(cls, portfolio: Portfolio, exercise: str = "american") -> "Instruments":
        """Build the instruments of a portfolio, "american" or "european"."""
        today = ql.Date(2, 1, 2024)
        ql.Settings.instance().evaluationDate = today
        options, processes = [], []
        for row in zip(*portfolio.columns().values(), portfolio.days, strict=True):
            option_type, spot, strike, _, rate, dividend_yield, volatility, days = (
                item.item() for item in row
            )
            processes.append(_process(today, spot, rate, dividend_yield, volatility))
            kind = ql.Option.Put if option_type == "put" else ql.Option.Call
            last = today + days
            right = ql.AmericanExercise(today, last) if exercise == "american" else ql.EuropeanExercise(last)
            options.append(ql.VanillaOption(ql.PlainVanillaPayoff(kind, strike), right))
        return cls(tuple(options), tuple(processes), portfolio.strike)

    def use(self, engine: Callable[[Any], Any]) -> None:
        """Give every option an engine of its own."""
        for option, process in zip(self.options, self.processes, strict=True):
            option.setPricingEngine(engine(process))

    def task(self, peer: Peer) -> Task:
        """Return the calculation of all options by one method, a few contracts per call."""
        starts = range(0, len(self.options), CONTRACTS_PER_CALL)
        calls = (partial(_recalculate, self.options[i : i + CONTRACTS_PER_CALL]) for i in starts)
        return Task(tuple(calls), prepare=partial(self.use, peer.engine))

    def prices(self, engine: Callable[[Any], Any]) -> Vector:
        """Return the prices as fractions of the strike, NaN where QuantLib raises an error."""
        self.use(engine)
        return np.array([_price(option) for option in self.options]) / self.strikes


def _process(today: Any, spot: float, rate: float, dividend_yield: float, volatility: float) -> Any:
    days = ql.Actual360()
    curves = [ql.YieldTermStructureHandle(ql.FlatForward(today, x, days)) for x in (dividend_yield, rate)]
    smile = ql.BlackConstantVol(today, ql.NullCalendar(), volatility, days)
    quote = ql.QuoteHandle(ql.SimpleQuote(spot))
    return ql.BlackScholesMertonProcess(quote, *curves, ql.BlackVolTermStructureHandle(smile))


def _price(option: Any) -> float:
    try:
        return float(option.NPV())
    except RuntimeError:
        return float("nan")


def _recalculate(options: Iterable[Any]) -> None:
    for option in options:
        try:
            option.recalculate()
        except RuntimeError:
            continue


class Reference(NamedTuple):
    """Prices as fractions of the strike by two fixed-point systems: the first one's, and how far the other is."""

    price: Vector
    disagreement: Vector

    @property
    def agreed(self) -> NDArray[np.bool_]:
        """Return which rows the two agree on."""
        return self.disagreement <= AGREEMENT


def reference_prices(portfolio: Portfolio) -> Reference:
    """Solve by QdFp at high precision with the systems FP_A and FP_B, the rows that disagree once more, finer."""
    systems = ql.QdFpAmericanEngine
    value, disagreement = np.full((2, len(portfolio)), np.inf)
    for scheme in (systems.highPrecisionScheme(), ql.QdFpTanhSinhIterationScheme(16, 40, 1e-12)):
        rows = np.flatnonzero(~(disagreement <= AGREEMENT))
        instruments = Instruments.of(portfolio.take(rows))
        first, second = (
            instruments.prices(partial(_qd_fp, scheme=scheme, system=system))
            for system in (systems.FP_A, systems.FP_B)
        )
        value[rows], disagreement[rows] = first, np.abs(first - second)
    return Reference(value, disagreement)


def _qd_fp(process: Any, scheme: Any, system: Any) -> Any:
    return ql.QdFpAmericanEngine(process, scheme, system)


def _collocation(setting: str, scheme: Any) -> Peer:
    return Peer(QD_FP, setting, partial(_qd_fp, scheme=scheme, system=ql.QdFpAmericanEngine.Auto))


def named_schemes() -> tuple[Peer, ...]:
    """Return QdFp's schemes fast, accurate and high precision."""
    engine = ql.QdFpAmericanEngine
    schemes = {"fast": engine.fastScheme(), "accurate": engine.accurateScheme()}
    schemes["high precision"] = engine.highPrecisionScheme()
    return tuple(_collocation(name, scheme) for name, scheme in schemes.items())


def legendre_schemes() -> tuple[Peer, ...]:
    """Return QdFp's Legendre schemes (l, m, n, p) and Legendre-tanh-sinh schemes (l, m, n, eps) of a wide sweep.

    l: quadrature points of the fixed-point system; m: iterations; n: collocation nodes; p: quadrature points of
    the price, eps: its tolerance.
    """
    legendre = product(
        (2, 3, 4, 5, 7, 9, 12, 16, 25),
        (1, 2, 3, 5),
        (2, 3, 4, 5, 6, 7, 9, 11, 13),
        (4, 6, 8, 11, 15, 21, 27, 40, 60),
    )
    tanh_sinh = product((9, 12, 16, 25), (3, 5, 8), (7, 9, 11, 13), (1e-3, 1e-6))
    return (
        *(_collocation(f"{one}", ql.QdFpLegendreScheme(*one)) for one in legendre if _is_balanced(one)),
        *(_collocation(f"{one} tanh-sinh", ql.QdFpLegendreTanhSinhScheme(*one)) for one in tanh_sinh),
    )


def _is_balanced(scheme: tuple[int, int, int, int]) -> bool:
    quadrature, _, nodes, price_quadrature = scheme
    return quadrature <= price_quadrature <= 8 * quadrature and quadrature / 3 <= nodes <= quadrature + 2


def other_methods() -> tuple[Peer, ...]:
    """Return finite differences at four grids and Leisen-Reimer trees."""
    grids = (
        Peer(FINITE_DIFFERENCES, f"{t} steps x {x} nodes", partial(_finite_differences, steps=t, nodes=x))
        for t, x in GRIDS
    )
    trees = (Peer(LEISEN_REIMER, f"{n} steps", partial(_leisen_reimer, steps=n)) for n in TREE_STEPS)
    return (*grids, *trees)


def _finite_differences(process: Any, steps: int, nodes: int) -> Any:
    return ql.FdBlackScholesVanillaEngine(process, steps, nodes)


def _leisen_reimer(process: Any, steps: int) -> Any:
    return ql.BinomialLRVanillaEngine(process, steps)


class CallOverhead(NamedTuple):
    """The cost of one call from Python, in microseconds: a call that calculates nothing, and a European value."""

    empty: float
    european: float


def call_overhead(portfolio: Portfolio) -> CallOverhead:
    """Time NPV() of European options already valued, and their valuation by the analytic engine."""
    instruments = Instruments.of(portfolio, exercise="european")
    instruments.use(ql.AnalyticEuropeanEngine)
    valued = Task((partial(_ask_again, instruments.options),))
    valuation = Task((partial(_recalculate, instruments.options),))
    seconds = least_seconds((valued, valuation), turns=10)
    return CallOverhead(*(1e6 * second / len(portfolio) for second in seconds))


def _ask_again(options: Iterable[Any]) -> None:
    for option in options:
        option.NPV()
