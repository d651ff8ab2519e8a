"""Parts put together in order, and the finished output given its name."""

from __future__ import annotations

import os
import shutil
from contextlib import ExitStack, suppress
from pathlib import Path
from types import TracebackType

from pricing_core.batch.csv_lines import header_line
from pricing_core.batch.locations import file_system, is_remote
from pricing_core.batch.plan import Plan
from pricing_core.batch.unit import REJECT_COLUMNS, Part
from pricing_core.batch.work_folder import HALF
from pricing_core.batch.writer import TableWriter, table_writer
from pricing_core.errors import InvalidInputError
from pricing_core.replacement import check_replaceable, publish, sync_folder

SUCCESS = "_SUCCESS"  # the last file that a folder is given


class Assembly:
    """The output and the rejects as they grow; leaving the `with` block without an error completes them.

    Parameters
    ----------
    plan : Plan
    folder : Path
        A folder of this machine for files that have no name yet.
    """

    def __init__(self, plan: Plan, folder: Path) -> None:
        self._plan, self._opened = plan, 0
        self.output, self.rejects = folder / f"output{HALF}", folder / f"rejects{HALF}"
        self._table = ExitStack()
        self._writer: TableWriter | None = None
        self._rejects = self.rejects.open("wb")
        self._rejects.write(header_line([*["file"] * plan.is_folder, *REJECT_COLUMNS]))

    def __enter__(self) -> Assembly:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        with self._rejects:
            if error is not None:
                with suppress(Exception):  # the first error is the one to report
                    self._table.__exit__(kind, error, trace)
                return
            self._open_up_to(len(self._plan.tables) - 1)
            self._table.close()
        if self._plan.is_folder:
            (self.output / SUCCESS).touch()

    def add(self, number: int, part: Part) -> None:
        """Append the next part, which belongs to the table of this number."""
        self._open_up_to(number)
        assert self._writer is not None
        self._writer.write(part.content)
        self._rejects.write(part.rejects)

    def sizes(self) -> dict[str, int]:
        """Return the bytes of each file, once complete."""
        if not self._plan.is_folder:
            return {"": self.output.stat().st_size}
        names = [planned.table.name for planned in self._plan.tables]
        return {name: (self.output / name).stat().st_size for name in names}

    def _open_up_to(self, number: int) -> None:
        while self._opened <= number:
            self._table.close()
            planned = self._plan.tables[self._opened]
            path = self.output / planned.table.name if self._plan.is_folder else self.output
            path.parent.mkdir(parents=True, exist_ok=True)
            file = self._table.enter_context(path.open("wb"))
            writer = table_writer(file, self._plan.output, planned.schema)
            self._writer = self._table.enter_context(writer)
            self._opened += 1


def check_publishable(target: str, *, folder: bool) -> None:
    """Accept a name that the output can be given, without touching anything.

    Raises
    ------
    InvalidInputError
        A folder is there that is no output of a batch.
    OSError
        It cannot be written there.
    """
    if is_remote(target):
        return
    path = Path(target)
    if not folder:
        check_replaceable(path)
    elif path.exists() and not _is_output(path):
        raise InvalidInputError(
            "output", target, "a new folder, or one that holds what a batch has written and nothing else"
        )
    elif not path.parent.is_dir():
        check_replaceable(path)


def publish_file(finished: Path, target: str) -> None:
    """Give a finished file its name; an object store gets it as a whole."""
    if is_remote(target):
        system, path = file_system(target)
        system.put_file(os.fspath(finished), path)
    else:
        publish(finished, Path(target))


def publish_folder(finished: Path, target: str) -> None:
    """Give a finished folder its name, in the place of an earlier one; in an object store, _SUCCESS comes last."""
    if is_remote(target):
        system, path = file_system(target)
        with suppress(FileNotFoundError):
            system.rm(path, recursive=True)
        names = sorted(
            file.relative_to(finished).as_posix() for file in finished.rglob("*") if file.is_file()
        )
        for name in sorted(names, key=lambda name: name == SUCCESS):
            system.put_file(os.fspath(finished / name), f"{path}/{name}")
        return
    place = Path(os.path.realpath(target))
    if place.exists():
        before = finished.with_name(f"before{HALF}")
        place.replace(before)
        finished.replace(place)
        shutil.rmtree(before)
    else:
        finished.replace(place)
    sync_folder(place.parent)


def _is_output(path: Path) -> bool:
    """Tell a folder that holds what a batch has written and nothing else, or that is empty, from any other."""
    files = [file for file in path.rglob("*") if not file.is_dir()]
    written = (path / SUCCESS).is_file() and all(
        file.suffix == ".parquet" or file.name == SUCCESS for file in files
    )
    return path.is_dir() and (written or not any(path.iterdir()))
