"""What a comparison of frozen answers found, in Markdown."""

import json
import sys
from collections import Counter
from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

from benchmarks.frozen_answers.comparison import (
    BEYOND,
    CHANGED,
    JUDGED,
    LEVELS,
    SAME,
    VERDICTS,
    Comparison,
    Frozen,
    Judged,
)
from benchmarks.frozen_answers.contracts import Contract
from pricing_core.american import contract_from, price

FINEST = 1e-8  # Tolerance, in strikes, of the values that settle which of two is nearer.
SHOWN_IDS = 12  # Largest number of contracts named in a cell.


class Fine(NamedTuple):
    """A price at the finest tolerance, and its own error; money."""

    value: float
    error: float
    method: str


def fine_price(contract: Contract) -> Fine | None:
    """Return the surer of two prices at the finest tolerance, by the method of lines and by the usual engine."""
    found = []
    for method in ("lcs", "auto"):
        asked: Any = method
        try:
            finest = price(*contract_from(contract.terms), tolerance=FINEST, method=asked, greeks="none")
        except Exception as fault:  # then the other one has to do
            print(f"contract {contract.id}, {method}: {fault}", file=sys.stderr)
            continue
        if finest.price is not None and finest.error_estimate is not None:
            found.append(Fine(finest.price, finest.error_estimate, finest.method))
    return min(found, key=lambda fine: fine.error, default=None)


def _nearer(judged: Judged, fine: Fine | None) -> list[str]:
    """Return the cells that say which of the two is nearer to a fine value."""
    if fine is None:
        return ["none", "", "", "", ""]
    old, new = abs(judged.old - fine.value), abs(judged.new - fine.value)
    side = "undecided" if abs(old - new) <= fine.error else "new" if new < old else "old"
    return [f"{fine.value:.12g}", f"{fine.error:.1e} ({fine.method})", f"{old:.2e}", f"{new:.2e}", side]


def _table(head: Sequence[str], rows: Iterable[Sequence[object]]) -> list[str]:
    body = list(rows)
    if not body:
        return ["None."]
    lines = [head, ["---"] * len(head), *body]
    return ["| " + " | ".join(str(cell).replace("|", "\\|") for cell in line) + " |" for line in lines]


def _ids(rows: Sequence[int]) -> str:
    each = list(dict.fromkeys(rows))
    return ", ".join(map(str, each[:SHOWN_IDS])) + (", ..." if len(each) > SHOWN_IDS else "")


def report(found: Comparison, *, most: int = 40, fine: bool = False) -> str:
    """Return the comparison in Markdown.

    Parameters
    ----------
    most : int
        Rows shown of each list, the worst first.
    fine : bool
        Settle by fine values which of two prices that contradict each other is nearer; seconds each.
    """
    changed = sorted(
        (judged for judged in found.judged if judged.verdict == CHANGED),
        key=lambda judged: -judged.difference / judged.contract.scale,
    )
    beyond = sorted(
        (judged for judged in found.judged if judged.verdict in (CHANGED, BEYOND) and judged.is_beyond),
        key=lambda judged: -judged.difference / judged.contract.scale,
    )
    lines = ["# Frozen results, old and new", "", *_files(found), "", *_verdicts(found), ""]
    lines += [
        f"## The same compiled engine, another value: {len(changed)}",
        "",
        *_changed(changed[:most]),
        "",
    ]
    lines += [f"## Beyond both error estimates: {len(beyond)}", "", *_beyond(beyond, most, fine), ""]
    lines += ["## Words, and numbers that came or went", "", *_words(found), ""]
    lines += ["## Numbers, column by column", "", *_columns(found), ""]
    named = {judged.contract.id: judged.contract for judged in (*changed[:most], *beyond[:most])}
    if named:
        lines += ["## Contracts named above", ""]
        lines += [f"    {row}: {json.dumps(contract.terms)}" for row, contract in sorted(named.items())] + [
            ""
        ]
    lines.append("No difference." if found.is_same() else "There are differences.")
    return "\n".join(lines) + "\n"


def _files(found: Comparison) -> list[str]:
    sides = (("old", found.old), ("new", found.new))
    return _table(
        ["", "file", "contracts", "answers", "made with", "sha256"],
        [
            (side, file.path, len(file.contracts), len(file.answers), _versions(file), file.checksum)
            for side, file in sides
        ],
    )


def _versions(file: Frozen) -> str:
    return ", ".join(f"{name} {version}" for name, version in file.header.items())


def _verdicts(found: Comparison) -> list[str]:
    counts = Counter((judged.kind, judged.method, judged.verdict) for judged in found.judged)
    rows = sorted({(kind, method) for kind, method, _ in counts})
    body = [[*row, *(counts[*row, verdict] or "" for verdict in VERDICTS)] for row in rows]
    return ["## Values by kind of answer and method", "", *_table(["answers", "method", *VERDICTS], body)]


def _changed(judged: Sequence[Judged]) -> list[str]:
    head = ["answers", "contract", "family", "method", "tolerance", "old", "new", "relative", "explained"]
    return _table(
        head,
        [
            (
                *(row.kind, row.contract.id, row.contract.family, row.method, row.contract.tolerance),
                *(repr(row.old), repr(row.new), f"{row.difference / row.contract.scale:.1e}"),
                "no" if row.is_beyond else "by the errors",
            )
            for row in judged
        ],
    )


def _beyond(judged: Sequence[Judged], most: int, fine: bool) -> list[str]:
    """Return the list, and before it how often each side is nearer."""
    head = ["answers", "contract", "family", "method", "tolerance", "old", "new", "difference", "both errors"]
    cells = [
        [
            *(row.kind, row.contract.id, row.contract.family, row.method, row.contract.tolerance),
            *(f"{row.old:.12g}", f"{row.new:.12g}", f"{row.difference:.2e}"),
            f"{row.old_error:.1e} + {row.new_error:.1e}",
        ]
        for row in judged
    ]
    if not fine:
        return _table(head, cells[:most])
    prices: dict[int, Fine | None] = {}
    for row, line in zip(judged, cells, strict=True):
        if JUDGED.get(row.kind, "price") != "price":
            line.extend([""] * 5)
            continue
        if row.contract.id not in prices:
            prices[row.contract.id] = fine_price(row.contract)
        line.extend(_nearer(row, prices[row.contract.id]))
    nearer = Counter(str(line[-1]) or "not asked" for line in cells)
    told = "Nearer: " + ", ".join(f"{side} {count}" for side, count in sorted(nearer.items())) + "."
    head += ["fine", "its error", "from old", "from new", "nearer"]
    return [told, "", *_table(head, cells[:most])]


def _words(found: Comparison) -> list[str]:
    rows = sorted(found.words.items(), key=lambda item: (*item[0][:2], -len(item[1])))
    head = ["answers", "column", "old", "new", "cells", "contracts", "which"]
    return _table(head, [(*words, len(ids), len(set(ids)), _ids(ids)) for words, ids in rows])


def _columns(found: Comparison) -> list[str]:
    head = [
        "answers",
        "method",
        "column",
        "cells",
        *(f"> {level:.0e}" for level in LEVELS),
        "largest",
        "where",
    ]
    rows = [
        (*names, column.cells, *column.above, f"{column.largest:.1e}", column.where)
        for names, column in sorted(found.columns.items())
        if column.above[0]
    ]
    told = (
        f"{len(found.columns) - len(rows)} of {len(found.columns)} columns agree to {SAME:.0e}; these do not. "
        "Differences are relative to the unit of the column (money: max(1, strike, spot)), or to the old number "
        "where that is larger."
    )
    return (
        [told, "", *_table(head, rows)]
        if rows
        else [f"All {len(found.columns)} columns agree to {SAME:.0e}."]
    )
