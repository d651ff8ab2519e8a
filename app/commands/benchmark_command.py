"""What `pricing benchmark` does: run benchmarks by name and write their reports."""

import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from importlib import import_module
from pathlib import Path
from typing import NamedTuple, Protocol, cast

from pricing_core.errors import InvalidInputError
from pricing_core.extras import needs_extra

SOURCE_TREE = Path(__file__).parents[2]
if not (SOURCE_TREE / "benchmarks" / "reporting" / "report.py").is_file():
    raise ImportError(
        "the benchmarks are not installed with the package: get its source, and run `make benchmark` there"
    )
sys.path.insert(0, str(SOURCE_TREE))  # an editable install makes known the packages alone

with needs_extra("plot"):
    from benchmarks.reporting.files import write_report
    from benchmarks.reporting.report import Report

MODULES = {
    "engine-frontier": "benchmarks.engine_frontier",
    "lcs-work-precision": "benchmarks.lcs_work_precision",
    "max-plus": "benchmarks.max_plus",
    "complementarity": "benchmarks.complementarity",
    "cost-scaling": "benchmarks.cost_scaling",
    "batch": "benchmarks.batch_throughput",
    "cluster": "benchmarks.cluster_scaling",
    "service": "benchmarks.service_load",
    "service-attack": "benchmarks.service_attack",
}


class Benchmark(Protocol):
    """A module of `benchmarks` that `pricing benchmark` runs."""

    def run(self, *, quick: bool) -> Report:
        """Measure and report; `quick` measures just enough to see that everything works."""
        ...


class Written(NamedTuple):
    """One finished benchmark, the files of its report, and how long it took."""

    name: str
    files: tuple[Path, ...]
    seconds: float


def check_names(names: Sequence[str]) -> tuple[str, ...]:
    """Return the benchmarks to run, each once; all of them where none is named.

    Raises
    ------
    InvalidInputError
        There is no benchmark of that name.
    """
    for name in names:
        if name not in MODULES:
            raise InvalidInputError("benchmark", name, "one of " + ", ".join(MODULES))
    return tuple(dict.fromkeys(names)) or tuple(MODULES)


def run_benchmarks(names: Sequence[str], folder: Path, *, quick: bool) -> Iterator[Written]:
    """Run one benchmark after the other; each report is written as soon as it is there.

    Parameters
    ----------
    folder : Path
        Made where it is missing.

    Raises
    ------
    OSError
        Nothing can be written there; seen before anything runs.
    """
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryFile(dir=folder):
        pass
    for name in names:
        start = time.perf_counter()
        benchmark = cast(Benchmark, import_module(MODULES[name]))
        files = write_report(benchmark.run(quick=quick), folder)
        yield Written(name, files, time.perf_counter() - start)
