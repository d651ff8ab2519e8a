"""A progress bar on standard error, where somebody can see it."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, TaskProgressColumn, TextColumn, TimeRemainingColumn
from rich.progress import Progress as Bar

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

        def show(progress: Progress) -> None:
            counts = progress.summary
            text = f"{counts.rows:,} rows, {counts.rejected:,} rejected"
            bar.update(task, completed=progress.fraction_read, description=text)

        yield show
