"""The progress of a batch on standard error: a bar on a terminal, or lines of JSON."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, TaskProgressColumn, TextColumn, TimeRemainingColumn
from rich.progress import Progress as Bar

from app.command_failures import print_json
from pricing_core.batch import Progress


@contextmanager
def shown_progress(quiet: bool) -> Iterator[Callable[[Progress], None] | None]:
    """Yield the callback for a batch; None where standard error is no terminal or `quiet` is wanted."""
    console = Console(stderr=True)
    if quiet or not console.is_terminal:
        yield None
        return
    columns = (TextColumn("{task.description}"), BarColumn(), TaskProgressColumn(), TimeRemainingColumn())
    with Bar(*columns, console=console, transient=True) as bar:
        task = bar.add_task("pricing", total=1.0)
        rate = _Rate()

        def show(progress: Progress) -> None:
            counts = progress.summary
            text = f"{counts.rows:,} rows, {rate.after(progress):,.0f} a second, {counts.rejected:,} rejected"
            bar.update(task, completed=progress.fraction, description=text)

        yield show


@contextmanager
def json_progress() -> Iterator[Callable[[Progress], None]]:
    """Yield the callback that prints one JSON object per unit of work."""
    rate = _Rate()

    def log(progress: Progress) -> None:
        unit = progress.unit_summary
        line = {
            "event": "unit",
            "unit": progress.unit,
            "rows": unit.rows,
            "priced": unit.priced,
            "rejected": unit.rejected,
            "below_tolerance": unit.below_tolerance,
            "fraction": round(progress.fraction, 6),
            "rows_per_second": round(rate.after(progress), 1),
        }
        print_json(line)

    yield log


class _Rate:
    """Counts the rows that this run has priced, those of an earlier run left out."""

    def __init__(self) -> None:
        self._since, self._rows = time.monotonic(), 0

    def after(self, progress: Progress) -> float:
        """Return the rows per second, after one more unit."""
        self._rows += progress.unit_summary.rows
        return self._rows / max(time.monotonic() - self._since, 1e-9)
