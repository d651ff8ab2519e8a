"""Values, profits and Greeks of contracts under scenarios, summed by groups."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pyarrow as pa

from pricing_core.american.arrow.arrow_column import ArrowColumn, is_nested, is_number, is_text
from pricing_core.american.arrow.cells import is_empty
from pricing_core.american.arrow.schema import check_results
from pricing_core.american.book.book import Rows
from pricing_core.american.contracts.field import Field
from pricing_core.batch.scenario import SHIFTS, Scenario
from pricing_core.batch.valued import Valued
from pricing_core.errors import InvalidInputError

# Columns of the input that a value per unit is multiplied by.
SIZES = (
    Field(
        "quantity",
        "number",
        "contracts",
        "Contracts held, below 0 where they are owed",
        default=None,
        example=-10,
    ),
    Field(
        "contract_multiplier",
        "number",
        "units",
        "Units of the underlying in a contract",
        default=None,
        example=100,
    ),
)
COUNTS = ("contracts", "contracts_left_out")
SPOT_GREEKS = {"delta": 1, "gamma": 2}  # and the power of the spot that makes money of them


class Groups:
    """Sums over the contracts of a group, for each scenario.

    Summed are price, profit and loss and the Greeks, each times the columns "quantity" and "contract_multiplier" of
    the input (1 where there is no such column). A contract is left out of all sums of a scenario, and counted as left
    out, where any of these is missing. "delta" and "gamma" are sums by money of spot, which mean something where a
    group has one underlying; "delta_money" is that of delta * spot and "gamma_money" that of gamma * spot**2, by a
    relative move of 1. Vega and rhos are by 1.00, theta by a year. Empty cells of the columns to group by are a group.

    Parameters
    ----------
    schema : pyarrow.Schema
        The columns of the input.
    by : sequence of str
        Those to group by.
    scenarios : tuple of Scenario
    greeks : sequence of str
        Those to sum.
    named : bool
        Whether the rows tell the names of their scenarios.

    Raises
    ------
    InvalidInputError
        A column is missing, named as a sum is, or of a type that cannot be compared or multiplied by.
    """

    def __init__(
        self,
        schema: pa.Schema,
        by: Sequence[str],
        scenarios: tuple[Scenario, ...],
        greeks: Sequence[str],
        *,
        named: bool,
    ) -> None:
        self._by, self._scenarios, self._greeks, self._named = tuple(by), scenarios, tuple(greeks), named
        for name in self._by:
            if name not in schema.names:
                raise InvalidInputError("group_by", name, "a column of the table")
            if is_nested(schema.field(name).type):
                raise InvalidInputError("group_by", name, "a column of single values")
        for size in SIZES:
            kind = schema.field(size.name).type if size.name in schema.names else pa.null()
            if not (pa.types.is_null(kind) or is_number(kind) or is_text(kind)):
                raise InvalidInputError(f"column {size.name}", str(kind), "a column of numbers")
        sums = ["value", "profit_and_loss", *self._greeks]
        self._sums = [*sums, *(f"{name}_money" for name in SPOT_GREEKS if name in self._greeks)]
        added = [pa.field("scenario", pa.string())] * named
        added += [pa.field(name, pa.float64()) for name in SHIFTS]
        added += [pa.field(name, pa.int64()) for name in COUNTS]
        added += [pa.field(name, pa.float64()) for name in self._sums]
        check_results(self._by, [field.name for field in added])
        self.schema = pa.schema([*(schema.field(name) for name in self._by), *added])
        self._key_schema = pa.schema([schema.field(name) for name in self._by])
        self._places: dict[tuple[object, ...], int] = {}
        self._keys: list[pa.RecordBatch] = []  # a row for each group
        self.left_out = 0
        self._totals = np.zeros((0, len(scenarios), len(COUNTS) + len(self._sums)))

    @np.errstate(over="ignore", invalid="ignore")
    def rows(self, valued: Valued) -> None:
        """Add some contracts to their groups; amounts that are not finite are left out."""
        group = self._groups_of(valued.contracts)
        size = np.ones(valued.count)
        for field in SIZES:
            if field.name in valued.contracts.schema.names:
                size *= ArrowColumn(field, valued.contracts.column(field.name)).numbers()
        values = [valued.numbers("price"), valued.profit_and_loss()]
        values += [valued.numbers(name) for name in self._greeks]
        values += [
            valued.numbers(name) * valued.spots**power
            for name, power in SPOT_GREEKS.items()
            if name in self._greeks
        ]
        amounts = np.stack(values, axis=-1) * size[:, None]  # (scenarios, contracts, sums)
        complete = np.isfinite(amounts).all(axis=-1)
        amounts[~complete] = 0.0
        self.left_out += int((~complete).any(axis=0).sum())
        counts = np.stack([np.ones_like(complete), ~complete], axis=-1)
        both = np.concatenate([counts, amounts], axis=-1)
        np.add.at(self._totals, group, both.transpose(1, 0, 2))

    def last_rows(self) -> pa.RecordBatch:
        """Return a row for each group and scenario; the groups are in the order of their first contracts."""
        count, scenarios = len(self._places), len(self._scenarios)
        owner = pa.array(np.repeat(np.arange(count), scenarios), pa.int64())
        columns = []
        for place, field in enumerate(self._key_schema):
            keys = [batch.column(place) for batch in self._keys] or [pa.array([], field.type)]
            columns.append(pa.concat_arrays(keys).take(owner))
        if self._named:
            columns.append(pa.array([scenario.label for scenario in self._scenarios] * count, pa.string()))
        for shift in SHIFTS:
            columns.append(
                pa.array([getattr(scenario, shift) for scenario in self._scenarios] * count, pa.float64())
            )
        totals = self._totals.reshape(count * scenarios, self._totals.shape[-1])
        columns += [pa.array(totals[:, k].astype(np.int64)) for k in range(len(COUNTS))]
        columns += [pa.array(totals[:, k + len(COUNTS)]) for k in range(len(self._sums))]
        return pa.RecordBatch.from_arrays(columns, schema=self.schema)

    def _groups_of(self, contracts: pa.RecordBatch) -> Rows:
        """Return the group of each contract, and make room for new ones."""
        keys = contracts.select(list(self._by))
        group, fresh = np.zeros(contracts.num_rows, dtype=np.intp), []
        cells = ([None if is_empty(cell) else cell for cell in column.to_pylist()] for column in keys.columns)
        for row, key in enumerate(zip(*cells, strict=True)):
            if key not in self._places:
                fresh.append(row)
                self._places[key] = len(self._places)
            group[row] = self._places[key]
        if fresh:
            self._keys.append(keys.take(pa.array(fresh)))
            self._totals = np.concatenate([self._totals, np.zeros((len(fresh), *self._totals.shape[1:]))])
        return group
