"""What `pricing chain` does: a vendor's file in, a folder of tables and a report with pictures out."""

import io
import json
from contextlib import suppress
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.csv as pa_csv
import pyarrow.parquet as pq
import typer

from app.command_failures import standard_output
from pricing_core.chains import ChainFit, fit_chain, read_chain
from pricing_core.chains.fit_tables import tables_of
from pricing_core.chains.side_files import read_dividends, read_rates
from pricing_core.errors import InvalidInputError, MissingInputError, Told
from pricing_core.replacement import replacement

MOST_NAMED = 5  # rows and expirations that are written out; chosen


def fit_file(
    source: str,
    folder: Path,
    *,
    format_: str,
    rate: Any,
    rates: str | None,
    dividends: str | None,
    valuation_date: str | None,
    underlying_price: float | None,
    tolerance: float,
    threads: int,
    quiet: bool,
) -> bool:
    """Fit the chain of a file, write all of it into a folder, and tell whether everything could be read and fitted.

    Raises
    ------
    InvalidInputError
        As `read_chain` and `fit_chain`, or there are both or neither of rate and rates.
    OSError
        A file cannot be read or written.
    """
    if rate is None and rates is None:
        raise MissingInputError("rate", "give --rate or --rates")
    if rate is not None and rates is not None:
        raise InvalidInputError("rate", Told("given twice"), "given by --rate or by --rates")
    table = read_chain(source, format_, underlying_price, valuation_date)
    fit = fit_chain(
        table,
        _curve(rate) if rates is None else read_rates(rates, format_),
        cash_dividends=[] if dividends is None else read_dividends(dividends),
        valuation_date=valuation_date,
        tolerance=tolerance,
        threads=threads,
    )
    folder.mkdir(parents=True, exist_ok=True)
    for name, content in tables_of(fit).items():
        write_table(folder, name, content)
    if fit.local_volatility is not None:
        _write(folder / "local_volatility.json", json.dumps(local_volatility_json(fit)).encode())
    from app.commands.chain_report import write_report  # noqa: PLC0415

    write_report(folder, fit, Path(source).name)
    if not quiet:
        with suppress(typer.Exit, OSError), standard_output():  # the files are there, whoever reads this
            print("\n".join(summary(fit, folder)))
    return fit.surface is not None and not fit.rejected and not fit.unfitted


def summary(fit: ChainFit, folder: Path) -> list[str]:
    """Return the lines that are printed about a fit."""
    statuses = fit.quotes["status"].to_pylist()
    lines = [
        f"{len(statuses)} quotes of {fit.carry.num_rows} expirations, {statuses.count('ok')} with a volatility",
        f"tables and report.html in {folder}",
    ]
    lines += [f"flagged {name}: {count}" for name, count in fit.flags.items()]
    messages = fit.quotes["message"].to_pylist()
    unread = [(row, text) for row, text in enumerate(messages, start=1) if text is not None]
    lines += [f"row {row}: {text}" for row, text in unread[:MOST_NAMED]]
    unfitted = list(fit.unfitted.items())
    lines += [f"{day}: {why}" for day, why in unfitted[:MOST_NAMED]]
    thin = [] if fit.surface is None else [each for each in fit.surface.statuses if each.status == "thin"]
    lines += [f"expiry in {365.0 * each.expiry:.1f} days: {each.message}" for each in thin[:MOST_NAMED]]
    if fit.local_volatility is None:
        lines.append(fit.surface_message)
    else:
        before, after = fit.share_within_before, fit.share_within_after
        lines.append(f"within bid and ask: {before:.1%} before, {after:.1%} after the correction")
    return lines


def local_volatility_json(fit: ChainFit) -> dict[str, Any]:
    """Return the local volatility as `Market` and the other commands take it."""
    local = fit.local_volatility
    assert local is not None
    return {name: getattr(local, name).tolist() for name in ("times", "spots", "values")}


def write_table(folder: Path, name: str, table: pa.Table) -> None:
    """Write a table as Parquet and as CSV, empty cells where there is none."""
    for ending in ("parquet", "csv"):
        buffer = io.BytesIO()
        if ending == "parquet":
            pq.write_table(table, buffer)
        else:
            pa_csv.write_csv(_flat(table), buffer, pa_csv.WriteOptions(quoting_style="needed"))
        _write(folder / f"{name}.{ending}", buffer.getvalue())


def _flat(table: pa.Table) -> pa.Table:
    """Return a table whose cells CSV can hold: lists and the like as JSON."""
    for place, field in enumerate(table.schema):
        if pa.types.is_nested(field.type):
            texts = [
                None if cell is None else json.dumps(cell, default=str) for cell in table[place].to_pylist()
            ]
            table = table.set_column(place, field.name, pa.array(texts, pa.string()))
        elif pa.types.is_null(field.type):
            table = table.set_column(place, field.name, pa.nulls(table.num_rows, pa.string()))
    return table


def _write(path: Path, content: bytes) -> None:
    with replacement(path) as file:
        file.write(content)


def _curve(rate: Any) -> Any:
    return json.loads(rate) if isinstance(rate, str) else rate
