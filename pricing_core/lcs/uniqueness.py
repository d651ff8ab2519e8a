"""Whether the state of a system is proved to have at most one continuation from every x0."""

from typing import Literal

import numpy as np

from pricing_core.lcs.parts import Part, independent_parts, is_independent, strongly_connected_parts
from pricing_core.lcs.pole_shifted_passivity import is_passive_after_pole_shift
from pricing_core.lcs.rational_system import rational_system
from pricing_core.lcs.system import LCS
from pricing_core.lcs.total_invertibility import transfer_minors
from pricing_core.linalg.principal_minors import all_positive
from pricing_core.linalg.rational import exact_kernel

LARGEST_PART = 8  # pairs up to which the principal minors of a part are computed, in 0.1 s


def has_unique_state(system: LCS) -> Literal[True] | None:
    """Return True where the state is proved to have at most one continuation from every x0, else None.

    Exact, for the data as given, and for all offsets f and g. A system has it where each of its independent parts is
    passive after a shift of the poles, or is made of strongly connected parts that have it: those whose G(s) is a
    P-matrix for all large s, and those passive after a shift whose multipliers are unique, or act on no other part.

    Notes
    -----
    Cost: milliseconds for passive systems of any size; else 2**k principal minors for each strongly connected part,
    up to k = 8, beyond which nothing is said. Source: theorem 11.5; Camlibel, Heemels and Schumacher 2002.

    Examples
    --------
    >>> has_unique_state(LCS([[0]], [[1]], [[1]])), has_unique_state(LCS([[0]], [[-1]], [[1]]))
    (True, None)
    """
    return True if all(_is_unique(part.system) for part in independent_parts(system) if part.pairs) else None


def _is_unique(system: LCS) -> bool:
    if is_passive_after_pole_shift(rational_system(system)):
        return True
    parts = [part for part in strongly_connected_parts(system) if part.pairs]
    return all(_keeps_uniqueness(system, part) for part in parts)


def _keeps_uniqueness(system: LCS, part: Part) -> bool:
    """Tell whether the part has one state for any inputs, and whatever of it acts on other parts is unique."""
    data = rational_system(part.system)
    if is_passive_after_pole_shift(data) and (
        is_independent(system, part) or not exact_kernel(np.vstack([data.B, data.D + data.D.T])).shape[1]
    ):
        return True
    return len(part.pairs) <= LARGEST_PART and all_positive(transfer_minors(part.system))
