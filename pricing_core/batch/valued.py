"""Some contracts with their values under scenarios."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from pricing_core.american.arrow.cells import numbers_of
from pricing_core.arrays import Matrix
from pricing_core.batch.scenario import Scenario


@dataclass(frozen=True, eq=False)
class Valued:
    """The values of n contracts under m scenarios.

    Parameters
    ----------
    contracts : pyarrow.RecordBatch, n rows
        As they were given.
    scenarios : tuple of Scenario, length m
    results : pyarrow.RecordBatch, m * n rows
        The results of all contracts under the first scenario, then under the second, and so on.
    unshifted : pyarrow.RecordBatch, n rows
        Their results as they are.
    spots : array, shape (m, n)
        Money.
    """

    contracts: pa.RecordBatch
    scenarios: tuple[Scenario, ...]
    results: pa.RecordBatch
    unshifted: pa.RecordBatch
    spots: Matrix

    @property
    def count(self) -> int:
        """The number of contracts n."""
        rows: int = self.contracts.num_rows
        return rows

    def numbers(self, name: str) -> Matrix:
        """Return a result as numbers, shape (m, n), NaN for null."""
        return numbers_of(self.results.column(name)).reshape(len(self.scenarios), self.count)

    @cached_property
    def _profit_and_loss(self) -> Matrix:
        return self.numbers("price") - numbers_of(self.unshifted.column("price"))

    def profit_and_loss(self) -> Matrix:
        """Return the prices less those without shifts, shape (m, n), NaN where either is missing."""
        return self._profit_and_loss

    def order(self) -> pa.Array:
        """Return which results come one after the other where the scenarios of a contract stand together."""
        places = np.arange(len(self.scenarios))[None, :] * self.count + np.arange(self.count)[:, None]
        return pa.array(places.ravel())

    def which(self) -> pa.Array:
        """Return the scenario of each row in that order."""
        return pa.array(np.tile(np.arange(len(self.scenarios)), self.count))

    def messages(self) -> pa.Array:
        """Return why there is no price, or no profit or loss, or null, in the order of the results."""
        scenarios = len(self.scenarios)
        unshifted = pa.concat_arrays([self.unshifted.column("status")] * scenarios)
        bad = pc.equal(unshifted, "invalid_input")
        messages = self.results.column("message")
        by_shift = pc.binary_join_element_wise(messages, ", under the shifts of the scenario", "")
        invalid = pc.equal(self.results.column("status"), "invalid_input")
        messages = pc.if_else(pc.and_(invalid, pc.invert(bad)), by_shift, messages)
        alone = pa.array(np.isnan(self._profit_and_loss.ravel()) & ~np.isnan(self.numbers("price").ravel()))
        without = pc.binary_join_element_wise("without shifts there is no price: ", unshifted, "")
        return pc.if_else(alone, without, messages)

    def first_not_ok(self) -> NDArray[np.int64]:
        """Return, for each contract, the place of its first result without a profit or loss, or else not ok."""
        is_ok = pc.equal(self.results.column("status"), "ok").to_numpy(zero_copy_only=False)
        shape = len(self.scenarios), self.count
        rank = np.where(np.isnan(self._profit_and_loss), 0, np.where(is_ok.reshape(shape), 2, 1))
        places: NDArray[np.int64] = np.argmin(rank, axis=0) * self.count + np.arange(self.count)
        return places
