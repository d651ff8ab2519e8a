"""QuantLib's methods on a portfolio, the best Legendre schemes of a wide sweep among them."""

from functools import partial
from typing import Any

import numpy as np

from benchmarks.measuring.frontier import Point, lower_envelope
from benchmarks.option_engine.work_precision import Method, measure
from benchmarks.problems.portfolios import Portfolio
from benchmarks.quantlib.american_engines import (
    Instruments,
    Peer,
    legendre_schemes,
    named_schemes,
    other_methods,
)
from pricing_core.arrays import Vector

SCREENING_TURNS = 1
SCREENING_GAIN = 0.1  # nearly equal schemes need not all be timed


def peer_methods(
    portfolio: Portfolio, reference: Vector, *, screened: int, slow: int, overhead: float
) -> tuple[Method, ...]:
    """Return the methods that are timed beside this engine.

    Parameters
    ----------
    portfolio : Portfolio
    reference : Vector
        Fractions of the strike.
    screened : int
        The rows that choose among about a thousand schemes those on the lower envelope; these are then timed on all.
    slow : int
        The rows for the methods that take milliseconds.
    overhead : float
        Microseconds per option, subtracted.

    Returns
    -------
    tuple of Method
    """
    everything = np.arange(len(portfolio))
    schemes = screened_schemes(portfolio, reference, portfolio.sample(screened), overhead)
    fast, accurate, high_precision = named_schemes()
    few = portfolio.sample(slow)
    return (
        *_methods(portfolio, everything, (*schemes, fast, accurate), overhead),
        *_methods(portfolio, few, (high_precision, *other_methods()), overhead),
    )


def screened_schemes(portfolio: Portfolio, reference: Vector, rows: Any, overhead: float) -> tuple[Peer, ...]:
    """Return the Legendre schemes on the lower envelope of RMSE and time over a few rows."""
    schemes = legendre_schemes()
    methods = _methods(portfolio, rows, schemes, overhead)
    measured = [
        Point(one.rmse if one.missing == 0 else np.inf, one.microseconds)
        for one in measure(methods, reference, SCREENING_TURNS)
    ]
    best = set(lower_envelope(measured, SCREENING_GAIN))
    return tuple(scheme for scheme, point in zip(schemes, measured, strict=True) if point in best)


def _methods(portfolio: Portfolio, rows: Any, peers: tuple[Peer, ...], overhead: float) -> tuple[Method, ...]:
    instruments = Instruments.of(portfolio.take(rows))
    return tuple(
        Method(
            peer.family,
            peer.setting,
            instruments.task(peer),
            partial(instruments.prices, peer.engine),
            rows,
            overhead,
        )
        for peer in peers
    )
