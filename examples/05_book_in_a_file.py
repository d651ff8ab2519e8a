"""Price a book from a file into a file, with a row that is wrong, and go on after an interruption.

`pricing batch examples/book.csv priced.csv` is the same on the command line.

Run it from the root of the project: .venv/bin/python examples/05_book_in_a_file.py
"""

import csv
import math
from pathlib import Path

from pricing_core.batch import run_batch

HERE = Path(__file__).parent
BOOK, PRICED = HERE / "out" / "05_book.csv", HERE / "out" / "05_priced.csv"

# The example book, and one more row whose spot is negative.
BOOK.parent.mkdir(exist_ok=True)
with (HERE / "book.csv").open(newline="", encoding="utf-8") as file:
    rows = list(csv.DictReader(file))
with BOOK.open("w", newline="", encoding="utf-8") as file:
    writer = csv.DictWriter(file, list(rows[0]))
    writer.writeheader()
    writer.writerows([*rows, rows[0] | {"id": "wrong", "spot": "-3"}])

summary = run_batch(BOOK, PRICED, tolerance=1e-5)
print(f"{summary.rows} rows, {summary.rejected} of them rejected")

with PRICED.open(newline="", encoding="utf-8") as file:
    priced = list(csv.DictReader(file))
with PRICED.with_name("05_priced.csv.rejects.csv").open(newline="", encoding="utf-8") as file:
    (reject,) = csv.DictReader(file)
print(f"line {reject['line']}: {reject['field']} is {reject['value']}, {reject['reason']}")
total = math.fsum(float(row["price"]) for row in priced if row["status"] == "ok")
print(f"the others are worth {total:.2f} together, one of each")
assert [row["id"] for row in priced] == [row["id"] for row in rows] + ["wrong"]
assert int(reject["line"]) == len(rows) + 2  # the heading is line 1

# With everything done `resume` finds nothing left to do, and the output stays as it is.
before = PRICED.read_bytes()
run_batch(BOOK, PRICED, tolerance=1e-5, resume=True)
assert PRICED.read_bytes() == before
