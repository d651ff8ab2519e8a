"""The column W-property: when an extended horizontal LCP has one solution whatever q and the bounds."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from pricing_core.arrays import IndexSet, as_matrix, as_square_matrix, check_list
from pricing_core.errors import InvalidInputError
from pricing_core.linalg.determinant import determinant_sign

MOST_REPRESENTATIVES = 200_000


def has_column_w_property(blocks: Sequence[ArrayLike]) -> bool:
    """Tell whether all matrices that take each column from any of the blocks have determinants of one sign.

    Then, and only then, the extended horizontal LCP of these blocks has exactly one solution for every q and
    all positive bounds.

    Notes
    -----
    Cost and failure: see `column_w_violation`.

    Examples
    --------
    The blocks I and M of w = M z + q have it where M is a P-matrix:

    >>> has_column_w_property([np.eye(2), [[1, -2], [2, 1]]]), has_column_w_property([np.eye(2), [[1, 2], [2, 1]]])
    (True, False)
    """
    return column_w_violation(blocks) is None


def column_w_violation(blocks: Sequence[ArrayLike]) -> IndexSet | None:
    """Return for each column the number of the block it comes from, where the determinant has no or another sign.

    Parameters
    ----------
    blocks : sequence of array_like, shape (n, n)
        At most 200 000 combinations; signs that rounding could change are decided in exact arithmetic, on the
        numbers as they are given.

    Returns
    -------
    tuple of int, length n, or None
        None where the blocks have the column W-property. The sign is that of the first block.

    Raises
    ------
    InvalidInputError
        Shapes that do not fit, too many combinations.

    Notes
    -----
    Source: Sznajder and Gowda 1995, theorem 2: generalizations of P0- and P-properties; extended vertical and
    horizontal linear complementarity problems.

    Examples
    --------
    >>> column_w_violation([np.eye(2), [[1, 2], [2, 1]]])
    (1, 1)
    """
    check_list("blocks", blocks)
    if len(blocks) == 0:
        raise InvalidInputError("blocks", "no matrix", "one matrix or more")
    first = as_square_matrix("blocks[0]", blocks[0])
    matrices = [first, *(as_matrix(f"blocks[{j}]", b, first.shape) for j, b in enumerate(blocks[1:], 1))]
    n = len(first)
    if len(matrices) ** n > MOST_REPRESENTATIVES:
        raise InvalidInputError(
            "blocks", f"{len(matrices)}**{n} combinations", f"of at most {MOST_REPRESENTATIVES} combinations"
        )
    wanted = determinant_sign(first)
    for choice in itertools.product(range(len(matrices)), repeat=n):
        representative = np.column_stack([matrices[b][:, i] for i, b in enumerate(choice)])
        if wanted == 0 or determinant_sign(representative) != wanted:
            return choice
    return None
