"""Price the example book, draw one exercise boundary, and show what came out."""

import csv
import os
import subprocess
import sys
from collections import Counter
from pathlib import Path

from rich.box import SIMPLE
from rich.console import Console
from rich.table import Table

HERE = Path(os.path.relpath(Path(__file__).parent))
BOOK, PRICED, PLOT = HERE / "book.csv", HERE / "out" / "book.csv", HERE / "out" / "boundary.png"
PUT = "--option-type put --spot 100 --strike 100 --expiry 1 --rate 0.05 --volatility 0.2"
SHOWN_ROWS = 6  # from the top, and as many from the end: those with cash dividends
SHOWN_COLUMNS = {  # column of the file: heading and format; 80 characters in all
    "id": ("id", "s"),
    "option_type": ("type", "s"),
    "spot": ("spot", ".1f"),
    "strike": ("strike", ".1f"),
    "expiry": ("years", ".3f"),
    "price": ("price", ".4f"),
    "delta": ("delta", ".3f"),
    "exercise_boundary": ("boundary", ".2f"),
    "error_estimate": ("error", ".0e"),
}


def run_pricing(*arguments: str) -> None:
    """Run the `pricing` command of this environment, after showing it as one would type it."""
    print("$ pricing", " ".join(arguments), flush=True)
    subprocess.run([Path(sys.executable).with_name("pricing"), *arguments], check=True)


def summary(rows: list[dict[str, str]]) -> Table:
    """Return the first and the last rows as a table, with the count of each status beneath."""
    shown_rows = rows[:SHOWN_ROWS] + rows[SHOWN_ROWS:][-SHOWN_ROWS:]
    counts = Counter(row["status"] for row in rows)
    caption = ", ".join(f"{status}: {count}" for status, count in counts.most_common())
    table = Table(
        title=f"{len(shown_rows)} of {len(rows)} contracts",
        caption=caption,
        box=SIMPLE,
        pad_edge=False,
    )
    for heading, shape in SHOWN_COLUMNS.values():
        table.add_column(heading, justify="left" if shape == "s" else "right")
    for row in shown_rows:
        table.add_row(*(shown(row[name], shape) for name, (_, shape) in SHOWN_COLUMNS.items()))
    return table


def shown(cell: str, shape: str) -> str:
    """Return a cell of the file as the table shows it; a missing number stays empty."""
    return cell if shape == "s" or not cell else format(float(cell), shape)


def main() -> None:
    """Write examples/out/book.csv and examples/out/boundary.png."""
    PRICED.parent.mkdir(exist_ok=True)
    run_pricing("batch", str(BOOK), str(PRICED))
    run_pricing("boundary", *PUT.split(), "--plot", str(PLOT))
    with PRICED.open(newline="", encoding="utf-8") as file:
        Console().print(summary(list(csv.DictReader(file))))
    print(f"every contract: {PRICED}\nexercise boundary: {PLOT}")
    program = os.path.relpath(Path(sys.executable).with_name("pricing"))
    print(f"a page to try contracts on, at http://127.0.0.1:8000/: {program} serve")


if __name__ == "__main__":
    main()
