"""Optimal control with constraints, nonlinear in the state and affine in the control, section 11.2.3."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from pricing_core.arrays import Matrix, Vector, as_number, as_vector, as_whole_number, check_callable
from pricing_core.errors import InvalidInputError
from pricing_core.models.control.certificate import certificate
from pricing_core.models.control.nonlinear_programme import Functions, NonlinearProgramme
from pricing_core.models.control.sequential_programming import minimise

FEWEST_INTERVALS, MOST_INTERVALS = 4, 5_000
OPTIONAL_FUNCTIONS = {"final_reward": "x", "mixed_constraint": "(t, x, u)", "state_constraint": "(t, x)"}


@dataclass(frozen=True, slots=True, eq=False)
class CollocatedControl:
    """A stationary point of the collocated problem, in the signs of (11.12)-(11.16).

    What is certified: the first-order conditions, which the maximum principle implies, to `stationarity`; and where
    `is_local_maximum`, that no control close by earns more. That no other control at all does is never certified, but
    follows where F, F_T and g are concave and the equations of motion linear.

    Parameters
    ----------
    t : Vector, shape (N + 1,)
    x : Matrix, shape (N + 1, n)
    control : Matrix, shape (N, m)
        Constant in each interval.
    costate : Matrix, shape (N, n)
        lambda at the midpoints.
    mixed_multiplier : Matrix, shape (N, k1)
        eta of the mixed constraint at the midpoints.
    state_masses : Matrix, shape (N, k2)
        eta of the state constraint as masses at the nodes t_1, ..., t_N: a density times h on boundary arcs, and its
        atoms (junctions, touch points, T) as large masses on one or two nodes.
    reward : float
        (11.9).
    iterations : int
    stationarity : float
        The largest of: the gradient of the Lagrangian, the violation of the constraints, multipliers times slacks;
        relative to 1 + the largest multiplier.
    is_local_maximum : bool
        The second-order condition holds: the Lagrangian is strictly concave in every direction that keeps (11.10) and
        the constraints with a multiplier. Where it is False the point may be a minimum, a saddle, or a maximum that is
        not strict, as where F is linear in u and no constraint holds it.
    """

    t: Vector
    x: Matrix
    control: Matrix
    costate: Matrix
    mixed_multiplier: Matrix
    state_masses: Matrix
    reward: float
    iterations: int
    stationarity: float
    is_local_maximum: bool


@dataclass(frozen=True, slots=True, eq=False)
class ControlAffineProblem:
    """Maximise int_0^T F(t, x, u) dt + F_T(x(T)) with x' = a(t, x) + b(t, x) u, x(0) = x0, g >= 0 (11.9)-(11.11).

    The maximum principle (11.14) asks for lambda' = -dL/dx with L = F + lambda^T f + eta^T g (11.12)-(11.13), u
    maximal in L, 0 <= g _|_ eta >= 0, lambda(T) = dF_T/dx (11.16). With u solved from it as u*(t, x, lambda, eta)
    (11.17) this is the complementarity system (11.20) with conditions at both ends. A constraint on the state alone
    makes eta a measure with atoms, and lambda(T-) = dF_T/dx + (dg/dx)^T eta({T}).

    Parameters
    ----------
    reward : callable (t, x, u) -> float
        F, concave in u.
    drift : callable (t, x) -> array of shape (n,)
        a.
    input_map : callable (t, x) -> array of shape (n, m)
        b.
    x0 : array_like, shape (n,)
    horizon : float
        T > 0.
    final_reward : callable (x) -> float, optional
        F_T; zero where missing.
    mixed_constraint : callable (t, x, u) -> array of shape (k1,), optional
        The part of g that contains u.
    state_constraint : callable (t, x) -> array of shape (k2,), optional
        The part of g without u; not negative at x0.

    Raises
    ------
    InvalidInputError
        Naming the argument: shapes, values that are not finite at the start, x0 outside the state constraint.

    Examples
    --------
    Maximise -(1/2) int_0^1 (x^2 + u^2) dt, x' = u from 1; without constraints the value is -tanh(1)/2 = -0.380797:

    >>> problem = ControlAffineProblem(
    ...     lambda t, x, u: -0.5 * (x @ x + u @ u), lambda t, x: [0.0], lambda t, x: [[1.0]], [1.0], 1.0)
    >>> round(problem.solve(intervals=50).reward, 4)
    -0.3808
    """

    reward: Callable[[float, Vector, Vector], float]
    drift: Callable[[float, Vector], ArrayLike]
    input_map: Callable[[float, Vector], ArrayLike]
    x0: Vector
    horizon: float
    final_reward: Callable[[Vector], float] | None = None
    mixed_constraint: Callable[[float, Vector, Vector], ArrayLike] | None = None
    state_constraint: Callable[[float, Vector], ArrayLike] | None = None

    def __post_init__(self) -> None:
        check_callable("reward", self.reward, "(t, x, u)")
        check_callable("drift", self.drift, "(t, x)")
        check_callable("input_map", self.input_map, "(t, x)")
        for name, arguments in OPTIONAL_FUNCTIONS.items():
            if getattr(self, name) is not None:
                check_callable(name, getattr(self, name), arguments)
        x0 = as_vector("x0", self.x0)
        object.__setattr__(self, "x0", x0)
        length = float(as_vector("horizon", [self.horizon])[0])
        if length <= 0.0:
            raise InvalidInputError("horizon", self.horizon, "a positive number")
        as_vector("drift", np.asarray(self.drift(0.0, x0), dtype=float), x0.size)
        u = np.zeros(self.controls)
        as_vector("reward", [self.reward(0.0, x0, u)])
        if self.final_reward is not None:
            as_vector("final_reward", [self.final_reward(x0)])
        if self.mixed_constraint is not None:
            as_vector("mixed_constraint", np.asarray(self.mixed_constraint(0.0, x0, u), dtype=float))
        if self.state_constraint is not None:
            slack = as_vector("state_constraint", np.asarray(self.state_constraint(0.0, x0), dtype=float))
            if np.any(slack < 0.0):
                allowed = f"a state inside the state constraint, whose least value there is {slack.min():.6g}"
                raise InvalidInputError("x0", x0.tolist(), allowed)

    @property
    def controls(self) -> int:
        """The number m of controls."""
        b = np.asarray(self.input_map(0.0, self.x0), dtype=float)
        if b.ndim != 2 or b.shape[0] != self.x0.size or b.shape[1] == 0 or not np.all(np.isfinite(b)):
            allowed = f"a finite matrix of {self.x0.size} rows and at least one column"
            raise InvalidInputError("input_map", f"shape {b.shape}", allowed)
        return int(b.shape[1])

    def solve(
        self,
        *,
        intervals: int = 100,
        tolerance: float = 1e-7,
        start: ArrayLike | None = None,
        max_iterations: int = 100,
    ) -> CollocatedControl:
        """Find a stationary point of the problem collocated at the midpoints of equal intervals.

        Steps go uphill, so that it is a maximum as a rule; the result says whether that is certain. Which one of
        several is found depends on `start`.

        Parameters
        ----------
        intervals : int
            N, from 4 to 5000.
        tolerance : float
            The last quadratic step, relative to 1 + the largest unknown.
        start : array_like, shape (m,), optional
            The control of the first guess, constant in time; zero where missing. The first state is x0 throughout.
        max_iterations : int

        Raises
        ------
        InvalidInputError
            A setting out of range.
        IterationLimitError
            The tolerance was not reached.
        NumericalError
            A linearised problem has no solution, or no step makes progress.

        Notes
        -----
        Second order in the interval without constraints. Derivatives are central differences: the functions must be
        smooth. Structure and junction times are not sought: for the linear-quadratic case see `StateConstrainedLQ`.
        Cost: about 4 (n + m)^2 calls of each function per interval and step.
        """
        N = as_whole_number("intervals", intervals, FEWEST_INTERVALS, MOST_INTERVALS)
        if not 1e-10 <= as_number("tolerance", tolerance) < 1.0:
            raise InvalidInputError("tolerance", tolerance, "a number from 1e-10 to 1")
        most = as_whole_number("max_iterations", max_iterations, 1)
        m, n = self.controls, self.x0.size
        first = as_vector("start", np.zeros(m) if start is None else start, m)
        programme = NonlinearProgramme(self._functions, self.x0, float(self.horizon), N, m)
        guess = np.concatenate([np.tile(self.x0, N), np.tile(first, N)])
        found = minimise(programme, guess, float(tolerance), most)
        proof = certificate(programme, found)
        x, control = programme.split(found.v)
        mixed = found.duals.size - N * self._functions.pure(0.0, self.x0).size
        return CollocatedControl(
            t=programme.nodes,
            x=x,
            control=control,
            costate=found.costate.reshape(N, n),
            mixed_multiplier=found.duals[:mixed].reshape(N, -1) / programme.h,
            state_masses=found.duals[mixed:].reshape(N, -1),
            reward=-found.values.loss,
            iterations=found.iterations,
            stationarity=proof.stationarity,
            is_local_maximum=proof.is_local_maximum,
        )

    @property
    def _functions(self) -> Functions:
        drift, input_map = self.drift, self.input_map
        mixed, pure, final = self.mixed_constraint, self.state_constraint, self.final_reward

        def dynamics(t: float, x: Vector, u: Vector) -> Vector:
            return np.asarray(np.asarray(drift(t, x), float) + np.asarray(input_map(t, x), float) @ u)

        return Functions(
            reward=lambda t, x, u: float(self.reward(t, x, u)),
            dynamics=dynamics,
            mixed=lambda t, x, u: np.zeros(0) if mixed is None else np.asarray(mixed(t, x, u), float),
            pure=lambda t, x: np.zeros(0) if pure is None else np.asarray(pure(t, x), float),
            final=lambda x: 0.0 if final is None else float(final(x)),
        )
