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
Time: sqrt(t) = n/M; from each n to n + 1 one step of a third-order, L-stable, diagonally implicit Runge-Kutta method
with an explicit first stage (Kennedy and Carpenter 2016, section 5.1). That stage is du/dt as the last step left it,
corrected for the labels' new speed, and makes all stages accurate to second order: without it the boundary's motion
lowers the order and errors are ten times larger. The labels move at a constant speed, so that one matrix serves the
three implicit stages. It is tridiagonal with constant coefficients and factors in closed form (Wiener-Hopf): one
elimination from the far end, one substitution from the boundary. The first step is implicit Euler's, in closed form;
the second has no du/dt to start from and takes the method of Alexander (1977). Where the labels go is predicted from
the boundary's last three places; what the boundary does beyond it, its velocity included, is part of every stage's
problem, so that the prediction hardly matters.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pricing_core.arrays import Matrix, Vector
from pricing_core.premium_twin.cell import Cell, Obstacle, obstacle_at
from pricing_core.premium_twin.mesh import Mesh

STAGE = 0.4358665215084590  # root of x**3 - 3 x**2 + 3 x/2 - 1/6 = 0
# Of the third stage; near the least error and far from the unstable neighbourhood of 2 STAGE.
THIRD_TIME = 1.15
FIRST_ITERATIONS, FIRST_TOLERANCE = 16, 0.03  # of sqrt(t), for the last iteration, which cubes it
FIRST_SHIFT = 0.45  # of the guess, in sqrt(t); fitted
ACCEPTED_OFFSET = 0.5  # of sqrt(t), between boundary and label 0
TRIES = 8


@dataclass(frozen=True, slots=True)
class Tableau:
    """A Runge-Kutta method with three implicit stages, all with STAGE on the diagonal, the last at the step's end.

    Parameters
    ----------
    times : (3,) floats
        Of the stages, in steps.
    explicit : (3,) floats
        In each stage, the weight of the derivative at the step's start.
    implicit : (3,) tuples
        In each stage, the weights of the stages before, divided by STAGE.
    """

    times: tuple[float, float, float]
    explicit: tuple[float, float, float]
    implicit: tuple[tuple[()], tuple[float], tuple[float, float]]


def _alexander() -> Tableau:
    second = 0.5 * (1.0 - STAGE) / STAGE
    third = (
        -0.25 * (6.0 * STAGE * STAGE - 16.0 * STAGE + 1.0) / STAGE,
        0.25 * (6.0 * STAGE * STAGE - 20.0 * STAGE + 5.0) / STAGE,
    )
    return Tableau((STAGE, 0.5 * (1.0 + STAGE), 1.0), (0.0, 0.0, 0.0), ((), (second,), third))


def _explicit_first_stage() -> Tableau:
    """Return the method whose stages are of order two: sum_j a_ij c_j = c_i**2/2, and of order three at the end."""
    c2, c3 = 2.0 * STAGE, THIRD_TIME
    a32 = (0.5 * c3 * c3 - STAGE * c3) / c2
    b3 = ((1.0 / 3.0 - STAGE) - c2 * (0.5 - STAGE)) / (c3 * (c3 - c2))
    b2 = ((0.5 - STAGE) - b3 * c3) / c2
    return Tableau(
        (c2, c3, 1.0),
        (STAGE, c3 - STAGE - a32, 1.0 - b2 - b3 - STAGE),
        ((), (a32 / STAGE,), (b2 / STAGE, b3 / STAGE)),
    )


SECOND_STEP, LATER_STEPS = _alexander(), _explicit_first_stage()


@dataclass(frozen=True, slots=True, eq=False)
class Marched:
    """What a march leaves.

    Parameters
    ----------
    state : array, shape (1 or 4, nodes + 3, rows)
        u, and its derivatives by rate, dividend and spread along the labels, now; the last two labels are zero.
    frame : Vector, shape (rows,)
        xi of label 0.
    frame_by : Matrix, shape (3, rows)
        Its derivatives by the parameters: at fixed xi those of u are less by u_xi times these.
    spacing : float
        The distance of the labels.
    boundary : Vector, shape (rows,)
        ln(S*/K).
    settled : bool array, shape (rows,)
        False where the boundary escaped the frame: nothing in that row may be used.
    """

    state: NDArray[np.float64]
    frame: Vector
    frame_by: Matrix
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
        Whether to march the derivatives by rate, dividend and spread.
    rate, dividend, spread : Vector, shape (rows,)
        r T > 0, q T, sigma sqrt(T) > 0 of a put.
    """
    with np.errstate(all="ignore"):  # what is not finite is not settled
        marching = _March(mesh, tangents, rate, dividend, spread)
        marching.run()
    return Marched(
        marching.state,
        marching.frame,
        marching.frame_by,
        mesh.spacing(mesh.steps),
        marching.held * spread,
        marching.settled,
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
        # By rate, dividend and spread, as all that ends in _by.
        self.drift_by = np.stack([1.0 / spread, -1.0 / spread, -(self.drift / spread + 1.0)])
        self.start_by = np.where(
            early < 0.0,
            np.stack([1.0 / (rate * spread), -1.0 / (dividend * spread), -self.start / spread]),
            0.0,
        )
        self.tangents = tangents
        self.state = np.zeros((4 if tangents else 1, mesh.nodes + 3, rate.size))
        # In the last stage; divided by `change_time` du/dt at the labels.
        self.change, self.change_time = np.zeros_like(self.state), 1.0
        self.speed, self.speed_by = np.zeros(rate.size), np.zeros((3, rate.size))
        self.settled = np.ones(rate.size, dtype=bool)
        self.frame, self.frame_by = np.zeros(rate.size), np.zeros((3, rate.size))
        self.reduced: list[Vector] = []  # (x_f/spread - start)/sqrt(t) of the last three steps, newest first
        self.reduced_by: list[Matrix] = []
        self.held, self.held_by = self.start, self.start_by  # x_f/spread of the last step

    def run(self) -> None:
        """March to now."""
        self._first_step()
        for step in range(2, self.steps + 1):
            if self.mesh.spacing(step) > self.mesh.spacing(step - 1):
                self._coarsen()
            self._step(step)

    def _coarsen(self) -> None:
        for array in (self.state, self.change):
            kept = array[:, ::2].copy()
            array[:] = 0.0
            array[:, : kept.shape[1]] = kept

    def _first_step(self) -> None:
        """Take implicit Euler's step from u = 0: u = G(X) e^{-lam (xi - X)} with G' + lam G = 0 at X."""
        root, dx = 1.0 / self.steps, self.mesh.spacing(1)
        t = root * root
        lam = np.sqrt(2.0) / root
        self.frame = self._first_boundary(t, root, lam)
        obstacle = self._obstacle(self.frame, t, root)
        pull = obstacle.curvature + lam * obstacle.slope
        tangents = np.stack(obstacle.tangents())
        self.frame_by = -(np.stack(obstacle.slope_tangents(self.spread)) + lam * tangents) / pull
        values = [obstacle.value, *(tangents + obstacle.slope * self.frame_by)]
        falling = np.ones(self.rate.size)
        decay = np.exp(-lam * dx)
        for i in range(self.mesh.active(1) + 1):
            for own, value in zip(self.state, values, strict=False):
                own[i] = value * falling
            falling = falling * decay
        self._remember(self.frame - self.drift * t, self.frame_by, root)

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
            second = obstacle.third + lam * obstacle.curvature
            pull = derivative * derivative - 0.5 * (residual * second)
            halley = xi - residual * derivative / pull
            inside = (derivative < 0.0) & (pull > 0.0) & (halley >= low) & (halley <= high)
            following = np.where(inside, halley, 0.5 * (low + high))
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
        # Any motion of the labels with the parameters serves; this is the boundary's, a step before.
        frame_by = self.held_by + self.drift_by * t
        accepted = np.zeros(self.rate.size, dtype=bool)
        for _ in range(TRIES):
            state, change, offset, moved = self._stages(step, start, t, dx, frame, frame_by)
            found = frame + offset * dx
            x = np.where(accepted, x, found - self.drift * t)
            accepted |= np.abs(offset) * dx <= ACCEPTED_OFFSET * root
            if accepted.all():
                break
            x = np.where(accepted, x, np.maximum(np.minimum(x, self.held), self.perpetual))
            frame = np.where(accepted, frame, x + self.drift * t)
        self.settled &= accepted
        self.state, self.change, self.change_time = state, change, STAGE * (t - start)
        self.speed, self.frame = (frame - self.frame) / (t - start), frame
        self.speed_by, self.frame_by = (frame_by - self.frame_by) / (t - start), frame_by
        self._remember(x, frame_by + dx * moved, root)

    def _remember(self, x: Vector, found_by: Matrix, root: float) -> None:
        """Keep the boundary's place and its derivatives by the parameters, from those of xi_f."""
        self.held = x
        self.reduced = [(x - self.start) / root, *self.reduced[:2]]
        self.held_by = found_by - self.drift_by * (root * root)
        self.reduced_by = [(self.held_by - self.start_by) / root, *self.reduced_by[:1]]

    def _stages(
        self, step: int, start: float, t: float, dx: float, frame: Vector, frame_by: Matrix
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], Vector, Matrix]:
        """Return the state after the step, what its last stage added, phi and the derivatives of phi.

        phi is the boundary's distance from label 0 in cells.
        """
        active, h = self.mesh.active(step), t - start
        method = SECOND_STEP if step == 2 else LATER_STEPS
        speed = (frame - self.frame) / h
        speed_by = (frame_by - self.frame_by) / h
        matrix = _WienerHopf(speed, STAGE * h, dx)
        state = self.state
        differences = _label_differences(state)
        push = h / self.change_time * self.change + (h / dx * (speed - self.speed)) * differences  # h du/dt
        if self.tangents:
            push[1:] += (h / dx * (speed_by - self.speed_by))[:, None] * differences[0]
        push[:, active + 1 :] = 0.0

        weights = _slope_weights(self.steps, step, min(len(self.reduced), 2))
        end = np.sqrt(t)
        reduced = ((frame - self.drift * t - self.start) / end, *self.reduced)
        slope = sum(w * e for w, e in zip(weights, reduced, strict=False))
        reduced_by = ((frame_by - self.drift_by * t - self.start_by) / end, *self.reduced_by)
        slope_by = np.asarray(sum(w * e for w, e in zip(weights, reduced_by, strict=False)))

        increments: list[NDArray[np.float64]] = []
        stage, offset, before = state, np.zeros(self.rate.size), 1.0
        moved = np.zeros((3, 1))
        for number, c in enumerate(method.times):
            time = start + c * h
            root = np.sqrt(time)
            rhs = state + method.explicit[number] * push
            for weight, increment in zip(method.implicit[number], increments, strict=True):
                rhs = rhs + weight * increment
            rhs[:, active + 2 :] = 0.0
            place = self.frame + c * (frame - self.frame)
            velocity = ((place - self.drift * time - self.start) / root + slope) / (2.0 * root) + self.drift
            turn = 0.5 * dx * (1.0 + weights[0]) / (root * root)
            cell = Cell(
                self.rate, self.dividend, self.spread, place, time, root, dx, velocity, turn, matrix.pi
            )  # fmt: skip
            eliminated = matrix.eliminate(rhs[:1], active)
            contact, offset = cell.solve(eliminated[0, 1], (c / before) * offset, number == 0)
            before = c
            stage = matrix.substitute(eliminated, contact[None], active)
            if self.tangents:
                place_by = self.frame_by + c * (frame_by - self.frame_by)
                reduced_by_now = (place_by - self.drift_by * time - self.start_by) / root
                velocity_by = (reduced_by_now + slope_by) / (2.0 * root) + self.drift_by
                eliminated = matrix.eliminate(rhs[1:], active)
                eliminated += speed_by[:, None] * matrix.eliminate_speed(rhs[0], stage[0], active)
                contacts, moved = cell.tangents(eliminated[:, 1], offset, place_by, velocity_by)
                stage = np.concatenate([stage, matrix.substitute(eliminated, contacts, active)])
            increment = stage - rhs
            increment[:, active + 1 :] = 0.0
            increments.append(increment)
        return stage, increments[-1], offset, moved

    def _obstacle(self, xi: Vector, t: float, root: float) -> Obstacle:
        return obstacle_at(self.rate, self.dividend, self.spread, xi, t, root)


class _WienerHopf:
    """The factors kappa (1 - rho E)(1 - pi E^-1) of m u - h (u_xixi/2 + speed u_xi), E the shift to the right.

    m = (1/12, 10/12, 1/12) with a drift term: the compact scheme takes the mean m of u_t over three labels,
    and that makes the difference quotients fourth-order.
    """

    def __init__(self, speed: Vector, h: float, dx: float) -> None:
        self.speed, self.h, self.dx = speed, h, dx
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

    def eliminate_speed(self, rhs: Matrix, u: Matrix, active: int) -> Matrix:
        """Return what the derivative of the factors by the speed adds to y, times -1, for the solution u."""
        y = np.zeros_like(rhs)
        lean, bend, drift = self.dx / 12.0, self.h * self.speed / 3.0, 0.5 * self.h / self.dx
        for i in range(active, 0, -1):
            source = (
                lean * ((rhs[i + 1] - u[i + 1]) - (rhs[i - 1] - u[i - 1]))
                + bend * (u[i - 1] - 2.0 * u[i] + u[i + 1])
                + drift * (u[i + 1] - u[i - 1])
            )
            y[i] = source / self.kappa + self.rho * y[i + 1]
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


def _label_differences(u: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return dx u_xi at the labels to fourth order; labels 0 and 1 look to the right."""
    found = np.zeros_like(u)
    found[:, 0] = (-25.0 * u[:, 0] + 48.0 * u[:, 1] - 36.0 * u[:, 2] + 16.0 * u[:, 3] - 3.0 * u[:, 4]) / 12.0
    found[:, 1] = (-3.0 * u[:, 0] - 10.0 * u[:, 1] + 18.0 * u[:, 2] - 6.0 * u[:, 3] + u[:, 4]) / 12.0
    found[:, 2:-2] = (8.0 * (u[:, 3:-1] - u[:, 1:-3]) - (u[:, 4:] - u[:, :-4])) / 12.0
    return found


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
