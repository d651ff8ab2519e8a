"""A table of contracts priced unit by unit, with its rejects; the file is never held as a whole."""

from __future__ import annotations

import os
import tempfile
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path

import pyarrow as pa

from pricing_core.american.book.unusual import warn_of
from pricing_core.american.contracts.fields import DEFAULT_TOLERANCE, Greeks
from pricing_core.american.pricing_settings import PricingSettings
from pricing_core.batch.assembling import Assembly, check_publishable, publish_file, publish_folder
from pricing_core.batch.local_threads import Executor, LocalThreads, threads_or_all
from pricing_core.batch.locations import (
    as_location,
    is_remote,
    read_bytes,
    same_place,
    size_of,
    write_bytes,
)
from pricing_core.batch.manifest import MANIFEST, PART, Manifest, check_same_run
from pricing_core.batch.plan import Plan, plan_of
from pricing_core.batch.tables import is_folder
from pricing_core.batch.unit import Counts, Unit, read_part, sum_of
from pricing_core.batch.work_folder import LocalFolder, WorkFolder, claimed, work_folder
from pricing_core.errors import DamagedPartError, DiscardedPartsWarning, InvalidInputError, enumerated

ENGINES = ("local", "dask")
PathLike = str | os.PathLike[str]


@dataclass(frozen=True, slots=True)
class BatchSummary:
    """What became of the rows: rows = priced + rejected.

    Parameters
    ----------
    below_tolerance : int
        Priced rows whose error estimate is wider than asked for.
    unread : tuple of str
        Columns that passed through without being read, in their order: a misspelling shows here.
    done_before : bool
        The output was complete when the run was to be resumed: nothing was done.
    """

    rows: int = 0
    priced: int = 0
    rejected: int = 0
    below_tolerance: int = 0
    unread: tuple[str, ...] = ()
    done_before: bool = False

    @classmethod
    def of(cls, counts: Counts, unread: tuple[str, ...]) -> BatchSummary:
        """Return the summary of the rows that `counts` has counted, with the columns that were not read."""
        below = counts.statuses["tolerance_not_met"]
        return cls(counts.rows, counts.rows - counts.rejected, counts.rejected, below, unread)


@dataclass(frozen=True, slots=True)
class Progress:
    """How far a run has come.

    Parameters
    ----------
    unit : int
        Index of the unit that has just been priced.
    unit_summary : BatchSummary
        What became of its rows.
    summary : BatchSummary
        What became of all rows so far, those of an earlier run that is resumed included.
    fraction : float
        How much of the input is done, 0 to 1.
    """

    unit: int
    unit_summary: BatchSummary
    summary: BatchSummary
    fraction: float


def run_batch(
    source: PathLike,
    target: PathLike,
    *,
    rejects: PathLike | None = None,
    tolerance: float = DEFAULT_TOLERANCE,
    greeks: Greeks = "standard",
    greek_errors: bool = False,
    share_solves: bool = False,
    advice: bool = False,
    threads: int | None = None,
    engine: str = "local",
    scheduler: str | None = None,
    resume: bool = False,
    input_format: str | None = None,
    output_format: str | None = None,
    block_size: int | None = None,
    progress: Callable[[Progress], None] | None = None,
) -> BatchSummary:
    """Price every row of `source` into `target`: same rows, same order, the results appended as columns.

    A row that cannot be priced keeps its place, with a status and empty numbers, and is explained in
    `rejects`. Both files appear under their names complete or not at all. Until then what has been priced is kept in
    the folder TARGET.parts, which is also what an ended process leaves; TARGET.manifest.json stays beside the output.

    Parameters
    ----------
    source, target : path or URL
        Files ending in .csv, .csv.gz, .csv.zst or .parquet, or a folder of Parquet files, whose output is a folder
        with the same paths in it; a value in a path, as desk=rates/, is a column. URLs are opened by fsspec.
    rejects : path or URL, optional
        CSV with line, field, value, reason, in a folder also file; TARGET.rejects.csv unless stated. It is written
        even when it holds no row, so that the one of an earlier run does not stay.
    tolerance : float
        Fraction of the strike, for rows that state none.
    greeks : {"none", "standard", "extended"}
        Which Greeks are columns of the output, as in `price_many`.
    greek_errors : bool
        Whether their estimated errors are columns too.
    share_solves : bool
        As in `price_many`; rows share solves with those near them in the file.
    advice : bool
        Whether advice on exercise is in further columns, as in `price_many`.
    threads : int, optional
        How many rows are priced at a time; as many as the process has processors unless stated. The results do not
        depend on it.
    engine : {"local", "dask"}
        Who prices: threads of this process, or the worker processes of a Dask cluster, which must reach the folder
        TARGET.parts under the same name.
    scheduler : str, optional
        Address of the cluster's scheduler; without one, so many processes as `threads` says are started here.
    resume : bool
        Whether what an ended run with the same input, parameters and versions has left is used. The output is the
        same, value for value. Where nothing is left the work starts afresh; where all is done nothing is done.
    input_format, output_format : {"csv", "parquet"}, optional
        For names that end otherwise.
    block_size : int, optional
        Bytes of CSV, or rows of Parquet, in a unit of work; chosen by the size of the input unless stated.
    progress : callable, optional
        Called whenever a unit has been priced.

    Warns
    -----
    UnusualColumnWarning
        The first rows of a column look like days, percent or cents.
    DiscardedPartsWarning
        An earlier run on `target` has left finished parts, and `resume` was not asked for.

    Raises
    ------
    InvalidInputError
        An argument is not what it must be, the table as a whole cannot be read, two of the files are the same, another
        run writes to `target`, what is to be resumed was another run, or the input changed while it was read: what is
        written comes from the bytes whose SHA-256 the manifest has.
    OSError
        A file cannot be read or written; what has been priced is kept.
    """
    source, target = as_location(source), as_location(target)
    rejects = rejects_path(target) if rejects is None else as_location(rejects)
    settings = PricingSettings(tolerance, greeks, greek_errors, share_solves, advice=advice)
    executor = _executor(engine, scheduler, threads_or_all(threads))
    _check_distinct(source, target, rejects)
    plan = plan_of(
        source,
        target,
        settings,
        input_format=input_format,
        output_format=output_format,
        block_size=block_size,
    )
    warn_of(plan.unusual, callers=2)
    check_publishable(target, folder=plan.is_folder)
    check_publishable(rejects, folder=False)
    if resume and (done := _done_already(plan, target)) is not None:
        return done
    return _Run(plan, target, rejects, executor, progress).run(resume=resume)


def rejects_path(target: PathLike) -> str:
    """Return the file of rejected rows that belongs to the output `target` unless another one is stated.

    Examples
    --------
    >>> rejects_path("priced.parquet")
    'priced.parquet.rejects.csv'
    """
    return f"{os.fspath(target).rstrip('/')}.rejects.csv"


def parts_path(target: PathLike) -> str:
    """Return the folder that keeps what has been priced until the output `target` is complete."""
    location = as_location(target).rstrip("/")
    return f"{location if is_remote(location) else os.path.realpath(location)}.parts"


def manifest_path(target: PathLike) -> str:
    """Return where the manifest of a complete output lies."""
    return f"{as_location(target).rstrip('/')}.manifest.json"


class _Run:
    """One run, from its first unit to its output."""

    def __init__(
        self,
        plan: Plan,
        target: str,
        rejects: str,
        executor: Executor,
        progress: Callable[[Progress], None] | None,
    ) -> None:
        self._plan, self._target, self._rejects = plan, target, rejects
        self._executor, self._progress = executor, progress
        self._tables: list[int] = []  # of each unit
        self._parts: list[str] = []  # the name of each unit's part
        self._counts: dict[int, Counts] = {}  # of the units that have their parts
        self._total = Counts()
        self._added: list[Counts] = []  # of the units that have been put together

    def run(self, *, resume: bool) -> BatchSummary:
        with _folder_of(self._target) as folder, claimed(folder, self._target):
            there = self._resumable(folder) if resume else self._discarded(folder)
            try:
                if not there:
                    folder.clear()
                    folder.write(MANIFEST, pa.py_buffer(Manifest(self._plan.identity).as_bytes()))
                self._price(folder, there)
            except BaseException as error:
                self._leave(folder, error, there)
                raise
            folder.remove()
        return BatchSummary.of(self._total, self._plan.unread)

    def _resumable(self, folder: WorkFolder) -> set[str]:
        """Return the names of the files that are there, after a check that they are of this run."""
        there = folder.names()
        before = Manifest.of_bytes(folder.read(MANIFEST).to_pybytes()) if MANIFEST in there else None
        if before is None:
            return set()
        check_same_run(before.identity, self._plan.identity, parts_path(self._target))
        return there

    def _discarded(self, folder: WorkFolder) -> set[str]:
        """Warn of the parts of an earlier run, and return that nothing of it is used."""
        parts = sum(name.endswith(PART) for name in folder.names())
        if parts:
            told = f"finished parts of an earlier run are discarded ({parts} in {parts_path(self._target)})"
            advice = "--resume keeps them where the input and the parameters are the same"
            warnings.warn(f"{told}: {advice}", DiscardedPartsWarning, stacklevel=4)
        return set()

    def _price(self, folder: WorkFolder, there: set[str]) -> None:
        with _scratch(folder) as scratch:
            with Assembly(self._plan, scratch) as assembly:
                for index, counts in self._executor.price(self._units(folder, there), folder):
                    self._count(index, counts)
                    self._tell(index)
                    self._put_together(assembly, folder)
                self._put_together(assembly, folder)
            sizes = assembly.sizes()
            self._plan.check_input()
            publish_file(assembly.rejects, self._rejects)
            (publish_folder if self._plan.is_folder else publish_file)(assembly.output, self._target)
        if not _is_device(self._target):
            manifest = Manifest(self._plan.identity, "complete", self._added, sizes)
            write_bytes(manifest_path(self._target), manifest.as_bytes())

    def _units(self, folder: WorkFolder, there: set[str]) -> Iterator[Unit]:
        """Yield the units that have no part yet."""
        for number, unit in self._plan.units():
            self._tables.append(number)
            self._parts.append(unit.part)
            if unit.part in there:
                with suppress(DamagedPartError):
                    self._count(unit.index, read_part(folder, unit.part).counts)
                    continue
            yield unit

    def _put_together(self, assembly: Assembly, folder: WorkFolder) -> None:
        """Append the parts that are next in order."""
        while (index := len(self._added)) in self._counts:
            part = read_part(folder, self._parts[index])
            assembly.add(self._tables[index], part)
            self._added.append(part.counts)

    def _tell(self, index: int) -> None:
        if self._progress is None:
            return
        total, unread = self._total, self._plan.unread
        of_unit = BatchSummary.of(self._counts[index], unread)
        fraction = total.rows / max(self._plan.rows, total.rows, 1)
        self._progress(Progress(index, of_unit, BatchSummary.of(total, unread), fraction))

    def _count(self, index: int, counts: Counts) -> None:
        self._counts[index] = counts
        self._total = self._total.plus(counts)

    def _leave(self, folder: WorkFolder, error: BaseException, there: set[str]) -> None:
        """Keep what another run can go on from, and say so; remove what none can."""
        if (
            isinstance(error, OSError) and error.errno is not None and error.filename is None
        ):  # as of a full disk
            error.filename = parts_path(self._target)
        kept = 0
        if not (isinstance(error, InvalidInputError) or _is_device(self._target)):
            kept = len(self._counts) or len(folder.names().intersection(self._parts)) or len(there)
        if kept:
            place = parts_path(self._target)
            error.add_note(f"{kept} units of the work are kept in {place}: --resume goes on from there")
        else:
            folder.remove()


@contextmanager
def _folder_of(target: str) -> Iterator[WorkFolder]:
    """Yield the folder of the parts; that of an output that is a device or a pipe does not outlive the run."""
    if not _is_device(target):
        yield work_folder(parts_path(target))
        return
    with tempfile.TemporaryDirectory(prefix="pricing-") as name:
        yield LocalFolder(Path(name))


def _is_device(target: str) -> bool:
    path = Path(target)
    return not is_remote(target) and path.exists() and not (path.is_file() or path.is_dir())


@contextmanager
def _scratch(folder: WorkFolder) -> Iterator[Path]:
    """Yield a folder of this machine."""
    if isinstance(folder, LocalFolder):
        yield folder.path
        return
    with tempfile.TemporaryDirectory(prefix="pricing-") as name:
        yield Path(name)


def _done_already(plan: Plan, target: str) -> BatchSummary | None:
    """Return the summary of a complete output of the same run; None if there is none."""
    found = Manifest.of_bytes(read_bytes(manifest_path(target)))
    if found is None or found.state != "complete" or found.identity != plan.identity:
        return None
    if any(size_of(f"{target}/{name}" if name else target) != size for name, size in found.sizes.items()):
        return None
    return replace(BatchSummary.of(sum_of(found.units), plan.unread), done_before=True)


def _executor(engine: str, scheduler: str | None, threads: int) -> Executor:
    if engine not in ENGINES:
        raise InvalidInputError("engine", engine, enumerated([f'"{name}"' for name in ENGINES], "or"))
    if engine == "local":
        if scheduler is not None:
            raise InvalidInputError("scheduler", scheduler, 'left out where the engine is not "dask"')
        return LocalThreads(threads)
    from pricing_core.batch.cluster import DaskCluster  # noqa: PLC0415

    return DaskCluster(scheduler, threads)


def _check_distinct(source: str, target: str, rejects: str) -> None:
    seen: dict[str, str] = {}
    for name, location in {"input": source, "output": target, "rejects": rejects}.items():
        other = seen.setdefault(same_place(location), name)
        if other != name:
            raise InvalidInputError(name, location, f"another file than the {other}")
    kept = {same_place(manifest_path(target)), same_place(parts_path(target))}
    place = same_place(rejects)
    if place in kept or os.path.dirname(place) in kept:
        raise InvalidInputError(
            "rejects", rejects, "a file beside what the run keeps, its parts and its manifest"
        )
    inner, outer = f"{same_place(target)}/", f"{same_place(source)}/"
    if is_folder(source) and (inner.startswith(outer) or outer.startswith(inner)):
        raise InvalidInputError("output", target, "a folder that is neither in the input nor around it")
