"""Price a book on a cluster of processes, kill none of the numbers: they are those of one thread to the last bit.

`pricing batch book.csv priced.csv --engine dask --scheduler tcp://HOST:8786` uses a cluster that runs already.

Run it from the root of the project: .venv/bin/python examples/11_cluster_batch.py
"""

from pathlib import Path

from pricing_core.batch import run_batch


def main() -> None:
    """Price the example book twice into examples/out."""
    here = Path(__file__).parent
    alone, together = (here / "out" / f"11_{name}.csv" for name in ("one_thread", "cluster"))
    alone.parent.mkdir(exist_ok=True)
    run_batch(here / "book.csv", alone, threads=1)
    summary = run_batch(here / "book.csv", together, engine="dask", threads=2)
    print(f"{summary.priced} of {summary.rows} contracts priced by two processes")
    assert together.read_bytes() == alone.read_bytes()
    print("the two files are the same")


if __name__ == "__main__":  # the processes of the cluster read this file as well
    main()
