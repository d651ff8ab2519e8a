"""Two files of frozen answers held against each other."""

import hashlib
import json
import math
from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from benchmarks.frozen_answers.answers import Answer
from benchmarks.frozen_answers.contracts import Contract

COMPILED = ("premium-march", "obstacle-march", "closed-form")  # Methods that owe the same digits.
SAME = 1e-13  # Largest relative difference of two numbers that count as equal.
LEVELS = (1e-13, 1e-9, 1e-6)  # Relative differences above which the cells of a column are counted.
WORDS = ("status", "method", "message", "raised", "exercise_now", "exercised")
JUDGED = {
    "boundary": "boundary",
    "surface": "value",
    "implied": None,
}  # What is judged where it is not the price.
UNITS_OF_ONE = ("delta", "vanna", "charm", "dividend_sensitivities", "volatility", "time", "iterations")


@dataclass(frozen=True, slots=True)
class Frozen:
    """The content of one file of frozen answers."""

    path: Path
    checksum: str
    header: Mapping[str, str]
    contracts: Mapping[int, Contract]
    answers: Mapping[tuple[str, int], Answer]

    def method(self, kind: str, row: int) -> str:
        """Return the method of an answer, that of the contract's price where the answer names none."""
        own = self.answers.get((kind, row), {}).get("method")
        return str(own or self.answers.get(("price", row), {}).get("method") or "none")


def read_frozen(path: Path) -> Frozen:
    """Read what `make` wrote."""
    header: Mapping[str, str] = {}
    contracts: dict[int, Contract] = {}
    answers: dict[tuple[str, int], Answer] = {}
    text = path.read_bytes()
    for record in map(json.loads, text.decode().splitlines()):
        if "header" in record:
            header = record["header"]
        elif "contract" in record:
            contracts[record["contract"]["id"]] = Contract(**record["contract"])
        else:
            answers[record["kind"], record["id"]] = record["answer"]
    return Frozen(path, hashlib.sha256(text).hexdigest(), header, contracts, answers)


def leaves(value: Any) -> list[Any]:
    """Return the entries of nested lists in order."""
    if isinstance(value, list):
        return [leaf for entry in value for leaf in leaves(entry)]
    return [value]


@dataclass(slots=True)
class Differences:
    """How far a column of one kind and method differs, relative to the unit or, if larger, the old number."""

    cells: int
    above: list[int]
    largest: float
    where: int

    def add(self, difference: float, row: int) -> None:
        """Count one cell."""
        self.cells += 1
        for place, level in enumerate(LEVELS):
            self.above[place] += difference > level
        if difference > self.largest:
            self.largest, self.where = difference, row


class Judged(NamedTuple):
    """A value of an answer, the worst where it has several; money, errors as they were estimated."""

    kind: str
    contract: Contract
    method: str
    verdict: str
    old: float
    new: float
    old_error: float
    new_error: float

    @property
    def difference(self) -> float:
        """Return the distance of the old value and the new one."""
        return abs(self.new - self.old)

    @property
    def is_beyond(self) -> bool:
        """Whether the two error estimates do not explain the difference."""
        return self.difference > self.old_error + self.new_error + SAME * self.contract.scale


IDENTICAL, EQUAL, CHANGED = "identical", "equal to 1e-13", "same engine, changed"
WITHIN, BEYOND, UNKNOWN = "within both errors", "beyond both errors", "no estimate"
VERDICTS = (IDENTICAL, EQUAL, CHANGED, WITHIN, BEYOND, UNKNOWN)


@dataclass(slots=True)
class Comparison:
    """Everything in which two files differ."""

    old: Frozen
    new: Frozen
    columns: dict[tuple[str, str, str], Differences]
    words: dict[tuple[str, str, str, str], list[int]]
    judged: list[Judged]

    def note(self, kind: str, column: str, old: str, new: str, row: int) -> None:
        """Count one word that became another."""
        self.words[kind, column, old, new].append(row)

    def is_same(self) -> bool:
        """Whether nothing differs, but for the last digits of numbers."""
        return not self.words and not any(column.above[0] for column in self.columns.values())


def compare(old: Frozen, new: Frozen) -> Comparison:
    """Hold the answers to the same contracts against each other.

    Raises
    ------
    ValueError
        The contracts are not the same.
    """
    if old.contracts != new.contracts:
        raise ValueError(f"{old.path} and {new.path} hold the answers for other contracts")
    found = Comparison(old, new, {}, defaultdict(list), [])
    for kind, row in sorted({*old.answers, *new.answers}):
        before, after = old.answers.get((kind, row)), new.answers.get((kind, row))
        if before is None or after is None:
            found.note(kind, "", _raised(before), _raised(after), row)
            continue
        if "raised" in before or "raised" in after:
            if before != after:
                found.note(kind, "raised", _raised(before), _raised(after), row)
            continue
        _compare_columns(found, kind, row, before, after)
        judged = _judge(found, kind, row, before, after)
        if judged is not None:
            found.judged.append(judged)
    return found


def _methods(found: Comparison, kind: str, row: int) -> str:
    before, after = found.old.method(kind, row), found.new.method(kind, row)
    return before if before == after else f"{before} -> {after}"


def _compare_columns(found: Comparison, kind: str, row: int, before: Answer, after: Answer) -> None:
    scale, method = found.old.contracts[row].scale, _methods(found, kind, row)
    for name in dict.fromkeys((*before, *after)):
        if name not in before or name not in after:
            found.note(kind, name, _there(name, before), _there(name, after), row)
            continue
        cells = leaves(before[name]), leaves(after[name])
        if len(cells[0]) != len(cells[1]):
            found.note(kind, name, _size(before[name]), _size(after[name]), row)
            continue
        unit = 1.0 if name in UNITS_OF_ONE else 1.0 / scale if name == "gamma" else scale
        for first, second in zip(*cells, strict=True):
            if name in WORDS or first is None or second is None:
                if first != second:
                    found.note(kind, name, _word(name, first), _word(name, second), row)
                continue
            a, b = float(first), float(second)
            difference = 0.0 if a == b else abs(b - a) / max(unit, abs(a))
            column = found.columns.setdefault(
                (kind, method, name), Differences(0, [0] * len(LEVELS), 0.0, row)
            )
            column.add(math.inf if math.isnan(difference) else difference, row)


def _raised(answer: Answer | None) -> str:
    return "missing" if answer is None else str(answer.get("raised", "an answer"))


def _there(name: str, answer: Answer) -> str:
    return "there" if name in answer else "missing"


def _size(value: Any) -> str:
    return f"{len(leaves(value))} entries" if isinstance(value, list) else _word("", value)


def _word(name: str, cell: Any) -> str:
    if name in WORDS or cell is None:
        return "none" if cell is None else str(cell)
    return "a number"


def _judge(found: Comparison, kind: str, row: int, before: Answer, after: Answer) -> Judged | None:
    """Judge the value of an answer by its method and errors; None where either has none."""
    name = JUDGED.get(kind, "price")
    if name is None or any(
        name not in answer or "error_estimate" not in answer for answer in (before, after)
    ):
        return None
    columns = [leaves(answer[n]) for n in (name, "error_estimate") for answer in (before, after)]
    if len({len(column) for column in columns}) > 1:
        return None
    contract, method, worst = found.old.contracts[row], _methods(found, kind, row), None
    for cells in zip(*columns, strict=True):
        if cells[0] is None or cells[1] is None:
            continue
        old, new, *errors = (math.nan if cell is None else float(cell) for cell in cells)
        judged = Judged(kind, contract, method, "", old, new, *errors)
        judged = judged._replace(verdict=_verdict(judged))
        if worst is None or _badness(judged) > _badness(worst):
            worst = judged
    return worst


def _badness(judged: Judged) -> tuple[int, float]:
    return VERDICTS.index(judged.verdict), judged.difference


def _verdict(judged: Judged) -> str:
    if judged.old == judged.new:
        return IDENTICAL
    if judged.difference <= SAME * max(judged.contract.scale, abs(judged.old)):
        return EQUAL
    if judged.method in COMPILED:
        return CHANGED
    if math.isnan(judged.old_error + judged.new_error):
        return UNKNOWN
    return BEYOND if judged.is_beyond else WITHIN
