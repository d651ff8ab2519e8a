"""What does the option engine answer, to the last digit, before a change and after it?

`make` freezes the answers for 3,000 random contracts over all features into a file of JSON lines, in which every float
stands exactly; `compare` holds two such files against each other and writes a report. The contracts follow from the
seed alone, so the two files may come from two versions of the library:

    .venv/bin/python -m benchmarks.frozen_results make build/old.jsonl
    .venv/bin/python -m benchmarks.frozen_results make build/new.jsonl
    .venv/bin/python -m benchmarks.frozen_results compare build/old.jsonl build/new.jsonl --report build/report.md

`make` takes about ten minutes on one core.
"""

import argparse
import hashlib
import json
import platform
import sys
import time
import warnings
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

import pricing_core
from benchmarks.frozen_answers.answers import KINDS, answered, chosen
from benchmarks.frozen_answers.comparison import compare, read_frozen
from benchmarks.frozen_answers.contracts import EVERY, all_contracts
from benchmarks.frozen_answers.report import report
from pricing_core.american import price_many


@dataclass(slots=True)
class Clock:
    """Seconds by kind of answers and method."""

    seconds: dict[tuple[str, str], list[float]]

    def add(self, kind: str, method: str, seconds: float) -> None:
        """Count one answer."""
        self.seconds.setdefault((kind, method), []).append(seconds)

    def lines(self) -> Iterator[str]:
        """Give one line per kind and method."""
        yield f"{'answers':22s}{'method':26s}{'rows':>6s}{'seconds':>10s}{'mean':>10s}{'longest':>10s}"
        for (kind, method), times in sorted(self.seconds.items()):
            total, longest = sum(times), max(times)
            numbers = f"{len(times):6d}{total:10.1f}{total / len(times):10.4f}{longest:10.2f}"
            yield f"{kind:22s}{method:26s}{numbers}"
        yield f"{'all':48s}{sum(map(len, self.seconds.values())):6d}{sum(map(sum, self.seconds.values())):10.1f}"


def _say(line: str) -> None:
    print(line, flush=True)


def make(path: Path, count: int | None = None, show: Callable[[str], None] = _say) -> str:
    """Write the answers to a file, show how long they took, and return the file's checksum.

    Parameters
    ----------
    count : int, optional
        How many contracts, evenly spread over all; the other answers become fewer with them.
    """
    contracts = all_contracts()
    if count is not None:
        contracts = [contracts[place * len(contracts) // count] for place in range(count)]
    engine = price_many(contracts[0].columns(), greeks="none")["engine_version"][0]
    versions = {"engine": engine, "kernel": pricing_core.kernel_name(), "numpy": np.__version__}
    records: list[dict[str, Any]] = [{"header": {**versions, "python": platform.python_version()}}]
    records += [{"contract": asdict(contract)} for contract in contracts]
    clock, methods = Clock({}), {}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for name, kind in KINDS.items():
            asked = chosen(name, contracts)
            show(f"{name}: {len(asked)} contracts")
            for contract in asked:
                begun = time.perf_counter()
                answer = answered(kind.ask, contract)
                seconds = time.perf_counter() - begun
                method = answer.get("method") or answer.get("status") or "raised"
                if name == "price":
                    methods[contract.id] = method
                clock.add(name, answer.get("method") or methods[contract.id], seconds)
                records.append({"kind": name, "id": contract.id, "answer": answer})
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("".join(json.dumps(record, allow_nan=False) + "\n" for record in records))
    for line in ("", *clock.lines(), "", *_counts(records)):
        show(line)
    checksum = hashlib.sha256(path.read_bytes()).hexdigest()
    show(f"\nsha256 {checksum}  {path}")
    return checksum


def _counts(records: Iterable[dict[str, Any]]) -> Iterator[str]:
    """Give one line per kind of answers, method and status."""
    counts: Counter[tuple[str, str, str]] = Counter()
    for record in records:
        if "kind" in record:
            answer = record["answer"]
            status = "raised" if "raised" in answer else answer.get("status") or ""
            counts[record["kind"], answer.get("method") or "", status] += 1
    yield f"{'answers':22s}{'method':26s}{'status':20s}{'rows':>6s}"
    for (kind, method, status), rows in sorted(counts.items()):
        yield f"{kind:22s}{method:26s}{status:20s}{rows:6d}"


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command; 1 where a comparison finds differences."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    commands = parser.add_subparsers(dest="command", required=True)
    making = commands.add_parser("make", help="freeze the answers of this version into a file")
    making.add_argument("file", type=Path)
    making.add_argument("--contracts", type=int, help=f"how many, spread over all; by default all {EVERY}")
    comparing = commands.add_parser("compare", help="hold two files against each other")
    comparing.add_argument("old", type=Path)
    comparing.add_argument("new", type=Path)
    comparing.add_argument("--report", type=Path, help="where the report goes; by default it is printed")
    comparing.add_argument("--fine", action="store_true", help="tell which of contradicting prices is nearer")
    comparing.add_argument("--rows", type=int, default=40, help="of each list; by default 40")
    given = parser.parse_args(arguments)
    if given.command == "make":
        make(given.file, given.contracts)
        return 0
    found = compare(read_frozen(given.old), read_frozen(given.new))
    text = report(found, most=given.rows, fine=given.fine)
    if given.report is None:
        print(text, end="")
    else:
        given.report.write_text(text)
        print(text.splitlines()[-1], f"The report is {given.report}.")
    return 0 if found.is_same() else 1


if __name__ == "__main__":
    sys.exit(main())
