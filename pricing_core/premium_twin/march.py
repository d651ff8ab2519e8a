"""The march of many early exercise premiums at once, in NumPy: the reference of the compiled kernel.

One put per row, in units that leave no operator to parametrise. With T the time to expiry of the row, S and K
spot and strike, t = tau/T runs from 0 (expiry) to 1 (now), and

    xi = (ln(S/K) + (r - q - sigma**2/2) tau) / (sigma sqrt(T)),     u(xi, t) = e^{r tau} (V - V_European)/K

satisfies the heat equation u_t = u_xixi/2 wherever the option is held. The complementarity system (11.63) reads

    0 <= u - G,   0 <= u_t - u_xixi/2,   one of them zero,

with G the payoff less the European put, a closed formula, and u(., 0) = 0. Three numbers are left of the contract:
r T (`rate`), q T (`dividend`) and sigma sqrt(T) (`spread`).

Space: the nodes are *labels* i = 0, 1, ... that travel with the exercise boundary, xi = X(t) + i dx: node 0 is the
contact node next to the first free one, so the contact set of every complementarity problem is known up to the
place of the boundary inside its cell, X + phi dx. There u - G = H phi**2 dx**2 + ...: the problem of a stage is
solved for u and phi together. Second derivatives are compact, of fourth order.
Time: sqrt(t) = n/M; from each n to n + 1 one step of the three-stage, third-order, L-stable diagonally implicit
Runge-Kutta method (Alexander 1977), the labels moving at a constant speed, so that one matrix serves the three
stages. It is tridiagonal with constant coefficients and factors in closed form (Wiener-Hopf): one elimination
from the far end, one substitution from the boundary. The first step is implicit Euler's, in closed form. Where the
labels go is predicted from the boundary's last three places; what the boundary does beyond it, its velocity
included, is part of every stage's problem, so that the prediction hardly matters.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pricing_core.arrays import Vector
from pricing_core.premium_twin.cell import Cell, Obstacle, obstacle_at
from pricing_core.premium_twin.mesh import Mesh

STAGE = 0.4358665215084590  # root of x**3 - 3 x**2 + 3 x/2 - 1/6 = 0
STAGE_TIMES = (STAGE, 0.5 * (1.0 + STAGE), 1.0)
GROWTH = (0.0, 0.5 * (1.0 + STAGE) / STAGE, 2.0 / (1.0 + STAGE))  # of phi, if in proportion to time
# Weights of the increments Y - rhs of the stages before, already divided by STAGE.
SECOND = 0.5 * (1.0 - STAGE) / STAGE
THIRD = (
    -0.25 * (6.0 * STAGE * STAGE - 16.0 * STAGE + 1.0) / STAGE,
    0.25 * (6.0 * STAGE * STAGE - 20.0 * STAGE + 5.0) / STAGE,
)
FIRST_ITERATIONS, FIRST_TOLERANCE = 16, 1e-3
FIRST_SHIFT = 0.45  # of the guess, in sqrt(t); fitted
ACCEPTED_OFFSET = 0.5  # of sqrt(t), between boundary and label 0
TRIES = 8


@dataclass(frozen=True, slots=True, eq=False)
class Marched:
    """What a march leaves.

    Parameters
    ----------
    state : array, shape (1 or 4, nodes + 2, rows)
        u, and du/drate, du/ddividend, du/dspread, now, at the labels; the last label is zero.
    frame : Vector, shape (rows,)
        xi of label 0.
    spacing : float
        The distance of the labels.
    boundary : Vector, shape (rows,)
        ln(S*/K).
    settled : bool array, shape (rows,)
        False where the boundary escaped the frame: nothing in that row may be used.
    """

    state: NDArray[np.float64]
    frame: Vector
    spacing: float
    boundary: Vector
    settled: NDArray[np.bool_]


def march(mesh: Mesh, tangents: bool, rate: Vector, dividend: Vector, spread: Vector) -> Marched:
    """March the premium of every row from expiry to now.

    Parameters
    ----------
    mesh : Mesh
        For all rows.
    tangents : bool
        Whether to march the derivatives by rate, dividend and spread at fixed xi, the labels held.
    rate, dividend, spread : Vector, shape (rows,)
        r T > 0, q T, sigma sqrt(T) > 0 of a put.
    """
    with np.errstate(all="ignore"):  # what is not finite is not settled
        marching = _March(mesh, tangents, rate, dividend, spread)
        marching.run()
    return Marched(
        marching.state, marching.frame, mesh.spacing(mesh.steps), marching.held * spread, marching.settled
    )


class _March:
    """The rows of one mesh; arrays end with the axis of rows."""

    def __init__(self, mesh: Mesh, tangents: bool, rate: Vector, dividend: Vector, spread: Vector) -> None:
        self.mesh, self.steps = mesh, mesh.steps
        self.rate, self.dividend, self.spread = rate, dividend, spread
        self.drift = (rate - dividend - 0.5 * spread * spread) / spread
        # x/spread of the boundary just before expiry, and of the perpetual option, which bounds it.
        early = np.log(np.where(dividend > 0.0, rate / dividend, 1.0))
        self.start = np.minimum(early, 0.0) / spread
        decay = self.drift + np.sqrt(self.drift * self.drift + 2.0 * rate)
        self.perpetual = -np.log1p(spread / decay) / spread
        self.state = np.zeros((4 if tangents else 1, mesh.nodes + 2, rate.size))
        self.settled = np.ones(rate.size, dtype=bool)
        self.frame = np.zeros(rate.size)
        self.reduced: list[Vector] = []  # (x_f/spread - start)/sqrt(t) of the last three steps, newest first
        self.held = self.start  # x_f/spread of the last step

    def run(self) -> None:
        """March to now."""
        self._first_step()
        for step in range(2, self.steps + 1):
            if self.mesh.spacing(step) > self.mesh.spacing(step - 1):
                self._coarsen()
            self._step(step)

    def _coarsen(self) -> None:
        kept = self.state[:, ::2].copy()
        self.state[:] = 0.0
        self.state[:, : kept.shape[1]] = kept

    def _first_step(self) -> None:
        """Take implicit Euler's step from u = 0: u = G(X) e^{-lam (xi - X)} with G' + lam G = 0 at X."""
        root, dx = 1.0 / self.steps, self.mesh.spacing(1)
        t = root * root
        lam = np.sqrt(2.0) / root
        self.frame = self._first_boundary(t, root, lam)
        obstacle = self._obstacle(self.frame, t, root)
        tangents = obstacle.tangents() if self.state.shape[0] > 1 else ()
        falling = np.ones(self.rate.size)
        decay = np.exp(-lam * dx)
        for i in range(self.mesh.active(1) + 1):
            self.state[0, i] = obstacle.value * falling
            for j, tangent in enumerate(tangents, start=1):
                self.state[j, i] = tangent * falling
            falling = falling * decay
        self._remember(1, self.frame - self.drift * t, root)

    def _first_boundary(self, t: float, root: float, lam: float) -> Vector:
        rate, dividend = self.rate * t, self.dividend * t
        high = np.full(rate.size, 0.5 * root)
        # Where chance has no part: e^y (lam + spread) expm1(dividend) = lam expm1(rate).
        ratio = lam * np.expm1(rate) / ((lam + self.spread) * np.expm1(dividend))
        certain = (np.log(np.where(dividend > 0.0, ratio, 1.0)) - 0.5 * self.spread**2 * t) / self.spread
        high = np.where(dividend > 0.0, np.minimum(certain, high), high)
        low = high - 9.0 * root
        # The option alive at d = xi/sqrt(t) is worth waiting with as N(d) falls to what waiting costs.
        cost = np.maximum(rate - dividend, 0.0) / (self.spread * root) + np.maximum(dividend, 0.0)
        guess = -root * (np.sqrt(2.0 * np.log1p(0.5 / np.maximum(cost, 1e-300))) - FIRST_SHIFT)
        xi = np.maximum(np.minimum(guess, high), low)
        done = np.zeros(rate.size, dtype=bool)
        for _ in range(FIRST_ITERATIONS):
            obstacle = self._obstacle(xi, t, root)
            residual = obstacle.slope + lam * obstacle.value
            derivative = obstacle.curvature + lam * obstacle.slope
            low = np.where(residual > 0.0, np.maximum(low, xi), low)
            high = np.where(residual > 0.0, high, np.minimum(high, xi))
            newton = xi - residual / derivative
            inside = (derivative < 0.0) & (newton >= low) & (newton <= high)
            following = np.where(inside, newton, 0.5 * (low + high))
            following = np.where(done, xi, following)
            done |= np.abs(following - xi) <= FIRST_TOLERANCE * root
            xi = following
            if done.all():
                break
        return np.asarray(xi)

    def _step(self, step: int) -> None:
        """Take one Runge-Kutta step, again with a corrected frame where the boundary left it too far behind."""
        before, root = (step - 1) / self.steps, step / self.steps
        start, t = before * before, root * root
        dx = self.mesh.spacing(step)
        if step == 2:
            # One step says nothing of where the boundary goes: one implicit Euler step to here does.
            x = self._first_boundary(t, root, float(np.sqrt(2.0)) / root) - self.drift * t
        else:
            weights = _prediction_weights(self.steps, step, len(self.reduced))
            reduced = sum(w * e for w, e in zip(weights, self.reduced, strict=True))
            x = self.start + root * reduced
        x = np.maximum(np.minimum(x, self.held), self.perpetual)
        frame = x + self.drift * t
        accepted = np.zeros(self.rate.size, dtype=bool)
        for _ in range(TRIES):
            state, offset = self._stages(step, start, t, dx, frame)
            found = frame + offset * dx
            x = np.where(accepted, x, found - self.drift * t)
            accepted |= np.abs(offset) * dx <= ACCEPTED_OFFSET * root
            if accepted.all():
                break
            x = np.where(accepted, x, np.maximum(np.minimum(x, self.held), self.perpetual))
            frame = np.where(accepted, frame, x + self.drift * t)
        self.settled &= accepted
        self.state, self.frame = state, frame
        self._remember(step, x, root)

    def _remember(self, step: int, x: Vector, root: float) -> None:
        self.held = x
        self.reduced = [(x - self.start) / root, *self.reduced[:2]]

    def _stages(
        self, step: int, start: float, t: float, dx: float, frame: Vector
    ) -> tuple[NDArray[np.float64], Vector]:
        """Return the state after the step and phi, the boundary's distance from label 0 in cells."""
        active, h = self.mesh.active(step), t - start
        speed = (frame - self.frame) / h
        matrix = _WienerHopf(speed, STAGE * h, dx)
        weights = _slope_weights(self.steps, step, min(len(self.reduced), 2))
        reduced = ((frame - self.drift * t - self.start) * self.steps / step, *self.reduced)
        slope = sum(w * e for w, e in zip(weights, reduced, strict=False))
        state = self.state
        increments: list[NDArray[np.float64]] = []
        stage, offset = state, np.zeros(self.rate.size)
        for number, c in enumerate(STAGE_TIMES):
            time = start + c * h
            root = np.sqrt(time)
            place = self.frame + c * (frame - self.frame)
            rhs = state.copy()
            if number == 1:
                rhs = state + SECOND * increments[0]
            elif number == 2:
                rhs = state + (THIRD[0] * increments[0] + THIRD[1] * increments[1])
            rhs[:, active + 2 :] = 0.0
            eliminated = matrix.eliminate(rhs, active)
            velocity = ((place - self.drift * time - self.start) / root + slope) / (2.0 * root) + self.drift
            turn = 0.5 * dx * (1.0 + weights[0]) / (root * root)
            cell = Cell(
                self.rate, self.dividend, self.spread, place, time, root, dx, velocity, turn, matrix.pi
            )
            values, offset = cell.solve(eliminated[:, 1], GROWTH[number] * offset, number == 0)
            stage = matrix.substitute(eliminated, values, active)
            increment = stage - rhs
            increment[:, active + 1 :] = 0.0
            increments.append(increment)
        return stage, offset

    def _obstacle(self, xi: Vector, t: float, root: float) -> Obstacle:
        return obstacle_at(self.rate, self.dividend, self.spread, xi, t, root)


class _WienerHopf:
    """The factors kappa (1 - rho E)(1 - pi E^-1) of m u - h (u_xixi/2 + speed u_xi), E the shift to the right.

    m = (1/12, 10/12, 1/12) with a drift term: the compact scheme takes the mean m of u_t over three labels,
    and that makes the difference quotients fourth-order.
    """

    def __init__(self, speed: Vector, h: float, dx: float) -> None:
        diffusion = 0.5 + speed * speed * (dx * dx / 6.0)
        self.mass_lower = 1.0 / 12.0 - speed * (dx / 12.0)
        self.mass_upper = 1.0 / 12.0 + speed * (dx / 12.0)
        lower = h / (dx * dx) * diffusion - h / (2.0 * dx) * speed - self.mass_lower
        upper = h / (dx * dx) * diffusion + h / (2.0 * dx) * speed - self.mass_upper
        diagonal = 10.0 / 12.0 + 2.0 * h / (dx * dx) * diffusion
        self.kappa = 0.5 * (diagonal + np.sqrt(diagonal * diagonal - 4.0 * lower * upper))
        self.pi, self.rho = lower / self.kappa, upper / self.kappa

    def eliminate(self, rhs: NDArray[np.float64], active: int) -> NDArray[np.float64]:
        """Return y with kappa (1 - rho E) y = m rhs at the labels 1 to `active`; y vanishes beyond."""
        lower, middle, upper = (
            self.mass_lower / self.kappa,
            10.0 / 12.0 / self.kappa,
            self.mass_upper / self.kappa,
        )
        y = np.zeros_like(rhs)
        for i in range(active, 0, -1):
            y[:, i] = (lower * rhs[:, i - 1] + (middle * rhs[:, i] + upper * rhs[:, i + 1])) + self.rho * y[
                :, i + 1
            ]
        return y

    def substitute(
        self, y: NDArray[np.float64], first: NDArray[np.float64], active: int
    ) -> NDArray[np.float64]:
        """Return u with u_0 = `first` and u_i = y_i + pi u_{i-1}."""
        u = np.zeros_like(y)
        u[:, 0] = first
        for i in range(1, active + 1):
            u[:, i] = y[:, i] + self.pi * u[:, i - 1]
        return u


def _prediction_weights(steps: int, step: int, known: int) -> list[float]:
    """Return the weights of the last `known` values, newest first, that extrapolate in ln sqrt(t)."""
    at = np.log(np.arange(step, step - known - 1, -1) / steps)
    return [
        float(np.prod([(at[0] - at[k]) / (at[j] - at[k]) for k in range(1, known + 1) if k != j]))
        for j in range(1, known + 1)
    ]


def _slope_weights(steps: int, step: int, known: int) -> list[float]:
    """Return the weights, newest first, of the derivative by ln sqrt(t) at the newest of known + 1 values."""
    at = np.log(np.arange(step, step - known - 1, -1) / steps)
    if known == 1:
        return [float(1.0 / (at[0] - at[1])), float(-1.0 / (at[0] - at[1]))]
    a, b, c = at[0] - at[1], at[0] - at[2], at[1] - at[2]
    return [float((a + b) / (a * b)), float(-b / (a * c)), float(a / (b * c))]
