"""Random contracts over all features of the option engine, which follow from one seed alone."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from benchmarks.frozen_answers import event_families, flat_families
from benchmarks.frozen_answers.random_terms import Random, Terms

SEED = 20261
TOLERANCES = (1e-4, 1e-5, 1e-6, 1e-7, 1e-8)


class Family(NamedTuple):
    """A kind of contracts: how many, and how one is made."""

    size: int
    make: Callable[[Random], Terms]


FAMILIES = {
    "everyday": Family(330, flat_families.everyday),
    "wide": Family(200, flat_families.wide),
    "negative rates": Family(120, flat_families.negative_rates),
    "two boundaries": Family(140, flat_families.two_boundaries),
    "never exercised": Family(60, flat_families.never_exercised),
    "zero rate or yield": Family(80, flat_families.zero_rate),
    "tiny volatility": Family(50, flat_families.tiny_volatility),
    "huge volatility": Family(50, flat_families.huge_volatility),
    "hours or days": Family(60, flat_families.days),
    "decades": Family(50, flat_families.decades),
    "deep in or out of the money": Family(60, flat_families.deep),
    "european": Family(90, flat_families.european),
    "at an edge": Family(80, flat_families.at_an_edge),
    "refused": Family(30, flat_families.refused),
    "cash dividends": Family(190, event_families.cash_dividends),
    "many cash dividends": Family(110, event_families.many_cash_dividends),
    "crowded cash dividends": Family(40, event_families.crowded_cash_dividends),
    "odd cash dividends": Family(150, event_families.odd_cash_dividends),
    "escrowed": Family(130, event_families.escrowed),
    "proportional dividends": Family(130, event_families.proportional),
    "cash and proportional dividends": Family(90, event_families.cash_and_proportional),
    "curves": Family(250, event_families.curves),
    "bermudan": Family(120, event_families.bermudan),
    "window": Family(80, event_families.window),
    "combined": Family(160, event_families.combined),
    "hard events": Family(150, event_families.hard),
}
EVERY = sum(family.size for family in FAMILIES.values())


@dataclass(frozen=True, slots=True)
class Contract:
    """One row: its place among all contracts, its family, terms and tolerance."""

    id: int
    family: str
    terms: Terms
    tolerance: float

    def columns(self) -> dict[str, list[Any]]:
        """Return a table of this row alone, as `price_many` takes it."""
        return {name: [value] for name, value in self.terms.items()}

    @property
    def scale(self) -> float:
        """Return the size relative to which differences of money are measured."""
        spot, strike = float(self.terms["spot"]), float(self.terms["strike"])
        return max(1.0, abs(spot), abs(strike))


def all_contracts() -> list[Contract]:
    """Return every contract; each follows from the seed, its family and its number in the family alone."""
    contracts: list[Contract] = []
    for place, (name, family) in enumerate(FAMILIES.items()):
        for number in range(family.size):
            random = np.random.default_rng((SEED, place, number))
            terms = family.make(random)
            contracts.append(Contract(len(contracts), name, terms, float(random.choice(TOLERANCES))))
    return contracts
