"""What `pricing scenarios` and `pricing explain` do besides the work itself: pipes, and what is printed."""

from collections.abc import Sequence
from contextlib import suppress
from typing import Any

import typer

from app.command_failures import standard_output
from app.commands.batch_command import STANDARD, input_file, output_file
from pricing_core.batch import read_scenarios, run_explain, run_scenarios, scenarios_of
from pricing_core.errors import InvalidInputError, MissingInputError, Told

Shifts = Sequence[float] | None


def value_file(
    source: str,
    target: str,
    named: str | None,
    shifts: tuple[Shifts, Shifts, Shifts, Shifts],
    *,
    quiet: bool,
    **options: Any,
) -> int:
    """Value a table under scenarios, print a summary, and return how many contracts lack a value.

    Parameters
    ----------
    named : str, optional
        A file of scenarios, in the place of shifts.
    shifts : tuple
        Shifts of the spot, the volatility and the rate, and days forward.

    Raises
    ------
    InvalidInputError
        As `run_scenarios`; there are both or neither of scenarios and shifts; or a format is missing.
    """
    lists = any(values is not None for values in shifts)
    if not lists and named is None:
        raise MissingInputError("scenarios", "give --spot-shifts and the like, or --scenarios FILE")
    if lists and named is not None:
        raise InvalidInputError("scenarios", Told("given twice"), "a file, or --spot-shifts and the like")
    scenarios = scenarios_of(*shifts) if named is None else read_scenarios(named)
    with (
        input_file(source, options["input_format"]) as read,
        output_file(target, options["output_format"]) as written,
    ):
        summary = run_scenarios(read, written, scenarios, named=named is not None, **options)
    if not quiet and target != STANDARD:
        _print(
            f"{summary.contracts} contracts under {len(scenarios)} scenarios: {summary.rows} rows in {target}"
        )
        if summary.incomplete:
            lack = "a price, or what the sums need," if options["group_by"] else "a profit or loss"
            _print(f"{summary.incomplete} contracts without {lack} in some scenario")
        if summary.unread:
            _print(f"columns not read: {', '.join(summary.unread)}")
    return summary.incomplete


def explain_files(before: str, after: str, target: str, *, quiet: bool, **options: Any) -> int:
    """Explain gains and losses, print a summary, and return how many rows have no profit or loss.

    Raises
    ------
    InvalidInputError
        As `run_explain`, or a format is missing.
    """
    with output_file(target, options["output_format"]) as written:
        summary = run_explain(before, after, written, **options)
    if not quiet and target != STANDARD:
        _print(f"{summary.rows} rows in {target}")
        if summary.incomplete:
            _print(f"{summary.incomplete} of them without a profit or loss: their status says why")
    return summary.incomplete


def _print(line: str) -> None:
    with suppress(typer.Exit, OSError), standard_output():  # the file is there, whoever reads this
        print(line)
