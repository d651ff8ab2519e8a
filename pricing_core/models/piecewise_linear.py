"""Piecewise linear systems (section 11.2.5): a linear system whose inputs and outputs lie on polylines."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pricing_core.arrays import Matrix
from pricing_core.errors import InvalidInputError, Told
from pricing_core.lcs import LCS, Finding
from pricing_core.lcs.simulation_method import SimulationMethod, as_method
from pricing_core.models.characteristic import Characteristic
from pricing_core.models.horizontal_system import HorizontalSystem
from pricing_core.models.on_characteristics import OnCharacteristics, PairReading
from pricing_core.models.trajectory import ModelTrajectory, of_lcs
from pricing_core.models.unique_run import simulate_unique
from pricing_core.models.w_condition import is_monotone, w_condition


@dataclass(frozen=True, slots=True, eq=False)
class PiecewiseLinearSystem:
    """x' = Ax + Bu, y = Cx + Du, (y_i, u_i) on the graph of characteristic i (11.34).

    Parameters
    ----------
    A, B, C : array_like, shapes (n, n), (n, k), (k, n)
    D : array_like, shape (k, k), or None
        Zero where None.
    characteristics : sequence of Characteristic, length k

    Raises
    ------
    InvalidInputError
        Shapes that do not fit, a number of characteristics other than k.

    Examples
    --------
    x' = -sat(x) from 3: 3 - t until t = 2, then e^{-(t - 2)}.

    >>> from pricing_core.models import saturation
    >>> system = PiecewiseLinearSystem([[0]], [[-1]], [[1]], None, [saturation()])
    >>> run = system.simulate([3], (0, 4), t_eval=[1, 3])
    >>> run.x[:, 0].round(12), run.switches
    (array([2.        , 0.36787944]), (Switch(time=2.0, before=(2,), after=(1,)),))
    """

    A: Matrix
    B: Matrix
    C: Matrix
    D: Matrix
    characteristics: tuple[Characteristic, ...]
    given: tuple[NDArray[Any], ...]  # A, B, C, D as given, for exact arithmetic

    def __init__(
        self,
        A: ArrayLike,
        B: ArrayLike,
        C: ArrayLike,
        D: ArrayLike | None,
        characteristics: Sequence[Characteristic],
    ) -> None:
        plant = LCS(A, B, C, D)  # checks the shapes
        for name in ("A", "B", "C", "D", "given"):
            object.__setattr__(self, name, getattr(plant, name))
        if not isinstance(characteristics, Sequence):
            raise InvalidInputError("characteristics", characteristics, "a list of them")
        curves = tuple(characteristics)
        for i, curve in enumerate(curves):
            if not isinstance(curve, Characteristic):
                raise InvalidInputError(f"characteristics[{i}]", curve, "a Characteristic")
        if len(curves) != plant.shape[1]:
            raise InvalidInputError(
                "characteristics",
                Told(f"{len(curves)} of them"),
                f"one for each of the {plant.shape[1]} inputs",
            )
        object.__setattr__(self, "characteristics", curves)

    @property
    def shape(self) -> tuple[int, int]:
        """(n, k): the number of states and of characteristics."""
        return self.B.shape[0], self.B.shape[1]

    def to_horizontal(self) -> HorizontalSystem:
        """Return the extended horizontal complementarity system, as a horizontal one.

        Along characteristic i with m points, piece by piece, (y_i, u_i) = point 0 - x^0 t_0 + x^1 t_1 + ... + x^m t_m
        with tangents t, x^0 _|_ x^1 and d_j - x^j _|_ x^(j+1), d_j the lengths. Its m pairs are
        w = (x^0, d_1 - x^1, ...) and z = (x^1, ..., x^m); y = Cx + Du makes the first equation of each m.

        Notes
        -----
        Source: Kaneko and Pang 1980; Camlibel and Schumacher 1999.
        """
        n, k = self.shape
        curves = self.on_characteristics()
        first_pairs = curves.first_pairs
        p = first_pairs[-1]
        at_w, at_z, start = curves.maps()
        M, N, g = np.eye(p), np.zeros((p, p)), np.zeros(p)
        C = np.zeros((p, n))
        for i, ((first, end), curve) in enumerate(
            zip(itertools.pairwise(first_pairs), self.characteristics, strict=True)
        ):
            row = np.eye(k)[i]
            M[first] = row @ (at_w[:k] - self.D @ at_w[k:])
            N[first] = row @ (self.D @ at_z[k:] - at_z[:k])
            C[first], g[first] = self.C[i], self.D[i] @ start[k:] - start[i]
            lower = np.arange(first + 1, end)
            N[lower, lower - 1] = -1.0
            g[lower] = curve.lengths
        return HorizontalSystem(self.A, self.B @ at_w[k:], self.B @ at_z[k:], C, M, N, self.B @ start[k:], g)

    def to_lcs(self) -> LCS:
        """Return the complementarity system with the same states, one pair for each point.

        Examples
        --------
        An ideal diode makes the conditions of complementarity themselves:

        >>> from pricing_core.models import ideal_diode
        >>> system = PiecewiseLinearSystem([[-1]], [[2]], [[1]], None, [ideal_diode()]).to_lcs()
        >>> system.B, system.C, system.D
        (array([[2.]]), array([[1.]]), array([[0.]]))
        """
        return self.to_horizontal().to_lcs()

    def simulate(
        self,
        x0: ArrayLike,
        t_span: tuple[float, float],
        *,
        method: SimulationMethod = "event-driven",
        t_eval: ArrayLike | None = None,
    ) -> ModelTrajectory:
        """Simulate from x0 over t_span, exactly on every piece, with corners located to rounding.

        Parameters
        ----------
        x0 : array_like, shape (n,)
        t_span : (float, float)
        method, t_eval
            See `pricing_core.lcs.simulate`.

        Returns
        -------
        ModelTrajectory
            The pieces are those of `Characteristic`, 0 being the left ray; of those that meet at a corner where it
            stays, the vertical one, else the left one.

        Raises
        ------
        NonUniqueError, InfeasibleError, ZenoError, InvalidInputError
            As `pricing_core.lcs.simulate`.
        """
        horizontal = self.to_horizontal()
        run, unique = simulate_unique(
            horizontal.to_lcs(), x0, t_span, as_method(method), t_eval, self.has_unique_state
        )
        return of_lcs(run, PairReading(self.on_characteristics(), horizontal.pairs), unique)

    def on_characteristics(self) -> OnCharacteristics:
        """Return what puts inputs and outputs on the characteristics."""
        return OnCharacteristics(self.B, self.C, self.D, self.characteristics)

    def w_property(self) -> Finding:
        """Tell whether diag(dy) - G(s) diag(du) has, for all large s, determinants of one sign on all pieces; exact.

        (dy_i, du_i) runs through the directions of characteristic i. Then the implicit steps of every small size,
        and the rational problem from every state, have one solution. For relays it is theorem 11.6.

        Returns
        -------
        Finding
            "holds" or "silent": the condition is sufficient only.

        Notes
        -----
        Cost: one polynomial for every combination of different directions, at most 20 000, k <= 12: half a second.
        Source: Sznajder and Gowda 1995; Camlibel and Schumacher 1999.

        Examples
        --------
        >>> from pricing_core.models import saturation
        >>> PiecewiseLinearSystem([[0]], [[-1]], [[1]], [[3]], [saturation()]).w_property().status
        'silent'
        >>> PiecewiseLinearSystem([[0]], [[-1]], [[1]], [[0]], [saturation()]).w_property().status
        'holds'
        """
        return w_condition(LCS(*self.given), self.characteristics)

    def has_unique_state(self) -> Literal[True] | None:
        """Return True where the state is proved to have at most one continuation from every x0, else None.

        By `w_property`, or because every characteristic rises or falls and the plant is passive after a shift of its
        poles: then the state is unique although u need not be.

        Examples
        --------
        >>> from pricing_core.models import relay_step
        >>> PiecewiseLinearSystem([[0]], [[1, 1]], [[1], [1]], None, [relay_step(), relay_step()]).has_unique_state()
        True
        """
        plant = LCS(*self.given)
        proved = is_monotone(plant, self.characteristics) or self.w_property().status == "holds"
        return True if proved else None
