"""Systems in series, in parallel and in a loop."""

from __future__ import annotations

import numpy as np

from pricing_core.errors import InvalidInputError, NumericalError, Told
from pricing_core.max_plus.algebra import add, multiply
from pricing_core.max_plus.arcs import arcs_of
from pricing_core.max_plus.circuits import named
from pricing_core.max_plus.divergence import diverging_circuit
from pricing_core.max_plus.matrices import Numbers, as_floats, as_matrix, dense, epsilon, is_exact
from pricing_core.max_plus.star import star
from pricing_core.max_plus.system import MaxPlusSystem, as_system


def series(first: MaxPlusSystem, second: MaxPlusSystem) -> MaxPlusSystem:
    """Return the system in which the output of the first is the input of the second.

    The state is (x of the first, x of the second).

    Raises
    ------
    InvalidInputError
        The first has not as many outputs as the second has inputs.

    Examples
    --------
    >>> joined = series(MaxPlusSystem([[1.0]], [[0.0]]), MaxPlusSystem([[2.0]], [[3.0]]))
    >>> joined.A, joined.C
    (array([[  1., -inf],
           [  3.,   2.]]), array([[-inf,   0.]]))
    """
    first, second = _alike(first, second)
    if first.shape[2] != second.shape[1]:
        raise InvalidInputError(
            "second", Told(f"{second.shape[1]} inputs"), f"a system with {first.shape[2]} inputs"
        )
    return MaxPlusSystem(
        _lower_blocks(first.A, _product(second.B, first.C), second.A),
        np.vstack([first.B, _product(second.B, first.D)]),
        np.hstack([_product(second.D, first.C), second.C]),
        _product(second.D, first.D),
    )


def parallel(first: MaxPlusSystem, second: MaxPlusSystem) -> MaxPlusSystem:
    """Return the system that gives `first` and `second` one input, and whose output is the later one of theirs.

    Raises
    ------
    InvalidInputError
        The numbers of inputs or of outputs differ.

    Examples
    --------
    >>> both = parallel(MaxPlusSystem([[1.0]], [[0.0]]), MaxPlusSystem([[2.0]], [[3.0]]))
    >>> both.B.ravel(), both.C
    (array([0., 3.]), array([[0., 0.]]))
    """
    first, second = _alike(first, second)
    if first.shape[1:] != second.shape[1:]:
        raise InvalidInputError(
            "second",
            Told("{} inputs and {} outputs".format(*second.shape[1:])),
            "a system with {} inputs and {} outputs".format(*first.shape[1:]),
        )
    return MaxPlusSystem(
        _lower_blocks(first.A, epsilon((second.shape[0], first.shape[0]), first.A), second.A),
        np.vstack([first.B, second.B]),
        np.hstack([first.C, second.C]),
        np.maximum(first.D, second.D),
    )


def feedback(system: MaxPlusSystem, K: object) -> MaxPlusSystem:
    """Return the system with u = v + K y, v being the new input: events also wait for what has come out.

    Parameters
    ----------
    system : MaxPlusSystem
    K : array_like, shape (m, p)

    Raises
    ------
    InvalidInputError
        K has another shape.
    NumericalError
        A circuit of K D has a positive weight: inputs would wait for themselves; it is named.

    Notes
    -----
    u = (K D)* (v + K C x). Source: Baccelli, Cohen, Olsder, Quadrat 1992, section 5.6.

    Examples
    --------
    >>> feedback(MaxPlusSystem([[1.0]], [[2.0]]), [[3.0]]).A
    array([[5.]])
    """
    gain = dense(as_matrix("K", K, top=False))
    _, m, p = as_system("system", system).shape
    if gain.shape != (m, p):
        raise InvalidInputError("K", Told(f"shape {gain.shape}"), f"a matrix of shape {(m, p)}")
    loop = _product(gain, system.D)
    system = system if is_exact(loop) else _in_floats(system)
    circuit = diverging_circuit(arcs_of(loop))
    if circuit:
        raise NumericalError(
            f"the circuit {named(circuit)} of the inputs in K D has a positive weight: they wait for themselves"
        )
    closed = dense(star(loop))
    inputs, outputs = _product(system.B, closed), _product(system.D, closed)
    return MaxPlusSystem(
        add(system.A, _product(inputs, _product(gain, system.C))),
        inputs,
        add(system.C, _product(outputs, _product(gain, system.C))),
        outputs,
    )


def _product(left: Numbers, right: Numbers) -> Numbers:
    return dense(multiply(left, right))


def _lower_blocks(upper: Numbers, below: Numbers, lower: Numbers) -> Numbers:
    return np.block([[upper, epsilon((len(upper), len(lower)), upper)], [below, lower]])


def _alike(first: MaxPlusSystem, second: MaxPlusSystem) -> tuple[MaxPlusSystem, MaxPlusSystem]:
    """Return both as they are where both are exact, else both in floats."""
    first, second = as_system("first", first), as_system("second", second)
    if is_exact(first.A) and is_exact(second.A):
        return first, second
    return _in_floats(first), _in_floats(second)


def _in_floats(system: MaxPlusSystem) -> MaxPlusSystem:
    return MaxPlusSystem(*(as_floats(block) for block in (system.A, system.B, system.C, system.D)))
