"""What does the option engine answer, to the last digit, before a change and after it?

`make` freezes the answers for 3,000 random contracts over all features into a file of JSON lines, in which every float
stands exactly; `compare` holds two such files against each other and writes a report. The contracts follow from the
seed alone, so the two files may come from two versions of the library:

    .venv/bin/python benchmarks/frozen_results.py make build/old.jsonl
    .venv/bin/python benchmarks/frozen_results.py make build/new.jsonl
    .venv/bin/python benchmarks/frozen_results.py compare build/old.jsonl build/new.jsonl --report build/report.md

`make` takes about ten minutes on one core.
"""

import argparse
import hashlib
import json
import math
import platform
import sys
import time
import warnings
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import pricing_core
from benchmarks.frozen_answers.comparison import compare, read_frozen
from benchmarks.frozen_answers.contracts import EVERY, FAMILIES, SEED, Answer, Contract, all_contracts
from benchmarks.frozen_answers.report import report
from pricing_core.american import (
    Greeks,
    contract_from,
    exercise_boundary,
    implied_volatility_many,
    price,
    price_many,
    value_surface,
)

VALUES = (
    *("price", "european_price", "early_exercise_premium", "intrinsic_value", "exercise_boundary"),
    *("error_estimate", "exercise_now", "status", "method", "message"),
)
DERIVATIVES = (
    *("delta", "gamma", "theta", "theta_per_day", "vega", "vega_per_point", "rho", "rho_per_point"),
    *("dividend_rho", "dividend_sensitivities"),
)
EXTENDED = ("price", "vanna", "volga", "rate_buckets", "volatility_buckets")
IMPLIED = ("volatility", "status", "european_price", "price", "error_estimate", "iterations", "message")
BOUNDARIES = ("time", "boundary", "other_boundary", "error_estimate")
SURFACE = ("value", "delta", "gamma", "exercised", "error_estimate")
SURFACE_SPOTS = (0.6, 0.8, 0.95, 1.0, 1.05, 1.3)  # Spots of a surface, as shares of the strike.
SURFACE_TIMES = (0.0, 0.4, 0.9)  # Times of a surface, as shares of the expiry.
METHOD_TOLERANCE = 1e-5  # Tolerance, in strikes, where a method is asked for by name.


def _row(contract: Contract, names: Sequence[str], greeks: Greeks) -> Answer:
    table = price_many(contract.columns(), tolerance=contract.tolerance, greeks=greeks)
    return {name: table[name][0] for name in names if name in table}


def _price(contract: Contract) -> Answer:
    return _row(contract, VALUES, "none")


def _greeks(contract: Contract) -> Answer:
    return _row(contract, (*VALUES, *DERIVATIVES), "standard")


def _boundary(contract: Contract) -> Answer:
    found = exercise_boundary(*contract_from(contract.terms), tolerance=contract.tolerance)
    return {name: getattr(found, name) for name in BOUNDARIES}


def _implied(contract: Contract) -> Answer:
    """Search for the volatility of the contract's own price to six digits, which slight changes leave alone."""
    own = price_many(contract.columns(), tolerance=contract.tolerance, greeks="none")["price"].item()
    observed = float(f"{own:.6g}")
    table = implied_volatility_many(contract.columns(), option_price=[observed], tolerance=contract.tolerance)
    return {"option_price": observed, **{name: table[name][0] for name in IMPLIED}}


def _extended(contract: Contract) -> Answer:
    found = price(*contract_from(contract.terms), tolerance=contract.tolerance, greeks="extended")
    further = {name: getattr(found, name) for name in EXTENDED}
    return {**further, "error_estimate": found.error_estimate, "status": found.status, "method": found.method}


def _by_method(contract: Contract, **asked: Any) -> Answer:
    terms = contract_from(contract.terms)
    found = price(*terms, tolerance=METHOD_TOLERANCE, greeks="none", **asked)
    return {name: getattr(found, name) for name in VALUES if name != "message"}


def _surface(contract: Contract) -> Answer:
    option, market = contract_from(contract.terms)
    found = value_surface(
        option,
        market,
        spots=[option.strike * share for share in SURFACE_SPOTS],
        times=[option.expiry * share for share in SURFACE_TIMES],
        tolerance=contract.tolerance,
    )
    return {name: getattr(found, name) for name in SURFACE}


class Kind(NamedTuple):
    """A kind of answers: of how many contracts, which families it leaves out, and what is asked."""

    size: int
    without: tuple[str, ...]
    ask: Callable[[Contract], Answer]


HEAVY = ("refused", "crowded cash dividends", "hard events")
FORMULAS = ("european", "never exercised", "at an edge")
KINDS = {
    "price": Kind(EVERY, (), _price),
    "greeks": Kind(EVERY - FAMILIES["hard events"].size, ("hard events",), _greeks),
    "greeks of hard events": Kind(
        FAMILIES["hard events"].size // 2, tuple(name for name in FAMILIES if name != "hard events"), _greeks
    ),
    "boundary": Kind(500, ("refused", "european"), _boundary),
    "implied": Kind(500, ("hard events",), _implied),
    "extended": Kind(100, HEAVY, _extended),
    "lcs": Kind(100, (*HEAVY, *FORMULAS), lambda contract: _by_method(contract, method="lcs")),
    "crank-nicolson": Kind(
        60, (*HEAVY, *FORMULAS), lambda contract: _by_method(contract, method="crank-nicolson")
    ),
    "policy": Kind(60, (*HEAVY, *FORMULAS), lambda contract: _by_method(contract, lcp_method="policy")),
    "surface": Kind(60, HEAVY, _surface),
}


def chosen(name: str, contracts: Sequence[Contract]) -> list[Contract]:
    """Return the contracts, in order, that a kind of answers is asked of; fewer where there are fewer contracts."""
    kind = KINDS[name]
    fit = [contract for contract in contracts if contract.family not in kind.without]
    count = min(len(fit), math.ceil(kind.size * len(contracts) / EVERY))
    places = np.random.default_rng((SEED, *name.encode())).permutation(len(fit))[:count]
    return [fit[place] for place in sorted(places.tolist())]


def plain(value: Any) -> Any:
    """Return what JSON holds exactly: missing numbers as None, infinite ones as text."""
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if isinstance(value, list | tuple):
        return [plain(entry) for entry in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None if math.isnan(value) else str(value)
    return value


def answered(ask: Callable[[Contract], Answer], contract: Contract) -> Answer:
    """Return the answer, or what was raised in its place."""
    try:
        return {name: plain(value) for name, value in ask(contract).items()}
    except Exception as fault:  # whatever it is, it belongs to the record
        return {"raised": f"{type(fault).__name__}: {fault}"}


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
