"""What is asked of the contracts, each kind of answers of some of them, and how an answer is kept."""

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from benchmarks.frozen_answers.contracts import EVERY, FAMILIES, SEED, Contract
from pricing_core.american import (
    Greeks,
    contract_from,
    exercise_boundary,
    implied_volatility_many,
    price,
    price_many,
    value_surface,
)

Answer: TypeAlias = dict[str, Any]  # What was found for a contract, by name.

VALUES = (
    *("price", "european_price", "early_exercise_premium", "intrinsic_value", "exercise_boundary"),
    *("error_estimate", "exercise_now", "status", "method", "message"),
)
DERIVATIVES = (
    *("delta", "gamma", "theta", "theta_per_day", "vega", "vega_per_point", "rho", "rho_per_point"),
    *("dividend_rho", "dividend_sensitivities"),
)
EXTENDED = ("price", "vanna", "volga", "charm", "rate_buckets", "volatility_buckets")
IMPLIED = ("volatility", "status", "european_price", "price", "error_estimate", "iterations", "message")
BOUNDARIES = ("time", "boundary", "other_boundary", "error_estimate")
SURFACE = ("value", "delta", "gamma", "exercised", "error_estimate")
SURFACE_SPOTS = (0.6, 0.8, 0.95, 1.0, 1.05, 1.3)  # Spots of a surface, as shares of the strike.
SURFACE_TIMES = (0.0, 0.4, 0.9)  # Times of a surface, as shares of the expiry.
METHOD_TOLERANCE = 1e-5  # Tolerance, in strikes, where a method is asked for by name.


def _row(contract: Contract, names: Sequence[str], greeks: Greeks) -> Answer:
    table = price_many(contract.columns(), tolerance=contract.tolerance, greeks=greeks)
    return {name: table[name][0] for name in names if name in table}


def _price(contract: Contract) -> Answer:
    return _row(contract, VALUES, "none")


def _greeks(contract: Contract) -> Answer:
    return _row(contract, (*VALUES, *DERIVATIVES), "standard")


def _boundary(contract: Contract) -> Answer:
    found = exercise_boundary(*contract_from(contract.terms), tolerance=contract.tolerance)
    return {name: getattr(found, name) for name in BOUNDARIES}


def _implied(contract: Contract) -> Answer:
    """Search for the volatility of the contract's own price to six digits, which slight changes leave alone."""
    own = price_many(contract.columns(), tolerance=contract.tolerance, greeks="none")["price"].item()
    observed = float(f"{own:.6g}")
    table = implied_volatility_many(contract.columns(), option_price=[observed], tolerance=contract.tolerance)
    return {"option_price": observed, **{name: table[name][0] for name in IMPLIED}}


def _extended(contract: Contract) -> Answer:
    found = price(*contract_from(contract.terms), tolerance=contract.tolerance, greeks="extended")
    further = {name: getattr(found, name) for name in EXTENDED}
    return {**further, "error_estimate": found.error_estimate, "status": found.status, "method": found.method}


def _by_method(contract: Contract, **asked: Any) -> Answer:
    terms = contract_from(contract.terms)
    found = price(*terms, tolerance=METHOD_TOLERANCE, greeks="none", **asked)
    return {name: getattr(found, name) for name in VALUES if name != "message"}


def _surface(contract: Contract) -> Answer:
    option, market = contract_from(contract.terms)
    found = value_surface(
        option,
        market,
        spots=[option.strike * share for share in SURFACE_SPOTS],
        times=[option.expiry * share for share in SURFACE_TIMES],
        tolerance=contract.tolerance,
    )
    return {name: getattr(found, name) for name in SURFACE}


class Kind(NamedTuple):
    """A kind of answers: the number of contracts, the families that it leaves out, and the function that is called."""

    size: int
    without: tuple[str, ...]
    ask: Callable[[Contract], Answer]


HEAVY = ("refused", "crowded cash dividends", "hard events")
FORMULAS = ("european", "never exercised", "at an edge")
KINDS = {
    "price": Kind(EVERY, (), _price),
    "greeks": Kind(EVERY - FAMILIES["hard events"].size, ("hard events",), _greeks),
    "greeks of hard events": Kind(
        FAMILIES["hard events"].size // 2, tuple(name for name in FAMILIES if name != "hard events"), _greeks
    ),
    "boundary": Kind(500, ("refused", "european"), _boundary),
    "implied": Kind(500, ("hard events",), _implied),
    "extended": Kind(100, HEAVY, _extended),
    "lcs": Kind(100, (*HEAVY, *FORMULAS), lambda contract: _by_method(contract, method="lcs")),
    "crank-nicolson": Kind(
        60, (*HEAVY, *FORMULAS), lambda contract: _by_method(contract, method="crank-nicolson")
    ),
    "policy": Kind(60, (*HEAVY, *FORMULAS), lambda contract: _by_method(contract, lcp_method="policy")),
    "surface": Kind(60, HEAVY, _surface),
}


def chosen(name: str, contracts: Sequence[Contract]) -> list[Contract]:
    """Return the contracts, in order, that a kind of answers is asked of; fewer where there are fewer contracts."""
    kind = KINDS[name]
    fit = [contract for contract in contracts if contract.family not in kind.without]
    count = min(len(fit), math.ceil(kind.size * len(contracts) / EVERY))
    places = np.random.default_rng((SEED, *name.encode())).permutation(len(fit))[:count]
    return [fit[place] for place in sorted(places.tolist())]


def plain(value: Any) -> Any:
    """Return a value in a form that JSON holds exactly: missing numbers as None, infinite ones as text."""
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if isinstance(value, list | tuple):
        return [plain(entry) for entry in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None if math.isnan(value) else str(value)
    return value


def answered(ask: Callable[[Contract], Answer], contract: Contract) -> Answer:
    """Return the answer, or what was raised in its place."""
    try:
        return {name: plain(value) for name, value in ask(contract).items()}
    except Exception as fault:  # whatever it is, it belongs to the record
        return {"raised": f"{type(fault).__name__}: {fault}"}
