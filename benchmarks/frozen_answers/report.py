"""What a comparison of frozen answers found, in Markdown."""

import sys
from collections import Counter
from collections.abc import Iterator
from typing import Any

from benchmarks.frozen_answers.comparison import (
    BEYOND,
    CHANGED,
    JUDGED,
    LEVELS,
    SAME,
    VERDICTS,
    Comparison,
    Judged,
)
from benchmarks.frozen_answers.contracts import Contract
from benchmarks.reporting.files import rendered
from benchmarks.reporting.report import Report, Section, table
from pricing_core.american import Valuation, contract_from, price

FINEST = 1e-8  # Tolerance, in strikes, of the values that settle which of two is nearer.
SHOWN_IDS = 12  # Largest number of contracts named in a cell.


def fine_price(contract: Contract) -> Valuation | None:
    """Return the surer of two prices at the finest tolerance, by the chapter's road and by the usual engine."""
    found = []
    for method in ("lcs", "auto"):
        asked: Any = method
        try:
            finest = price(*contract_from(contract.terms), tolerance=FINEST, method=asked, greeks="none")
        except Exception as fault:  # then the other one has to do
            print(f"contract {contract.id}, {method}: {fault}", file=sys.stderr)
            continue
        if finest.price is not None and finest.error_estimate is not None:
            found.append((finest.error_estimate, method, finest))
    return min(found)[-1] if found else None


def report(found: Comparison, *, most: int = 40, fine: bool = False) -> str:
    """Return the comparison in Markdown.

    Parameters
    ----------
    most : int
        Rows shown of each list, the worst first.
    fine : bool
        Settle by fine values which of two prices that contradict each other is nearer; seconds each.
    """
    listed = sorted(
        (one for one in found.judged if one.verdict == CHANGED or (one.verdict == BEYOND and one.is_beyond)),
        key=lambda judged: -judged.difference / judged.contract.scale,
    )
    rows = [_row(one) | (_nearer(one) if fine else {}) for one in listed]
    told = f"""{sum(one.verdict == CHANGED for one in listed)} of the same compiled engine, another value;
        {sum(one.is_beyond for one in listed)} beyond both error estimates."""
    if fine and (sides := Counter(row["nearer"] or "not asked" for row in rows)):
        told += f" Nearer: {', '.join(f'{side} {count}' for side, count in sorted(sides.items()))}."
    parts = {
        "Files": ("", _files(found)),
        "Values by kind of answer and method": ("", _verdicts(found)),
        "Values that should not differ so": (told, rows[:most]),
        "Words, and numbers that came or went": ("", _words(found)),
        "Numbers, column by column": (COLUMNS, _columns(found)),
    }
    sections = tuple(Section(title, text, (table(title, part),)) for title, (text, part) in parts.items())
    text = rendered(Report("frozen-results", "Frozen results, old and new", "What differs?", sections), "md")
    return f"{text}\n{'No difference.' if found.is_same() else 'There are differences.'}\n"


COLUMNS = f"""Columns that do not agree to {SAME:.0e}. Differences are relative to the unit of the column (money:
max(1, strike, spot)), or to the old number where that is larger."""


def _files(found: Comparison) -> Iterator[dict[str, Any]]:
    for side, file in (("old", found.old), ("new", found.new)):
        counts = {"contracts": len(file.contracts), "answers": len(file.answers)}
        yield {
            "": side,
            "file": str(file.path),
            **counts,
            "made with": str(file.header),
            "sha256": file.checksum,
        }


def _verdicts(found: Comparison) -> Iterator[dict[str, Any]]:
    counts = Counter((judged.kind, judged.method, judged.verdict) for judged in found.judged)
    for kind, method in sorted({key[:2] for key in counts}):
        cells = {word: counts[kind, method, word] or None for word in VERDICTS}
        yield {"answers": kind, "method": method, **cells}


def _row(one: Judged) -> dict[str, Any]:
    asked = one.contract
    where = {"answers": one.kind, "contract": str(asked.id), "family": asked.family, "method": one.method}
    values = {"tolerance": asked.tolerance, "old": repr(one.old), "new": repr(one.new)}
    errors = {"difference": one.difference, "both errors": one.old_error + one.new_error}
    return {**where, **values, **errors, "verdict": one.verdict, "terms": str(asked.terms)}


def _nearer(judged: Judged) -> dict[str, Any]:
    """Return the cells that say which of two prices is nearer to a fine value."""
    fine = fine_price(judged.contract) if JUDGED.get(judged.kind, "price") == "price" else None
    if fine is None or fine.price is None:
        return dict.fromkeys(("fine", "its error", "from old", "from new", "nearer"))
    old, new = abs(judged.old - fine.price), abs(judged.new - fine.price)
    side = "undecided" if abs(old - new) <= (fine.error_estimate or 0.0) else "new" if new < old else "old"
    settled = {"fine": f"{fine.price:.12g}", "its error": f"{fine.error_estimate:.1e} ({fine.method})"}
    return {**settled, "from old": old, "from new": new, "nearer": side}


def _words(found: Comparison) -> Iterator[dict[str, Any]]:
    for words, ids in sorted(found.words.items(), key=lambda item: (*item[0][:2], -len(item[1]))):
        each = list(dict.fromkeys(ids))
        which = ", ".join(map(str, each[:SHOWN_IDS])) + (", ..." if len(each) > SHOWN_IDS else "")
        named = dict(zip(("answers", "column", "old", "new"), words, strict=True))
        yield {**named, "cells": len(ids), "contracts": len(each), "which": which}


def _columns(found: Comparison) -> Iterator[dict[str, Any]]:
    for names, column in sorted(found.columns.items()):
        if column.above[0]:
            named = dict(zip(("answers", "method", "column"), names, strict=True))
            above = {f"> {level:.0e}": count for level, count in zip(LEVELS, column.above, strict=True)}
            yield {**named, "cells": column.cells, **above, "largest": column.largest, "where": column.where}
