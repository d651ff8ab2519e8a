"""Every method of `solve`, and of Siconos, on every problem of the sets: verdict, residual, pivots and time."""

import os
import subprocess
import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from benchmarks.problems.complementarity_sets import SetProblem
from pricing_core.errors import InfeasibleError, InvalidInputError, NumericalError
from pricing_core.lcp import LCP, Method, scaled_residual, solve

METHODS: tuple[Method, ...] = (
    "auto",
    "lemke",
    "block-pivoting",
    "murty",
    "policy",
    "psor",
    "multigrid",
    "exact",
)
PEER_METHODS = ("LEMKE", "PIVOT", "ENUM", "NEWTON_FB_FBLSA", "PGS")
LARGEST_ENUMERATED = 12  # unknowns; the peer's enumeration tries all bases
PEER = Path(__file__).with_name("siconos_lcp.py")
RIGHT = 1e-9  # scaled residual of an answer that counts as right
LIMIT = 5.0  # seconds for each problem
PEER_LIMIT = 60.0  # seconds for a process of the peer


class Cell(NamedTuple):
    """The result of one solver on one problem.

    `verdict`: "solved"; "refused" with a proof that there is no solution, or where none is known; "not for it", a
    matrix that the method does not take; "not found", which claims nothing; "wrong".
    """

    group: str
    problem: str
    unknowns: int
    solver: str
    verdict: str
    residual: float | None
    pivots: int | None
    milliseconds: float | None


def by_us(group: str, given: SetProblem, method: Method) -> Cell:
    """Return the result of one method of `solve`."""
    residual: float | None = None
    pivots: int | None = None
    begin = time.process_time()
    try:
        found = solve(given.problem, method=method, time_limit=LIMIT)
    except InfeasibleError:
        verdict = "wrong" if given.is_solvable else "refused"
    except InvalidInputError:
        verdict = "not for it"
    except NumericalError:
        verdict = "not found"
    else:
        residual, pivots = scaled_residual(given.problem, found.z), found.iterations
        verdict = "solved" if residual <= RIGHT else "wrong"
    elapsed = 1e3 * (time.process_time() - begin)
    return Cell(group, given.name, given.problem.size, method, verdict, residual, pivots, elapsed)


def by_siconos(group: str, problems: Sequence[SetProblem], method: str) -> Iterator[Cell]:
    """Return the results of one method of Siconos on the LCPs of a set; it needs PRICING_SICONOS_PYTHON.

    A process that ends, or does not end in time, has found nothing.
    """
    python = os.environ.get("PRICING_SICONOS_PYTHON")
    mine = [given for given in problems if isinstance(given.problem, LCP)]
    if method == "ENUM":
        mine = [given for given in mine if given.problem.size <= LARGEST_ENUMERATED]
    if not python or not mine:
        return
    together = _peer_cells(group, mine, method, python)
    for k, given in enumerate(mine):  # one by one where a problem ended the process
        alone = [] if together else _peer_cells(group, [given], method, python)
        yield together[k] if together else alone[0] if alone else _nothing(group, given, method)


def _nothing(group: str, given: SetProblem, method: str) -> Cell:
    return Cell(group, given.name, given.problem.size, f"Siconos {method}", "not found", None, None, None)


def _peer_cells(group: str, problems: Sequence[SetProblem], method: str, python: str) -> list[Cell]:
    arrays: dict[str, ArrayLike] = {"count": len(problems)}
    for k, given in enumerate(problems):
        arrays |= {f"M{k}": given.problem.dense(), f"q{k}": given.problem.q}
    with tempfile.TemporaryDirectory() as folder:
        source, target = Path(folder) / "given.npz", Path(folder) / "found.npz"
        np.savez(source, **arrays)  # type: ignore[arg-type]
        command = [python, str(PEER), str(source), str(target), method]
        try:
            subprocess.run(command, check=True, capture_output=True, timeout=PEER_LIMIT)
        except (subprocess.CalledProcessError, subprocess.TimeoutExpired):
            return []
        with np.load(target) as results:
            return [_peer_cell(group, given, method, results, k) for k, given in enumerate(problems)]


def _peer_cell(group: str, given: SetProblem, method: str, results: np.lib.npyio.NpzFile, k: int) -> Cell:
    z = results[f"z{k}"]
    nothing = _nothing(group, given, method)
    if not np.isfinite(z).all():
        return nothing
    residual = scaled_residual(given.problem, np.maximum(z, 0.0))
    right = residual <= RIGHT and float(z.min(initial=0.0)) >= -RIGHT
    verdict = "solved" if right else "not found" if results[f"info{k}"] else "wrong"
    return nothing._replace(
        verdict=verdict,
        residual=residual,
        pivots=int(results[f"iterations{k}"]),
        milliseconds=1e3 * float(results[f"seconds{k}"]),
    )


def cells(group: str, problems: Sequence[SetProblem]) -> Iterator[Cell]:
    """Return the results of all methods on all problems of a set."""
    for given in problems:
        yield from (by_us(group, given, method) for method in METHODS)
    for method in PEER_METHODS:
        yield from by_siconos(group, problems, method)
