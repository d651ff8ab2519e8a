"""Linear systems with relays in the loop (sections 11.2.4 and 11.7), with sliding modes."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from types import MappingProxyType
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pricing_core.arrays import Matrix, Vector, as_array, as_vector, check_choice
from pricing_core.errors import InvalidInputError
from pricing_core.lcs import LCS, WellPosedness, theorem_11_6, well_posedness
from pricing_core.lcs.pole_shifted_passivity import CRITERION, is_passive_after_pole_shift
from pricing_core.lcs.rational_system import rational_system
from pricing_core.lcs.simulation_method import SimulationMethod, as_method
from pricing_core.models.horizontal_system import HorizontalSystem
from pricing_core.models.named_characteristics import relay_step
from pricing_core.models.on_characteristics import PairReading
from pricing_core.models.piecewise_linear import PiecewiseLinearSystem
from pricing_core.models.trajectory import ModelTrajectory, of_lcs
from pricing_core.models.unique_run import simulate_unique

Form: TypeAlias = Literal["input-output", "dae"]
FORMS = ("input-output", "dae")


@dataclass(frozen=True, slots=True, eq=False)
class RelaySystem:
    """x' = Ax + Bu, y = Cx + Du, u_i = -sgn y_i (11.89), or between other bounds.

    u_i = lower_i where y_i > 0, u_i = upper_i where y_i < 0, and lower_i <= u_i <= upper_i where y_i = 0: there the
    system may slide.

    Parameters
    ----------
    A, B, C : array_like, shapes (n, n), (n, k), (k, n)
    D : array_like, shape (k, k), optional
        Zero where missing.
    lower, upper : float or array_like of shape (k,)
        lower < upper; -1 and 1 where missing.

    Raises
    ------
    InvalidInputError
        Shapes that do not fit, entries that are not finite, a lower bound that is not below its upper one.

    Examples
    --------
    Example 11.1, Filippov's spiral: from (3, 1) the origin is reached at t = 2.

    >>> spiral = RelaySystem(np.zeros((2, 2)), [[1, -2], [2, 1]], np.eye(2))
    >>> spiral.well_posedness().theorems["11.6"]
    'holds'
    >>> trajectory = spiral.simulate([3, 1], (0, 2.5), t_eval=[1, 2.5])
    >>> print(trajectory.x.round(9).tolist(), trajectory.events[-1].kind)
    [[1.333333333, -0.666666667], [0.0, 0.0]] zeno
    """

    A: Matrix
    B: Matrix
    C: Matrix
    D: Matrix
    lower: Vector  # (k,)
    upper: Vector  # (k,)
    given: tuple[NDArray[Any], ...]  # A, B, C, D as given, for exact arithmetic

    def __init__(
        self,
        A: ArrayLike,
        B: ArrayLike,
        C: ArrayLike,
        D: ArrayLike | None = None,
        lower: ArrayLike = -1.0,
        upper: ArrayLike = 1.0,
    ) -> None:
        plant = LCS(A, B, C, D)  # checks the shapes
        k = plant.shape[1]
        for name in ("A", "B", "C", "D", "given"):
            object.__setattr__(self, name, getattr(plant, name))
        for name, bound in (("lower", lower), ("upper", upper)):
            given = as_array(name, bound)
            object.__setattr__(
                self, name, as_vector(name, np.full(k, bound) if given.ndim == 0 else given, k)
            )
        for i in np.flatnonzero(self.lower >= self.upper).tolist():
            raise InvalidInputError(
                f"lower[{i}]", float(self.lower[i]), f"less than upper[{i}] = {self.upper[i]:g}"
            )

    @property
    def shape(self) -> tuple[int, int]:
        """(n, k): the number of states and of relays."""
        return self.B.shape[0], self.B.shape[1]

    def to_dae(self) -> HorizontalSystem:
        """Return (11.30) with y = y1 - y2, u = lower + (upper - lower) u1 and u1 + u2 = 1: w = (y1, y2), z = (u1, u2).

        With the bounds -1 and 1 these are (11.28), for the relay with the sign of (11.89).
        """
        n, k = self.shape
        one, zero, span = np.eye(k), np.zeros((k, k)), self.upper - self.lower
        return HorizontalSystem(
            self.A,
            np.zeros((n, 2 * k)),
            np.hstack([self.B * span, np.zeros((n, k))]),
            np.vstack([self.C, np.zeros((k, n))]),
            np.block([[one, -one], [zero, zero]]),
            np.block([[self.D * span, zero], [-one, -one]]),
            self.B @ self.lower,
            np.concatenate([self.D @ self.lower, np.ones(k)]),
        )

    def to_lcs(self, form: Form = "input-output") -> LCS:
        """Return the complementarity system with the same states.

        Parameters
        ----------
        form : {"input-output", "dae"}
            "input-output" is (11.33): u1 = (u - lower)/(upper - lower), y2 = 1 - u1, y = y1 - u2, inputs
            (u1, u2), outputs (y1, y2). "dae" is (11.30), whose equations are solved for u1 and the y2 of (11.28):
            outputs (u1, y2), inputs (y1, u2).

        Examples
        --------
        >>> RelaySystem([[0]], [[1]], [[1]]).to_lcs().D
        array([[ 0.,  1.],
               [-1.,  0.]])
        >>> RelaySystem([[0]], [[1]], [[1]]).to_lcs("dae").D
        array([[ 0., -1.],
               [ 1.,  0.]])
        """
        _check_form(form)
        if form == "dae":
            return self.to_dae().to_lcs()
        n, k = self.shape
        one, zero, span = np.eye(k), np.zeros((k, k)), self.upper - self.lower
        return LCS(
            self.A,
            np.hstack([self.B * span, np.zeros((n, k))]),
            np.vstack([self.C, np.zeros((k, n))]),
            np.block([[self.D * span, one], [-one, zero]]),
            self.B @ self.lower,
            np.concatenate([self.D @ self.lower, np.ones(k)]),
        )

    def to_piecewise_linear(self) -> PiecewiseLinearSystem:
        """Return the piecewise linear system whose characteristics are the relays, with the same pieces."""
        steps = [relay_step(*bounds) for bounds in zip(self.lower.tolist(), self.upper.tolist(), strict=True)]
        A, B, C, D = self.given
        return PiecewiseLinearSystem(A, B, C, D, steps)

    def simulate(
        self,
        x0: ArrayLike,
        t_span: tuple[float, float],
        *,
        form: Form = "input-output",
        method: SimulationMethod = "event-driven",
        t_eval: ArrayLike | None = None,
    ) -> ModelTrajectory:
        """Simulate from x0 over t_span; switches, and the start and end of sliding, are located to rounding.

        Parameters
        ----------
        x0 : array_like, shape (n,)
        t_span : (float, float)
        form : {"input-output", "dae"}
            Which of the two complementarity systems is simulated; the states are the same.
        method, t_eval
            See `pricing_core.lcs.simulate`.

        Returns
        -------
        ModelTrajectory
            Pieces: 0 where y_i < 0 and u_i = upper_i, 1 where the relay slides, 2 where y_i > 0 and u_i = lower_i.

        Raises
        ------
        NonUniqueError
            A state has several continuations, as 0 has for x' = sgn x. With more than 5 relays of which uniqueness is
            not proved, this is asked of x0 alone, and of parts of at most 6 relays that act on each other.
        ZenoError, InfeasibleError, InvalidInputError
            As `pricing_core.lcs.simulate`.

        Examples
        --------
        >>> run = RelaySystem([[0]], [[1]], [[1]]).simulate([2], (0, 3), t_eval=[1, 3])
        >>> run.u.tolist(), run.switches
        ([[-1.0], [0.0]], (Switch(time=2.0, before=(2,), after=(1,)),))
        """
        _check_form(form)
        dae = self.to_dae() if form == "dae" else None
        system = self.to_lcs(form)
        run, unique = simulate_unique(system, x0, t_span, as_method(method), t_eval, self.has_unique_state)
        curves = self.to_piecewise_linear().on_characteristics()
        return of_lcs(run, PairReading(curves, partial(self._pairs, dae)), unique)

    def has_unique_state(self) -> Literal[True] | None:
        """Return True where the state is proved to have at most one continuation from every x0, else None.

        By theorem 11.6, or because A, B, C, D are passive after a shift of the poles: the relays' outputs then need not
        be unique.
        """
        return self.to_piecewise_linear().has_unique_state()

    def well_posedness(self) -> WellPosedness:
        """Report what is known of existence and uniqueness from all x0: by theorem 11.6 on G, else on (11.33).

        Where A, B, C, D are passive after a shift of the poles, the state is unique although u need not be.

        The verdict is local: theorem 11.6 does not exclude that switches accumulate (example 11.1).

        Notes
        -----
        Cost: see `pricing_core.lcs.well_posedness`, with twice as many pairs; k <= 6 for a complete report.

        Examples
        --------
        >>> report = RelaySystem([[0]], [[-1]], [[1]]).well_posedness()  # x' = sgn x
        >>> report.verdict, report.witness, report.theorems["11.6"]
        ('ill-posed', array([0.]), 'silent')
        """
        finding = theorem_11_6(*self.given)
        report = well_posedness(self.to_lcs())
        report = replace(
            report,
            theorems=MappingProxyType({**report.theorems, "11.6": finding.status}),
            reasons=MappingProxyType({**report.reasons, "11.6": finding.reason}),
        )
        if report.verdict == "well-posed":
            return report
        if finding.status == "holds":
            return replace(report, verdict="well-posed", basis=f"theorem 11.6: {finding.reason}")
        if is_passive_after_pole_shift(
            rational_system(LCS(*self.given))
        ):  # and solvable, as the relays are bounded
            basis = f"passivity of the relays' plant after a shift of the poles: {CRITERION}"
            return replace(report, verdict="well-posed", basis=f"{basis}; the state is unique, u need not be")
        return report

    def _pairs(self, dae: HorizontalSystem | None, u: Matrix, y: Matrix) -> tuple[Matrix, Matrix]:
        """Return the pairs along the relays' steps from the inputs and outputs of a complementarity system."""
        k, span = self.shape[1], self.upper - self.lower
        if dae is None:
            share, below, above, rest = u[:, :k], u[:, k:], y[:, :k], y[:, k:]
        else:
            w, z = dae.pairs(u, y)
            share, below, above, rest = z[:, :k], w[:, k:], w[:, :k], z[:, k:]
        pairs = np.empty((2, len(u), 2 * k))
        pairs[0, :, ::2], pairs[1, :, ::2] = below, span * rest
        pairs[0, :, 1::2], pairs[1, :, 1::2] = span * share, above
        return pairs[0], pairs[1]


def _check_form(form: str) -> None:
    check_choice("form", form, FORMS)
