"""From the elements of a circuit to its linear complementarity system, all eliminations in rational numbers."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction

import numpy as np
from numpy.typing import ArrayLike

from pricing_core.arrays import Matrix, Vector
from pricing_core.errors import InvalidInputError, Told
from pricing_core.lcs import LCS, Exosystem
from pricing_core.linalg.rational import (
    RationalMatrix,
    as_fractions,
    rational_array,
    rounded,
    sparse_product,
)
from pricing_core.models.circuits.circuit_lcs import CircuitLCS
from pricing_core.models.circuits.elements import Capacitor, Element, Inductor
from pricing_core.models.circuits.equations import ONE, Number, Symbol
from pricing_core.models.circuits.hidden_constraints import (
    completed,
    continuous_coordinates,
)
from pricing_core.models.circuits.ports import chosen_multipliers
from pricing_core.models.circuits.readings import Readings, SourceSignals
from pricing_core.models.circuits.signals import Value, stacked
from pricing_core.models.circuits.solution import solved_states, solved_unknowns
from pricing_core.models.circuits.tableau import source_values, tableau
from pricing_core.models.circuits.topology import check_topology

CONTINUOUS = 1e-9  # relative: smaller steps of a source are rounding


def assemble(elements: Sequence[Element], *, shared: bool = False) -> CircuitLCS:
    """Return the system of the circuit.

    With `shared`, its f and g are outputs of one exosystem that all configurations of a circuit have in common.

    Hidden constraints are completed, multipliers chosen, the states expressed by coordinates x = W s that stay
    continuous when sources step, and everything else solved for (x, u, e, e', ...).

    Raises
    ------
    InvalidInputError
        See `DiodeCircuit.to_lcs`.
    """
    check_topology(elements)
    equations = tableau(elements, with_one=shared)
    full = completed(equations)
    u, y = chosen_multipliers(equations, full.K)
    W = continuous_coordinates(equations, full.P_s, u)
    n, k = W.shape[0], len(u)
    states = solved_states(full, W, k)
    unknowns = solved_unknowns(full, states, u)
    X, U, E = slice(0, n), slice(n, n + k), slice(n + k, None)
    slopes = sparse_product(sparse_product(W, equations.rate), unknowns)
    A, B, C, D = slopes[:, X], slopes[:, U], unknowns[y][:, X], unknowns[y][:, U]
    M = equations.M
    Q = sparse_product(sparse_product(states[:, X].T, M), states[:, X])
    values = [value for _, value in source_values(elements, with_one=shared)]
    branches = {branch.name for element in elements for branch in element.branches}
    sources = SourceSignals(
        tuple(name for _, name in equations.sources),
        stacked(values),
        full.R.shape[1] // max(len(values), 1) - 1,
    )
    _check_steps(sources, rounded(unknowns[y][:, E]))
    f, g = (_input(sources, values, rows, shared) for rows in (slopes[:, E], unknowns[y][:, E]))
    given = rational_array(np.array(_initial(elements)))
    named = [
        j
        for j, (kind, name) in enumerate(equations.unknowns)
        if kind == "v" or (kind == "i" and name in branches)
    ]
    return CircuitLCS(
        system=LCS(as_fractions(A), as_fractions(B), as_fractions(C), as_fractions(D), f, g),
        state_names=_state_names(elements, states[:, X], states[:, E], sources.names),
        x0=rounded(W @ given),
        multiplier_names=tuple(_port_name(equations.unknowns[j]) for j in u),
        slack_names=tuple(_port_name(equations.unknowns[j]) for j in y),
        stored_energy=rounded(Q),
        exact_energy=Q,
        readings=Readings(
            tuple("{}({})".format(*equations.unknowns[j]) for j in named),
            *(rounded(unknowns[named][:, part]) for part in (X, U, E)),
        ),
        element_states=Readings(
            tuple(name for _, name in equations.states), *(rounded(states[:, part]) for part in (X, U, E))
        ),
        entry=rounded(W),
        storage=rounded(M),
        initial_element_states=initial_states(elements),
        sources=sources,
    )


def _input(
    sources: SourceSignals, values: Sequence[Value], rows: RationalMatrix, shared: bool
) -> ArrayLike | Exosystem | None:
    """Return the input rows (e, e', ...): a vector of exact numbers where all sources are constant."""
    if not shared and all(isinstance(value, int | float | Fraction) for value in values):
        constant = rational_array(np.array([*values, *[0] * (rows.shape[1] - len(values))], dtype=object))
        return as_fractions(rows @ constant)
    return sources.times(rounded(rows))


def _check_steps(sources: SourceSignals, g: Matrix) -> None:
    """Refuse a source that steps where a slack contains its derivative."""
    count = len(sources.names)
    sizes = np.abs(sources.output).max(axis=1, initial=0.0)
    differentiated = np.flatnonzero(np.any(g[:, count:] != 0.0, axis=0))
    for t in sources.signal.jumps:
        steps = np.abs(sources.after(t) - sources.before(t)) > CONTINUOUS * sizes
        for column in differentiated[steps[differentiated]]:
            name = sources.names[column % count]
            remedy = "continuous, since the circuit differentiates it: use a piecewise linear source"
            raise InvalidInputError("value of source", Told(name), remedy)


def _initial(elements: Sequence[Element]) -> list[Number]:
    return [
        e.initial_voltage if isinstance(e, Capacitor) else e.initial_current
        for e in elements
        if isinstance(e, Capacitor | Inductor)
    ]


def initial_states(elements: Sequence[Element]) -> Vector:
    """Return the voltages of all capacitors and the currents of all inductors as they are given."""
    return np.array([float(value) for value in _initial(elements)])


def _port_name(symbol: Symbol) -> str:
    kind, name = symbol
    return f"i({name})" if kind == "i" else f"-v({name})"


def _state_names(
    elements: Sequence[Element], X: RationalMatrix, E: RationalMatrix, sources: Sequence[str]
) -> tuple[str, ...]:
    """Name each x_i after the first state s that is x_i but for a share of the sources, which is subtracted."""
    stores = [e for e in elements if isinstance(e, Capacitor | Inductor)]
    names = []
    for unit in np.eye(X.shape[1], dtype=int):
        row = next(j for j in range(len(stores)) if np.all(X[j] == unit))
        name = f"{'v' if isinstance(stores[row], Capacitor) else 'i'}({stores[row].name})"
        for column in np.flatnonzero(E[row] != 0).tolist():
            share, order = float(E[row, column]), column // len(sources)
            sign = "-" if share > 0 else "+"
            source = sources[column % len(sources)]
            factor = "" if abs(share) == 1.0 and source != ONE else f"{abs(share):g} "
            name += f" {sign} {factor}{source}".rstrip() + "'" * order
        names.append(name)
    return tuple(names)
