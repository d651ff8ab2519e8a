"""A system with inputs as one without: the inputs' own states follow those of the system."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import block_diag

from pricing_core.arrays import IndexSet, Matrix, Vector
from pricing_core.errors import NumericalError
from pricing_core.lcs.balancing import Units, balancing_units
from pricing_core.lcs.exosystem import Exosystem
from pricing_core.lcs.rational_system import EXACT_SIZE, has_short_numbers, rational_system
from pricing_core.lcs.system import LCS, PiecewiseConstant
from pricing_core.linalg.rational import as_fractions, rational, rational_array

# Largest coefficient in balanced units: products of a few of that size are still floating-point numbers.
FARTHEST = 1e100
# Share of the largest component of an input below which one is rounding.
NOTHING = 1e-14


@dataclass(frozen=True, slots=True, eq=False)
class AutonomousForm:
    """z' = A z + B u, y = C z + D u with z = (x, w), w' = S w: (11.69) with f = E_f w and g = E_g w.

    Parameters
    ----------
    system : LCS
        The system of z, without offsets, in units in which its entries are of order 1.
    units : Units
        Units of that system, in those that were given.
    states : int
        n, the number of leading entries of z that are x.
    inputs : tuple of Exosystem
        Whose states make up w: one for f and one for g, or one that both share.
    is_exact : bool
        Whether ranks are decided in rational arithmetic: for small systems whose numbers look meant as they are.
    given : LCS
        The system of x as it was given.
    readout : Matrix, shape (m, N), optional
        What a run reports in the place of x, as a function of z in the units given: where several systems follow each
        other, whose x differ.
    exchanged : tuple of int
        The pairs that a run reports with u and y exchanged.
    """

    system: LCS
    units: Units
    states: int
    inputs: tuple[Exosystem, ...]
    is_exact: bool
    given: LCS
    readout: Matrix | None = None
    exchanged: IndexSet = ()

    def reported(self, z: Matrix) -> Matrix:
        """Return the states that a run reports, for z in the form's units, shape (..., N)."""
        given = z * self.units.state
        return given[..., : self.states] if self.readout is None else np.asarray(given @ self.readout.T)

    def reported_mode(self, mode: IndexSet) -> IndexSet:
        """Return the pairs whose reported y is zero, or those whose reported u is, back."""
        return tuple(sorted({*mode}.symmetric_difference(self.exchanged)))

    def state_after(self, x: Vector, t: float) -> Vector:
        """Return z with the inputs as they are just after t, shape (n + p,)."""
        return whole_state(x, self.inputs, t)

    def knots(self, t0: float, t1: float) -> list[float]:
        """Return the times strictly inside at which an input starts anew."""
        return sorted({t for signal in self.inputs for t in signal.knots(t0, t1).tolist()})


def autonomous_form(system: LCS) -> AutonomousForm:
    """Return the system without inputs that has the same solutions.

    Raises
    ------
    NumericalError
        No units bring the coefficients close enough to each other.

    Examples
    --------
    A constant force is a state that does not change:

    >>> form = autonomous_form(LCS([[0.0]], [[1.0]], [[1.0]], f=[-9.81]))
    >>> form.system.A * form.units.rate * form.units.state[:, None] / form.units.state
    array([[ 0.  , -9.81],
           [ 0.  ,  0.  ]])
    >>> form.state_after(np.array([2.0]), 0.0)
    array([2., 1.])
    """
    n = system.shape[0]
    combined, inputs = with_inputs_as_states(system, rounded=n + system.shape[1] > EXACT_SIZE)
    A_seen, C_seen = combined.A.copy(), combined.C.copy()
    for part in (A_seen[:n, n:], C_seen[:, n:]):  # an offset of rounding size sets no unit
        part[np.abs(part) <= NOTHING * np.abs(part).max(axis=0, initial=0.0)] = 0.0
    units = balancing_units(A_seen, combined.B, C_seen, combined.D)
    _check_reach(combined, units)
    is_exact = sum(combined.shape) <= EXACT_SIZE and has_short_numbers(combined)
    return AutonomousForm(_balanced(combined, units, is_exact), units, n, inputs, is_exact, system)


def with_inputs_as_states(system: LCS, *, rounded: bool = False) -> tuple[LCS, tuple[Exosystem, ...]]:
    """Return the system of (x, w) in the units given, rounded or not, and the exosystems whose states w are."""
    n, k = system.shape
    f, g = (as_exosystem(signal) for signal in (system.f, system.g))
    inputs = (f,) if _share_states(system.f, system.g) else (f, g)
    A, B, C, D = (system.A, system.B, system.C, system.D) if rounded else system.given
    size = sum(signal.generator.shape[0] for signal in inputs)
    to_f, to_g = np.zeros((n, size)), np.zeros((k, size))
    to_f[:, : f.output.shape[1]] = f.output
    to_g[:, size - g.output.shape[1] :] = g.output
    generator = block_diag(*(signal.generator for signal in inputs))
    whole = LCS(
        np.vstack([np.hstack([A, to_f]), np.hstack([np.zeros((size, n)), generator])]),
        np.vstack([B, np.zeros((size, k))]),
        np.hstack([C, to_g]),
        D,
    )
    return whole, inputs


def whole_state(x: Vector, inputs: tuple[Exosystem, ...], t: float) -> Vector:
    """Return (x, w) with the inputs as they are just after t."""
    return np.concatenate([x, *(signal.state_after(t) for signal in inputs)])


def _check_reach(system: LCS, units: Units) -> None:
    with np.errstate(over="ignore"):
        parts = units.apply(system.A, system.B, system.C, system.D)
    largest = max(float(np.abs(part).max(initial=0.0)) for part in parts)
    if not largest < FARTHEST:
        raise NumericalError(
            f"in the best units that were found a coefficient is {largest:.1e}: take units of state, input and time in "
            "which the coefficients are closer to each other"
        )


def _balanced(system: LCS, units: Units, is_exact: bool) -> LCS:
    if not is_exact:
        return LCS(*units.apply(system.A, system.B, system.C, system.D))
    powers = Units(rational_array(units.state), rational_array(units.pair), rational(units.rate))
    return LCS(*(as_fractions(matrix) for matrix in powers.apply(*rational_system(system))))


def as_exosystem(signal: PiecewiseConstant | Exosystem) -> Exosystem:
    """Return the input as an exosystem: one state if it is constant, else one for each component that changes."""
    if isinstance(signal, Exosystem):
        return signal
    values: Matrix = signal.values
    if values.shape[0] == 1:
        used = np.any(values != 0.0)
        output = values.T if used else np.zeros((values.shape[1], 0))
        return Exosystem(np.zeros((output.shape[1],) * 2), output, np.ones((1, output.shape[1])))
    changing = np.flatnonzero(np.any(values != 0.0, axis=0))
    output = np.eye(values.shape[1])[:, changing]
    starts = np.concatenate([signal.times[:1] - 1.0, signal.jumps])
    return Exosystem(np.zeros((changing.size,) * 2), output, values[:, changing], starts)


def _share_states(f: PiecewiseConstant | Exosystem, g: PiecewiseConstant | Exosystem) -> bool:
    """Tell whether both inputs were given as outputs of one exosystem."""
    if not (isinstance(f, Exosystem) and isinstance(g, Exosystem)):
        return False
    return f.shares_states_with(g)
