"""Run by Siconos' own Python: solve the problems of a file by its Lemke method, and write z, info and seconds."""

import sys
import time

import numpy as np
import siconos.numerics as sn  # type: ignore[import-not-found]
from numpy.typing import ArrayLike

given = np.load(sys.argv[1])
results: dict[str, ArrayLike] = {}
for k in range(int(given["count"])):
    M, q = np.asfortranarray(given[f"M{k}"]), given[f"q{k}"]
    z, w = np.zeros(q.size), np.zeros(q.size)
    options = sn.SolverOptions(sn.SICONOS_LCP_LEMKE)
    problem = sn.LCP(M, q)
    begin = time.perf_counter()
    info = sn.linearComplementarity_driver(problem, z, w, options)
    results[f"seconds{k}"] = time.perf_counter() - begin
    results[f"z{k}"], results[f"info{k}"] = z, info
np.savez(sys.argv[2], **results)  # type: ignore[arg-type]
