"""Run by a Python that has nosnoc: simulate relays x' = A x - B sgn(C x) by finite elements with switch detection."""

import importlib
import itertools
import sys
import time

import numpy as np


def main(problem: str, answer: str) -> None:
    """Read A, B, C, x0, the times wanted, and the number of steps up to the last; write the states and seconds."""
    casadi, nosnoc = importlib.import_module("casadi"), importlib.import_module("nosnoc")
    given = np.load(problem)
    A, B, C, x0 = (given[name] for name in ("A", "B", "C", "x0"))
    h, steps = float(given["h"]), int(given["steps"])
    options = nosnoc.NosnocOpts()
    options.irk_scheme, options.n_s = nosnoc.IrkSchemes.RADAU_IIA, int(given["stages"])
    options.N_finite_elements, options.terminal_time = 2, h
    options.print_level, options.comp_tol, options.sigma_N = 0, 1e-10, 1e-10
    x = casadi.SX.sym("x", x0.size)
    signs = list(itertools.product((1, -1), repeat=C.shape[0]))
    fields = casadi.horzcat(*(A @ x - B @ np.array(sign, dtype=float) for sign in signs))
    model = nosnoc.NosnocModel(x=x, x0=x0, F=[fields], S=[np.array(signs)], c=[casadi.mtimes(C, x)])
    begin = time.perf_counter()
    solver = nosnoc.NosnocSolver(options, model)
    built = time.perf_counter() - begin
    looper = nosnoc.NosnocSimLooper(solver, x0, steps)
    looper.run()
    results = looper.get_results()
    places = [int(np.abs(results["t_grid"] - t).argmin()) for t in given["times"]]
    np.savez(answer, x=results["X_sim"][places], seconds=float(results["cpu_nlp"].sum()), built=built)


if __name__ == "__main__":
    main(*sys.argv[1:])
