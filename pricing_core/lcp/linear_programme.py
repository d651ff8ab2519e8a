"""The linear programme that the proofs and the enumeration rest on, solved by HiGHS through SciPy."""

from __future__ import annotations

import numpy as np
from scipy.optimize import linprog

from pricing_core.arrays import Matrix, Vector
from pricing_core.errors import NumericalError

FEASIBILITY = 1e-10  # the tightest that HiGHS takes, for scaled constraints and for reduced costs


def minimise(
    cost: Vector,
    rows: Matrix,
    sizes: Vector,
    highest: Vector,
    *,
    equations: Matrix | None = None,
    values: Vector | None = None,
) -> Vector | None:
    """Minimise cost x subject to rows x <= sizes, equations x = values, 0 <= x <= highest.

    Parameters
    ----------
    cost, highest : Vector, shape (m,)
        `highest` may hold inf.
    rows, sizes : (k, m), (k,)
    equations, values : (l, m), (l,), optional

    Returns
    -------
    Vector or None
        The minimiser, feasible to within 1e-10; None where no x is feasible.

    Raises
    ------
    NumericalError
        The programme is unbounded, or HiGHS failed.

    Examples
    --------
    >>> minimise(np.array([-1.0]), np.array([[2.0]]), np.array([3.0]), np.array([np.inf]))
    array([1.5])
    """
    result = linprog(
        cost,
        A_ub=rows,
        b_ub=sizes,
        A_eq=equations,
        b_eq=values,
        bounds=[(0.0, float(limit)) for limit in highest],
        method="highs",
        options={"primal_feasibility_tolerance": FEASIBILITY, "dual_feasibility_tolerance": FEASIBILITY},
    )
    if result.status not in (0, 2):
        raise NumericalError(f"a linear programme failed ({result.message}): rescale the problem")
    return np.asarray(result.x, dtype=np.float64) if result.status == 0 else None
