"""Whether the state of a system is proved to have at most one continuation from every x0."""

from __future__ import annotations

from functools import lru_cache
from typing import Literal

import numpy as np

from pricing_core.lcs.markov import exact_markov_parameters
from pricing_core.lcs.parts import Part, independent_parts, is_independent, strongly_connected_parts
from pricing_core.lcs.pole_shifted_passivity import is_passive_after_pole_shift
from pricing_core.lcs.rational_system import RationalSystem, rational_system
from pricing_core.lcs.system import LCS
from pricing_core.lcs.total_invertibility import transfer_minors
from pricing_core.linalg.principal_minors import all_positive
from pricing_core.linalg.rational import exact_kernel
from pricing_core.linalg.rational_definite import is_exactly_positive_definite

LARGEST_PART = 8  # pairs up to which the principal minors of a part are computed, in 0.1 s
REMEMBERED = 16  # systems


@lru_cache(maxsize=REMEMBERED)
def has_unique_state(system: LCS) -> Literal[True] | None:
    """Return True where the state is proved to have at most one continuation from every x0, else None.

    Exact, for the data as given, and for all offsets f and g. A system has it where each of its independent parts is
    passive after a shift of the poles, or is made of strongly connected parts that have it: those whose G(s) is a
    P-matrix for all large s, and those passive after a shift whose multipliers are unique, or act on no other part.
    G(s) is a P-matrix for large s where its leading Markov parameter H has H + H^T > 0, as in mechanical systems with
    independent constraints.

    Notes
    -----
    Cost: milliseconds for passive systems, and for definite H; else 2**k principal minors for each strongly connected
    part, up to k = 8, beyond which nothing is said. Answers are remembered. Source: theorem 11.5; Camlibel, Heemels and
    Schumacher 2002.

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
    if _has_definite_leading_parameter(data):
        return True
    return len(part.pairs) <= LARGEST_PART and all_positive(transfer_minors(part.system))


def _has_definite_leading_parameter(data: RationalSystem) -> bool:
    """Tell whether H + H^T > 0 for the first Markov parameter H that is not zero."""
    for H in exact_markov_parameters(data, data.shape[0] + 1):
        if H.any():
            return is_exactly_positive_definite(H + H.T)
    return False
