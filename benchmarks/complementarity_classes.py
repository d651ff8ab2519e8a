"""Which classes of complementarity problems are solved, refused rightly, or answered wrongly, and in what time?"""

import argparse
import os
import subprocess
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from benchmarks.lcs.lcp_classes import CLASSES, Posed, members
from pricing_core.arrays import Vector
from pricing_core.errors import InfeasibleError, NumericalError
from pricing_core.lcp import LCP, scaled_residual, solve

PEER = Path(__file__).parent / "lcs" / "siconos_lcp.py"
RIGHT = 1e-9  # scaled residual of an answer that counts as right
LARGEST_COUNTED = 100  # larger problems are timed on a few members


class Verdict(NamedTuple):
    """The outcome of a problem: "solved", "refused", "wrong" or "not found", and the seconds it took."""

    word: str
    seconds: float


def verdict_on(posed: Posed, answer: Callable[[LCP], Vector]) -> Verdict:
    """Ask for an answer and return the verdict on it: a proof that there is none is wrong where there is one."""
    problem = LCP(posed.M, posed.q)
    begin = time.process_time()
    try:
        z = answer(problem)
    except InfeasibleError:
        return Verdict("wrong" if posed.is_solvable else "refused", time.process_time() - begin)
    except NumericalError:
        return Verdict("not found", time.process_time() - begin)
    seconds = time.process_time() - begin
    right = (z >= 0.0).all() and scaled_residual(problem, z) <= RIGHT
    return Verdict("solved" if right else "wrong", seconds)


def by_siconos(problems: Sequence[Posed]) -> list[Verdict] | None:
    """Return the verdicts on Siconos' Lemke method, None where PRICING_SICONOS_PYTHON names no Python that has it.

    An answer that does not solve the problem counts as not found where Siconos says so itself.
    """
    python = os.environ.get("PRICING_SICONOS_PYTHON")
    if not python:
        return None
    with tempfile.TemporaryDirectory() as folder:
        given, found = Path(folder) / "given.npz", Path(folder) / "found.npz"
        arrays: dict[str, ArrayLike] = {"count": len(problems)}
        for k, posed in enumerate(problems):
            arrays |= {f"M{k}": posed.M, f"q{k}": posed.q}
        np.savez(given, **arrays)  # type: ignore[arg-type]
        subprocess.run([python, str(PEER), str(given), str(found)], check=True, capture_output=True)
        with np.load(found) as results:
            return [_peer_verdict(posed, results, k) for k, posed in enumerate(problems)]


def _peer_verdict(posed: Posed, results: np.lib.npyio.NpzFile, k: int) -> Verdict:
    seconds, z = float(results[f"seconds{k}"]), results[f"z{k}"]
    right = bool((z >= 0.0).all()) and scaled_residual(LCP(posed.M, posed.q), z) <= RIGHT
    word = "solved" if right else ("not found" if results[f"info{k}"] else "wrong")
    return Verdict(word, seconds)


def by_us(problems: Sequence[Posed]) -> list[Verdict]:
    """Return the verdicts on `solve`."""
    return [verdict_on(posed, lambda problem: solve(problem).z) for posed in problems]


def summary(verdicts: Sequence[Verdict] | None) -> str:
    """Return the counts and the median time in words."""
    if verdicts is None:
        return "-"
    counts = Counter(verdict.word for verdict in verdicts)
    words = ", ".join(
        f"{counts[word]} {word}" for word in ("solved", "refused", "not found", "wrong") if counts[word]
    )
    return f"{words}; {1e3 * float(np.median([verdict.seconds for verdict in verdicts])):.3g} ms"


def main() -> None:
    """Print one line for each class and size."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=20, help="members of each class and size")
    parser.add_argument("--only", default="", help="classes whose names hold this")
    arguments = parser.parse_args()
    print(f"{'class':<38}{'size':>5}  {'pricing_core':<44}Siconos, Lemke")
    for name, (_, sizes) in CLASSES.items():
        for size in sizes if arguments.only in name else ():
            count = arguments.count if size < LARGEST_COUNTED else max(arguments.count // 5, 2)
            problems = list(members(name, size, count))
            ours, peers = by_us(problems), by_siconos(problems)
            print(f"{name:<38}{size:>5}  {summary(ours):<44}{summary(peers)}", flush=True)


if __name__ == "__main__":
    main()
