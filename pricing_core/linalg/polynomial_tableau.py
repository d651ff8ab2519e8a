"""Linear programmes over the rational numbers, or the field of rational functions ordered by the sign for large s."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, TypeAlias

from pricing_core.linalg.polynomials import sign_at_infinity

Element: TypeAlias = Any  # fmpz, or fmpz_poly: their common operations have no common type
Row: TypeAlias = list[Element]


@dataclass(frozen=True, slots=True, eq=False)
class Tableau:
    """The equations d x_basic[i] + sum_j a_ij x_nonbasic[j] = b_i over all x >= 0.

    Pivots are free of fractions (Edmonds 1967): every entry is a minor of the first tableau, d stays
    positive, and every division is exact.

    Parameters
    ----------
    d : fmpz_poly or fmpz
        Positive, for large s.
    rows : list of list of fmpz_poly or fmpz
        (a_i1, ..., a_im, b_i).
    basic, nonbasic : tuple of int
        Numbers of the variables; ties are broken by the least number.
    """

    d: Element
    rows: list[Row]
    basic: tuple[int, ...]
    nonbasic: tuple[int, ...]

    def pivot(self, r: int, c: int) -> Tableau:
        """Exchange basic variable r for nonbasic variable c, a_rc != 0."""
        d, pivot, pivot_row = self.d, self.rows[r][c], self.rows[r]
        rows = []
        for i, row in enumerate(self.rows):
            if i == r:
                new = list(row)
                new[c] = d
            elif factor := row[c]:
                new = [(pivot * a - factor * b) // d for a, b in zip(row, pivot_row, strict=True)]
                new[c] = -factor
            else:
                new = [pivot * a // d for a in row]
                new[c] = factor
            rows.append(new)
        if sign_at_infinity(pivot) < 0:
            pivot, rows = -pivot, [[-a for a in row] for row in rows]
        basic, nonbasic = list(self.basic), list(self.nonbasic)
        basic[r], nonbasic[c] = nonbasic[c], basic[r]
        return Tableau(pivot, rows, tuple(basic), tuple(nonbasic))

    def without_row(self, r: int) -> Tableau:
        """Drop a basic variable and its equation."""
        return Tableau(
            self.d,
            self.rows[:r] + self.rows[r + 1 :],
            self.basic[:r] + self.basic[r + 1 :],
            self.nonbasic,
        )

    def without_column(self, c: int) -> Tableau:
        """Keep a nonbasic variable at zero."""
        rows = [row[:c] + row[c + 1 :] for row in self.rows]
        return Tableau(self.d, rows, self.basic, self.nonbasic[:c] + self.nonbasic[c + 1 :])

    def with_objective(self, coefficients: dict[int, Element]) -> Tableau:
        """Return the tableau with a last row for -1, the sum of coefficients times variables."""
        zero = self.d - self.d
        row = [-self.d * coefficients.get(j, zero) for j in self.nonbasic] + [zero]
        for i, equation in zip(self.basic, self.rows, strict=True):
            if i in coefficients:
                weight = coefficients[i]
                row = [a + weight * b for a, b in zip(row, equation, strict=True)]
        return Tableau(self.d, [*self.rows, row], (*self.basic, -1), self.nonbasic)


def with_zero_basics(tableau: Tableau, zeros: frozenset[int]) -> Tableau | None:
    """Return the tableau in which the given basic variables are zero and gone, or None: the equations forbid it.

    Examples
    --------
    x0 + x1 = 1 with x0 = 0 leaves the one point x1 = 1:

    >>> from flint import fmpz_poly
    >>> one = fmpz_poly([1])
    >>> print(with_zero_basics(Tableau(one, [[one, one]], (0,), (1,)), frozenset({0})))
    Tableau(d=1, rows=[[1]], basic=(1,), nonbasic=())
    """
    for variable in sorted(zeros):
        r = tableau.basic.index(variable)
        c = next((j for j, a in enumerate(tableau.rows[r][:-1]) if a), None)
        if c is not None:
            tableau = tableau.pivot(r, c).without_column(c)
        elif tableau.rows[r][-1]:
            return None
        else:
            tableau = tableau.without_row(r)
    return tableau


def feasible(tableau: Tableau) -> Tableau | None:
    """Return a tableau with b >= 0, or None where no x >= 0 satisfies the equations.

    The dual simplex method with a zero objective and the least-index rule of Bland, finite over any ordered
    field. Where it stops without a solution, a row d x_i + (nonnegative terms) = (negative) proves that
    there is none.

    Examples
    --------
    x0 - s x1 = -1, that is x1 = (1 + x0) / s:

    >>> from flint import fmpz_poly
    >>> one, s = fmpz_poly([1]), fmpz_poly([0, 1])
    >>> feasible(Tableau(one, [[-s, -one]], (0,), (1,))).basic
    (1,)
    >>> feasible(Tableau(one, [[s, -one]], (0,), (1,))) is None
    True
    """
    while True:
        negative = [i for i, row in enumerate(tableau.rows) if sign_at_infinity(row[-1]) < 0]
        if not negative:
            return tableau
        r = min(negative, key=lambda i: tableau.basic[i])
        row = tableau.rows[r]
        entering = [j for j in range(len(row) - 1) if sign_at_infinity(row[j]) < 0]
        if not entering:
            return None
        tableau = tableau.pivot(r, min(entering, key=lambda j: tableau.nonbasic[j]))


def can_increase(tableau: Tableau, coefficients: dict[int, Element]) -> bool:
    """Tell whether some feasible point has a larger sum of coefficients times variables than the present one.

    `tableau` must be feasible. The simplex method with Bland's rule, stopped at the first increase.

    Examples
    --------
    x0 = 1 - x1: x1 can grow from 0, x0 cannot from 1.

    >>> from flint import fmpz_poly
    >>> one = fmpz_poly([1])
    >>> start = Tableau(one, [[one, one]], (0,), (1,))
    >>> can_increase(start, {1: one}), can_increase(start, {0: one})
    (True, False)
    """
    tableau = tableau.with_objective(coefficients)
    while True:
        objective = tableau.rows[-1]
        entering = [j for j in range(len(objective) - 1) if sign_at_infinity(objective[j]) < 0]
        if not entering:
            return False
        c = min(entering, key=lambda j: tableau.nonbasic[j])
        rows = [i for i, row in enumerate(tableau.rows[:-1]) if sign_at_infinity(row[c]) > 0]
        blocking = [i for i in rows if not tableau.rows[i][-1]]
        if not blocking:  # a step of positive length, or without an end
            return True
        tableau = tableau.pivot(min(blocking, key=lambda i: tableau.basic[i]), c)
