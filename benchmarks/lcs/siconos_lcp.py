"""Run by Siconos' own Python: solve the problems of a file by one of its methods, and write z, info and seconds."""

import importlib
import sys
import time

import numpy as np
from numpy.typing import ArrayLike


def main(problems: str, answers: str, method: str = "LEMKE") -> None:
    """Read M and q of each problem from one file of NumPy, and write the answers to another, with the iterations."""
    siconos = importlib.import_module("siconos.numerics")
    given = np.load(problems)
    results: dict[str, ArrayLike] = {}
    for k in range(int(given["count"])):
        M, q = np.asfortranarray(given[f"M{k}"]), given[f"q{k}"]
        z, w = np.zeros(q.size), np.zeros(q.size)
        options = siconos.SolverOptions(getattr(siconos, f"SICONOS_LCP_{method}"))
        problem = siconos.LCP(M, q)
        begin = time.process_time()
        info = siconos.linearComplementarity_driver(problem, z, w, options)
        results[f"seconds{k}"] = time.process_time() - begin
        results[f"z{k}"], results[f"info{k}"] = z, info
        results[f"iterations{k}"] = options.iparam[1]
    np.savez(answers, **results)  # type: ignore[arg-type]


if __name__ == "__main__":
    main(*sys.argv[1:])
