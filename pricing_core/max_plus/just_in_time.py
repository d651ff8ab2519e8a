"""Just-in-time control: start as late as possible, and still be done when asked."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pricing_core.errors import InvalidInputError, Told
from pricing_core.max_plus.algebra import add, multiply
from pricing_core.max_plus.matrices import EPSILON, TOP, Numbers, as_matrix, dense
from pricing_core.max_plus.residuation import residuate_left
from pricing_core.max_plus.system import MaxPlusSystem, as_system


@dataclass(frozen=True, slots=True, eq=False)
class JustInTime:
    """The latest inputs that keep a reference, and what they lead to from x(0) = epsilon.

    Parameters
    ----------
    u : array, shape (K, m)
        Top where an input has no bearing on what is asked.
    x : array, shape (K + 1, n)
    y : array, shape (K + 1, p)
        At most the reference.
    """

    u: Numbers
    x: Numbers
    y: Numbers


def just_in_time(system: MaxPlusSystem, reference: object) -> JustInTime:
    r"""Find the latest u(0), ..., u(K-1) for which y(k) <= reference(k), k = 0 ... K, from x(0) = epsilon.

    Parameters
    ----------
    system : MaxPlusSystem
        Without a direct term D.
    reference : array_like, shape (K + 1, p)
        Latest times of the outputs, K >= 1; +inf where nothing is asked.

    Raises
    ------
    InvalidInputError
        The reference has another shape or holds NaN; or D is not epsilon.

    Notes
    -----
    The adjoint system runs backwards: the latest state is xi(k) = min(A \ xi(k+1), C \ reference(k)), and
    u(k) = B \ xi(k+1). Cost: one residual per step.
    Source: Baccelli, Cohen, Olsder, Quadrat 1992, section 5.6 (backward equations).

    Examples
    --------
    A machine that takes 3 must be fed 3 before each due time, and 3 before its next start:

    >>> just_in_time(MaxPlusSystem([[3.0]], [[3.0]]), [[0.0], [10.0], [12.0]]).u.ravel()
    array([6., 9.])
    """
    if (as_system("system", system).D != EPSILON).any():
        raise InvalidInputError("system", Told("a system with D"), "one without a direct term")
    asked = dense(as_matrix("reference", reference))
    if len(asked) < 2 or asked.shape[1] != system.shape[2]:
        raise InvalidInputError(
            "reference", Told(f"shape {asked.shape}"), f"two rows or more of {system.shape[2]} times each"
        )
    latest = residuate_left(system.C, asked[-1])
    inputs = []
    for k in reversed(range(len(asked) - 1)):
        inputs.append(residuate_left(system.B, latest))
        latest = np.minimum(residuate_left(system.A, latest), residuate_left(system.C, asked[k]))
    u = np.array(inputs[::-1])
    x = _orbit(system, u)
    return JustInTime(u, x, dense(multiply(system.C, x.T)).T)


def _orbit(system: MaxPlusSystem, u: Numbers) -> Numbers:
    """Return the states from epsilon on; an input that nothing asks for counts as never made."""
    states = [np.full(system.shape[0], EPSILON, dtype=u.dtype)]
    for row in np.where(u == TOP, EPSILON, u):
        states.append(np.asarray(add(multiply(system.A, states[-1]), multiply(system.B, row))))
    return np.array(states)
