"""Run by Siconos' own Python: simulate the mechanical systems of a file by its Moreau-Jean scheme, and write states."""

import importlib
import sys
import time
from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike, NDArray

TOLERANCE, SWEEPS = 1e-12, 100_000


def main(problems: str, answers: str) -> None:
    """Read systems from one file of NumPy; write the states, shape (steps + 1, 2 n), and the seconds to another."""
    given = np.load(problems)
    results: dict[str, ArrayLike] = {}
    for k in range(int(given["count"])):
        one = {name.removesuffix(f"_{k}"): given[name] for name in given.files if name.endswith(f"_{k}")}
        begin = time.perf_counter()
        results[f"x_{k}"] = simulate(one)
        results[f"seconds_{k}"] = time.perf_counter() - begin
    np.savez(answers, **results)  # type: ignore[arg-type]


def simulate(given: Mapping[str, NDArray[np.float64]]) -> NDArray[np.float64]:
    """Return the states at every step, theta = 1/2, with Newton's restitution and Coulomb's friction in the plane."""
    kernel, numerics = (importlib.import_module(f"siconos.{name}") for name in ("kernel", "numerics"))
    end, h = float(given["end"]), float(given["h"])
    body = kernel.LagrangianLinearTIDS(
        given["q0"], given["v0"], given["mass"], given["stiffness"], given["damping"]
    )
    body.setFExtPtr(given["force"])
    model = kernel.NonSmoothDynamicalSystem(0.0, end)
    model.insertDynamicalSystem(body)
    for normal, tangent, offset, friction in zip(
        given["normals"], given["tangents"], given["offset"], given["friction"], strict=True
    ):
        law = kernel.NewtonImpactFrictionNSL(float(given["restitution"]), 0.0, float(friction), 2)
        relation = kernel.LagrangianLinearTIR(np.array([normal, tangent]), np.array([offset, 0.0]))
        model.link(kernel.Interaction(law, relation), body)
    solver = kernel.FrictionContact(2, numerics.SICONOS_FRICTION_2D_NSGS)
    solver.numericsSolverOptions().dparam[numerics.SICONOS_DPARAM_TOL] = TOLERANCE
    solver.numericsSolverOptions().iparam[numerics.SICONOS_IPARAM_MAX_ITER] = SWEEPS
    run = kernel.TimeStepping(model, kernel.TimeDiscretisation(0.0, h), kernel.MoreauJeanOSI(0.5), solver)
    states = [np.concatenate([body.q(), body.velocity()])]
    while run.hasNextEvent():
        run.computeOneStep()
        states.append(np.concatenate([body.q(), body.velocity()]))
        run.nextStep()
    return np.array(states)


if __name__ == "__main__":
    main(*sys.argv[1:])
