"""Contracts valued under scenarios: a long table, a matrix of profits and losses, or sums by groups."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import pyarrow as pa

from pricing_core.american.arrow.cells import number_array
from pricing_core.american.arrow.frames import Frame
from pricing_core.american.arrow.plain_types import plain_table
from pricing_core.american.arrow.price_batch import contract_columns, price_batch, unusual
from pricing_core.american.arrow.schema import ARROW_TYPES, check_names, check_results, check_types
from pricing_core.american.book.reading import read_columns
from pricing_core.american.book.unusual import warn_of
from pricing_core.american.contracts.fields import DEFAULT_TOLERANCE, Greeks
from pricing_core.american.contracts.result_fields import price_fields
from pricing_core.american.pricing_settings import PricingSettings
from pricing_core.batch.chunk import Chunk
from pricing_core.batch.groups import Groups
from pricing_core.batch.results import typed_table
from pricing_core.batch.scenario import SHIFTS, Scenario, checked_scenarios, scenarios_of
from pricing_core.batch.shifts import ShiftedContracts
from pricing_core.batch.valued import Valued
from pricing_core.errors import InvalidInputError

ROWS_AT_A_TIME = 65_536  # of contracts under scenarios


class Form(Protocol):
    """How values under scenarios become a table."""

    schema: pa.Schema

    @property
    def left_out(self) -> int:
        """How many contracts are missing in a sum of some scenario."""
        ...

    def rows(self, valued: Valued) -> pa.RecordBatch | None:
        """Return the rows of some contracts; None where they only count towards the last rows."""
        ...

    def last_rows(self) -> pa.RecordBatch | None:
        """Return the rows that follow those of all contracts."""
        ...


@dataclass(frozen=True, slots=True)
class ScenarioRules:
    """The settings that hold for all contracts.

    Parameters
    ----------
    scenarios : tuple of Scenario
    settings : PricingSettings
    named : bool
        Whether the rows tell the names of their scenarios.
    threads : int, optional
    numbers : sequence of str
        Columns of text that pass through as the numbers that they are.
    """

    scenarios: tuple[Scenario, ...]
    settings: PricingSettings
    named: bool = False
    threads: int | None = None
    numbers: Sequence[str] = ()


def value_scenarios(
    table: Frame,
    *,
    spot_shifts: Sequence[float] | None = None,
    volatility_shifts: Sequence[float] | None = None,
    rate_shifts: Sequence[float] | None = None,
    days_forward: Sequence[float] | None = None,
    scenarios: Iterable[Scenario] | None = None,
    matrix: bool = False,
    group_by: Sequence[str] = (),
    tolerance: float = DEFAULT_TOLERANCE,
    greeks: Greeks = "none",
    share_solves: bool = False,
    threads: int | None = None,
) -> pa.Table:
    """Value every contract of a table under every combination of shifts; a bad row gets a status, never an exception.

    Parameters
    ----------
    table : pyarrow.Table, or any frame with the Arrow C stream interface
        Columns as in `price_table`.
    spot_shifts : sequence of float, optional
        Relative: -0.1 is 10 % down.
    volatility_shifts, rate_shifts : sequence of float, optional
        Absolute, 0.01 is one point; a curve moves in parallel.
    days_forward : sequence of float, optional
        Days that pass, at least 0; the expiration stays. Dividends whose ex-time has come are gone and the spot does
        not drop for them: it is what its shift makes it. Curves hold what they hold for a date. Expired contracts are
        worth what exercise brings.
    scenarios : iterable of Scenario, optional
        In the place of the four lists.
    matrix : bool
        One row per contract with a column of profits and losses for every scenario.
    group_by : sequence of str
        One row per group and scenario, by the values of these columns; `Groups` says what is summed.
    tolerance, greeks, share_solves, threads
        As in `price_many`. With `share_solves` the contracts of a spot ladder come from one solve where it serves them.

    Returns
    -------
    pyarrow.Table
        By default a row for each contract and scenario, the scenarios of a contract together: the columns of `table`
        as they were, "scenario" (where `scenarios` is given), the shifts, "price", "profit_and_loss" (less the price
        without shifts, in money per unit), Greeks, "error_estimate" (of the price), "status" and "message".

    Raises
    ------
    InvalidInputError
        A column is missing, misspelt, of a type that cannot hold its values or named as a result is; a shift is no
        finite number; both `matrix` and `group_by` are asked for.

    Examples
    --------
    >>> book = {"option_type": ["put"], "spot": [100.0], "strike": [100.0], "expiry": [1.0], "rate": [0.05]}
    >>> found = value_scenarios(pa.table({**book, "volatility": [0.2]}), spot_shifts=[-0.1, 0.0], rate_shifts=[0.0])
    >>> [round(number, 3) for number in found["profit_and_loss"].to_pylist()]
    [5.402, 0.0]
    """
    contracts = plain_table(table)
    chosen = chosen_scenarios(scenarios, spot_shifts, volatility_shifts, rate_shifts, days_forward)
    settings = PricingSettings(tolerance, greeks, share_solves=share_solves)
    rules = ScenarioRules(chosen, settings, scenarios is not None, threads)
    check_names(contracts.schema.names)
    check_types(contracts.schema)
    form = form_of(contracts.schema, rules, matrix=matrix, group_by=group_by)
    batches = contracts.combine_chunks().to_batches()
    for batch in batches:
        warn_of(unusual(batch, settings), callers=2)
    first = 1
    chunks = []
    for batch in batches:
        chunks.append(Chunk(range(first, first + batch.num_rows), batch))
        first += batch.num_rows
    return pa.Table.from_batches(scenario_rows(chunks, rules, form), form.schema)


def chosen_scenarios(
    scenarios: Iterable[Scenario] | None,
    spot_shifts: Sequence[float] | None,
    volatility_shifts: Sequence[float] | None,
    rate_shifts: Sequence[float] | None,
    days_forward: Sequence[float] | None,
) -> tuple[Scenario, ...]:
    """Return the scenarios as given, or the combinations of the lists.

    Raises
    ------
    InvalidInputError
        There are both, or they are not what they must be.
    """
    lists = (spot_shifts, volatility_shifts, rate_shifts, days_forward)
    if scenarios is None:
        return checked_scenarios(scenarios_of(*lists))
    if any(values is not None for values in lists):
        raise InvalidInputError("scenarios", "both", "given without lists of shifts")
    return checked_scenarios(scenarios)


def form_of(
    schema: pa.Schema, rules: ScenarioRules, *, matrix: bool = False, group_by: Sequence[str] = ()
) -> Form:
    """Return the form of the output for an input of these columns.

    Raises
    ------
    InvalidInputError
        Two forms are asked for, a column to group by is missing, or an input column is named as a result is.
    """
    if matrix and group_by:
        raise InvalidInputError("matrix", matrix, "left out where group_by is given")
    if group_by:
        fields = price_fields(rules.settings.greeks)
        summed = [
            field for field in fields if field.name != "delta_sticky_moneyness"
        ]  # few contracts have it
        greeks = [field.name for field in summed if field.is_greek and field.kind == "number"]
        return Groups(schema, group_by, rules.scenarios, greeks, named=rules.named)
    return Matrix(schema, rules) if matrix else LongTable(schema, rules)


def scenario_rows(chunks: Iterable[Chunk], rules: ScenarioRules, form: Form) -> Iterator[pa.RecordBatch]:
    """Yield the rows of a form, some contracts at a time."""
    size = max(1, ROWS_AT_A_TIME // (len(rules.scenarios) + 1))
    for chunk in chunks:
        for start in range(0, chunk.table.num_rows, size):
            part = chunk.table.slice(start, size)
            malformed = {
                row - start: fault for row, fault in chunk.malformed.items() if start <= row < start + size
            }
            rows = form.rows(value_batch(part, rules, malformed))
            if rows is not None:
                yield rows
    last = form.last_rows()
    if last is not None:
        yield last


def value_batch(
    batch: pa.RecordBatch, rules: ScenarioRules, malformed: Mapping[int, InvalidInputError]
) -> Valued:
    """Return the contracts under every scenario and without shifts, all priced in one call.

    Parameters
    ----------
    malformed : mapping of int to InvalidInputError
        Rows that are not to be read, and why.
    """
    count, settings = batch.num_rows, rules.settings
    columns = contract_columns(batch, settings)
    faults = read_columns(columns, count, malformed).faults
    faults = {**faults, **malformed}
    sound = np.ones(count, dtype=bool)
    sound[list(faults)] = False
    contracts = ShiftedContracts(columns, sound, rules.scenarios)
    unshifted = next((k for k, found in enumerate(rules.scenarios) if found.is_unshifted), None)
    wanted = rules.scenarios if unshifted is not None else (*rules.scenarios, Scenario())
    stacked = pa.concat_batches([contracts.under(scenario) for scenario in wanted])
    refused = {place * count + row: fault for place in range(len(wanted)) for row, fault in faults.items()}
    results, _ = price_batch(stacked, settings, rules.threads, refused)
    base = (len(rules.scenarios) if unshifted is None else unshifted) * count
    spots = stacked.column("spot").to_numpy(zero_copy_only=False)[: len(rules.scenarios) * count]
    return Valued(
        typed_table(batch, settings, rules.numbers),
        rules.scenarios,
        results.slice(0, len(rules.scenarios) * count),
        results.slice(base, count),
        spots.reshape(len(rules.scenarios), count),
    )


class LongTable:
    """A row for each contract and scenario."""

    left_out = 0

    def __init__(self, schema: pa.Schema, rules: ScenarioRules) -> None:
        fields = price_fields(rules.settings.greeks, schema.names)
        self._kept = [field for field in fields if field.given != "always"]
        names = ["scenario"] * rules.named
        added = [pa.field(name, pa.string()) for name in names]
        added += [pa.field(name, pa.float64()) for name in (*SHIFTS, "price", "profit_and_loss")]
        added += [pa.field(field.name, ARROW_TYPES[field.kind]) for field in self._kept]
        added += [pa.field("error_estimate", pa.float64())]
        added += [pa.field(name, pa.string()) for name in ("status", "message")]
        check_results(schema.names, [field.name for field in added])
        self.schema = pa.schema([*schema, *added])
        self._named = rules.named

    def rows(self, valued: Valued) -> pa.RecordBatch:
        """Return the rows of some contracts."""
        order = valued.order()
        contracts = pa.array(np.repeat(np.arange(valued.count), len(valued.scenarios)))
        columns = [column.take(contracts) for column in valued.contracts.columns]
        if self._named:
            names = pa.array([scenario.label for scenario in valued.scenarios], pa.string())
            columns.append(names.take(valued.which()))
        for shift in SHIFTS:
            values = pa.array([getattr(scenario, shift) for scenario in valued.scenarios])
            columns.append(values.take(valued.which()))
        columns += [
            valued.results.column("price").take(order),
            number_array(valued.profit_and_loss().T.ravel()),
        ]
        kept = [*(field.name for field in self._kept), "error_estimate", "status"]
        columns += [valued.results.column(name).take(order) for name in kept]
        columns.append(valued.messages().take(order))
        return pa.RecordBatch.from_arrays(columns, schema=self.schema)

    def last_rows(self) -> None:
        """Return nothing: every contract has its rows."""


class Matrix:
    """A row for each contract, and its profit or loss under each scenario in a column of the scenario's label."""

    left_out = 0

    def __init__(self, schema: pa.Schema, rules: ScenarioRules) -> None:
        labels = [scenario.label for scenario in rules.scenarios]
        added = [pa.field(name, pa.float64()) for name in ("price", *labels)]
        added += [pa.field(name, pa.string()) for name in ("status", "message")]
        names = [field.name for field in added]
        for label in labels:
            if names.count(label) > 1:
                raise InvalidInputError(
                    "scenarios", label, "called by other names than price, status and message"
                )
        check_results(schema.names, names)
        self.schema = pa.schema([*schema, *added])

    def rows(self, valued: Valued) -> pa.RecordBatch:
        """Return a row for each contract; its status is that of the first scenario that is not ok."""
        profits = [number_array(profit) for profit in valued.profit_and_loss()]
        worst = pa.array(valued.first_not_ok())
        ends = [valued.results.column("status").take(worst), valued.messages().take(worst)]
        columns = [*valued.contracts.columns, valued.unshifted.column("price"), *profits, *ends]
        return pa.RecordBatch.from_arrays(columns, schema=self.schema)

    def last_rows(self) -> None:
        """Return nothing: every contract has its row."""
