"""Random complementarity systems by class, each with what shows whether its simulation is right."""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.integrate import solve_ivp

from pricing_core.arrays import Matrix, Vector
from pricing_core.lcs import LCS, Trajectory, simulate, sine
from pricing_core.models import DiodeCircuit, MechanicalSystem

G = 9.81
Interrupt = Callable[[], bool]


class Case(NamedTuple):
    """A simulation, and what is wrong with its result: an empty text where nothing is wrong."""

    run: Callable[[Interrupt], Trajectory]
    fault: Callable[[Trajectory], str]


def column(rng: np.random.Generator, beads: int | None = None) -> Case:
    """Let beads above each other fall on the floor: at the end they lie on it, touching."""
    n = int(rng.integers(2, 13)) if beads is None else beads
    e = _restitution(rng, largest=0.8)
    mass = np.diag(rng.uniform(0.2, 3.0, n))
    F = np.eye(n) - np.eye(n, k=-1)
    offset = -np.concatenate([[0.1], np.full(n - 1, 0.2)])
    rest = np.linalg.solve(F, -offset)
    q0 = rest + np.cumsum(rng.uniform(0.05, 0.8, n))
    nothing = np.zeros((n, n))
    system = MechanicalSystem(mass, nothing, nothing, F, -G * np.diag(mass), offset, e)
    return _mechanical(system, q0, np.zeros(n), 15.0, rest)


def chair(rng: np.random.Generator) -> Case:
    """Drop a plate on four legs, one more than it needs: at the end it stands on them."""
    angles = np.arange(4) * math.pi / 2 + (math.pi / 4 if rng.random() < 0.5 else rng.uniform(-0.3, 0.3, 4))
    legs = np.column_stack([np.ones(4), np.cos(angles), np.sin(angles)])
    mass, nothing = np.diag([1.0, *rng.uniform(0.15, 0.8, 2)]), np.zeros((3, 3))
    system = MechanicalSystem(
        mass, nothing, nothing, legs, [-G, 0.0, 0.0], None, _restitution(rng, largest=0.7)
    )
    return _mechanical(system, np.array([1.0, *rng.uniform(-0.2, 0.2, 2)]), np.zeros(3), 6.0, np.zeros(3))


def chain(rng: np.random.Generator) -> Case:
    """Join masses by springs, with stops on random combinations of them."""
    n = int(rng.integers(2, 7))
    k = rng.uniform(0.5, 3.0, n + 1)
    stiffness = np.diag(k[:-1] + k[1:]) - np.diag(k[1:-1], 1) - np.diag(k[1:-1], -1)
    damping = rng.uniform(0.0, 0.5) * stiffness
    F = rng.normal(size=(int(rng.integers(1, n + 1)), n))
    system = MechanicalSystem(
        np.diag(rng.uniform(0.3, 2.0, n)),
        damping,
        stiffness,
        F,
        2.0 * rng.normal(size=n),
        rng.uniform(0.0, 1.0, F.shape[0]),
        _restitution(rng),
    )
    return _mechanical(system, np.zeros(n), rng.normal(size=n), 5.0, None)


def cradle(rng: np.random.Generator) -> Case:
    """Hang pendula side by side, some of them pulled aside."""
    n = int(rng.integers(2, 7))
    q0 = np.zeros(n)
    q0[: int(rng.integers(1, n))] -= rng.uniform(0.2, 1.0)
    F = np.eye(n - 1, n, k=1) - np.eye(n - 1, n)
    system = MechanicalSystem(np.eye(n), np.zeros((n, n)), np.eye(n), F, restitution=_restitution(rng))
    return _mechanical(system, q0, np.zeros(n), 8.0, None)


def rocking_block(rng: np.random.Generator) -> Case:
    """Drop a block on two feet, which rocks until it stands."""
    r = rng.uniform(0.01, 0.6)
    system = MechanicalSystem(
        np.diag([1.0, (1.0 + r) / (1.0 - r)]),
        np.zeros((2, 2)),
        np.zeros((2, 2)),
        [[1.0, 1.0], [1.0, -1.0]],
        [-G, 0.0],
        None,
        _restitution(rng, largest=0.7),
    )
    return _mechanical(system, np.array([1.0, rng.uniform(-0.3, 0.3)]), np.zeros(2), 8.0, np.zeros(2))


def pushed_carts(rng: np.random.Generator) -> Case:
    """Push one of two carts between springs against a stop at a distance."""
    F = rng.normal(size=(1, 2)) if rng.random() < 0.5 else np.array([[1.0, 0.0]])
    system = MechanicalSystem(
        np.diag(rng.uniform(0.3, 3.0, 2)),
        np.zeros((2, 2)),
        rng.uniform(0.3, 3.0) * np.array([[2.0, -1.0], [-1.0, 2.0]]),
        F,
        [-5.0 * rng.random(), 0.0],
        [rng.uniform(0.3, 2.0)],
        _restitution(rng),
    )
    return _mechanical(system, np.zeros(2), np.zeros(2), 10.0, None)


def feedthrough(rng: np.random.Generator) -> Case:
    """Take x' = u, y = x + d u - sin 2 pi t with d from 1e-14 to 1e14: x' = max(0, sin 2 pi t - x)/d."""
    d = 10.0 ** rng.uniform(-14.0, 14.0)
    system = LCS([[0.0]], [[1.0]], [[1.0]], [[d]], g=sine(-1.0, 1.0))

    def fault(run: Trajectory) -> str:
        times = np.array([0.1, 0.2, 0.7, 1.6, 3.0])
        if d < 1e-3:  # x is the largest sine so far, but for what d holds back
            exact, within = np.where(times < 0.25, np.sin(2.0 * math.pi * times), 1.0), 7.0 * d + 1e-9
        else:
            exact, within = (
                _by_radau(
                    lambda t, x: float(max(0.0, math.sin(2.0 * math.pi * t) - x) / d), times, longest=d
                ),
                1e-6,
            )
        return _unless(float(np.abs(run(times)[:, 0] - exact).max()) <= within, "x differs")

    return _system(system, np.zeros(1), 3.0, fault)


def rectifier(rng: np.random.Generator) -> Case:
    """Charge a capacitor behind a diode and a resistance from 1e-12 to 1e12 ohm, at 50 Hz."""
    resistance, V = 10.0 ** rng.uniform(-12.0, 12.0), rng.uniform(1.0, 300.0)
    capacitance, load = 10.0 ** rng.uniform(-6.0, -3.0), 10.0 ** rng.uniform(1.0, 5.0)
    system = LCS(
        [[-1.0 / (load * capacitance)]], [[1.0 / capacitance]], [[1.0]], [[resistance]], g=sine(-V, 50.0)
    )

    def rate(t: float, v: float) -> float:
        held = max(0.0, V * math.sin(100.0 * math.pi * t) - v) / resistance
        return float((held - v / load) / capacitance)

    def fault(run: Trajectory) -> str:
        times = np.array([0.002, 0.004, 0.012, 0.031, 0.055])
        v = run(times)[:, 0]
        if resistance < 1e-4 * min(
            load, 1e-2 / capacitance
        ):  # the source holds the capacitor up to its crest
            wanted = V * np.sin(100.0 * math.pi * times[:2])
            within = 1e-9 + 2.0 * resistance * (100.0 * math.pi * capacitance + 1.0 / load)
            return _unless(float(np.abs(v[:2] / wanted - 1.0).max()) <= within, "v differs from the source")
        exact = _by_radau(rate, times, V)
        return _unless(float(np.abs(v - exact).max()) <= 1e-5 * V, "v differs")

    return _system(system, np.zeros(1), 0.06, fault)


def scaled_feedthrough(rng: np.random.Generator) -> Case:
    """Take a positive definite feedthrough whose entries differ by up to 28 orders of magnitude."""
    n, k = int(rng.integers(1, 6)), int(rng.integers(1, 6))
    J, C, K = rng.normal(size=(n, n)), rng.normal(size=(k, n)), rng.normal(size=(k, k))
    d = 10.0 ** rng.uniform(-14.0, 14.0, k)
    D = np.diag(d) + (np.sqrt(d)[:, None] * (K - K.T) * np.sqrt(d) if rng.random() < 0.5 else 0.0)
    g = sine(rng.normal(size=k), float(rng.uniform(0.1, 1.0)), phase=float(rng.uniform(0.0, 6.0)))
    system = LCS(J - J.T - rng.uniform(0.0, 0.5) * np.eye(n), C.T, C, D, g=g)
    return _system(system, rng.normal(size=n), 3.0, lambda run: _everywhere(system, run))


def skew_feedthrough(rng: np.random.Generator, pairs: int | None = None) -> Case:
    """Take a skew D and B = C^T, 15 to 30 pairs unless it is said how many."""
    k = int(rng.integers(15, 31)) if pairs is None else pairs
    n = k + int(rng.integers(0, 8))
    S, C, K = rng.normal(size=(n, n)), rng.normal(size=(k, n)) / math.sqrt(n), rng.normal(size=(k, k))
    system = LCS((S - S.T) / math.sqrt(n) - 0.1 * np.eye(n), C.T, C, 0.2 * (K - K.T))
    return _passive(system, rng.normal(size=n), 1.0)


def stiff_and_lossless(rng: np.random.Generator) -> Case:
    """Take rates from 1 to 1e6, with and without damping; feedthrough missing, small or large."""
    n, k = int(rng.integers(1, 8)), int(rng.integers(1, 6))
    S = np.diag(10.0 ** rng.uniform(0.0, 3.0, n))
    L, C, R = rng.normal(size=(n, n)), rng.normal(size=(k, n)), rng.normal(size=(n, n))
    damping = S @ R @ R.T @ S if rng.random() < 0.5 else np.zeros((n, n))
    D = np.zeros((k, k)) if rng.random() < 0.5 else 10.0 ** rng.uniform(-8.0, 3.0) * np.eye(k)
    return _passive(LCS(L - L.T - damping, C.T, C, D), rng.normal(size=n), 3.0)


def tiny_offsets(rng: np.random.Generator) -> Case:
    """Add offsets of 1e-15 to 1e-20 in some components: the motion is that without them."""
    n = int(rng.integers(1, 5))
    k = int(rng.integers(1, n + 1))
    J, C = rng.normal(size=(n, n)), rng.normal(size=(k, n))
    A, D, x0 = (
        J - J.T - rng.uniform(0.1, 1.0) * np.eye(n),
        rng.choice([0.0, 1.0]) * np.eye(k),
        rng.normal(size=n),
    )
    f, g = rng.normal(size=n), rng.normal(size=k)
    f[0] = g[0] = 0.0
    plain = simulate(LCS(A, C.T, C, D, f=f, g=g), x0, (0.0, 3.0))
    f[0], g[0] = 10.0 ** rng.uniform(-20.0, -15.0, 2)

    def fault(run: Trajectory) -> str:
        if run.accepted > 500:
            return f"{run.accepted} steps"
        return _unless(float(np.abs(run(3.0) - plain(3.0)).max()) <= 1e-12, "x differs")

    return _system(LCS(A, C.T, C, D, f=f, g=g), x0, 3.0, fault)


def circuit(rng: np.random.Generator) -> Case:
    """Join elements at random, with a resistor in series with the source; look at 400 times and more."""
    nodes = list("0abcde")[: int(rng.integers(3, 7))]

    def two() -> str:
        return " ".join(rng.choice(nodes, 2, replace=False))

    def number(low: float, high: float) -> str:
        return f"{10.0 ** rng.uniform(low, high):.4g}"

    lines = [f"R{50 + i} {node} 0 {number(0.0, 2.0)}" for i, node in enumerate(nodes[1:])]
    lines += [
        f"C{i} {two()} {number(-2.0, 0.0)} IC={rng.uniform(0.0, 3.0):.3g}" for i in range(rng.integers(1, 4))
    ]
    lines += [f"L{i} {two()} {number(-2.0, 0.0)}" for i in range(rng.integers(0, 3))]
    lines += [f"R{i} {two()} {number(-1.0, 1.0)}" for i in range(rng.integers(1, 4))]
    lines += [f"D{i} {two()}" for i in range(rng.integers(1, 6))]
    plus, minus = rng.choice(nodes, 2, replace=False)
    lines += [f"V1 {plus} s SIN(0 {rng.uniform(1, 9):.3g} {rng.uniform(0.2, 2.0):.3g})", f"R99 s {minus} 0.5"]
    made = DiodeCircuit.from_netlist("\n".join(lines) + "\n")

    def run(interrupt: Interrupt) -> Trajectory:
        return made.simulate((0.0, 4.0), interrupt=interrupt).trajectory

    def fault(trajectory: Trajectory) -> str:
        system = trajectory.flows[0].form.given
        return _everywhere(system, trajectory)

    return Case(run, fault)


CLASSES: dict[str, Callable[[np.random.Generator], Case]] = {
    "columns of 2 to 12 beads": column,
    "chairs on four legs": chair,
    "chains with stops": chain,
    "cradles": cradle,
    "rocking blocks": rocking_block,
    "carts against a stop": pushed_carts,
    "feedthrough from 1e-14 to 1e14": feedthrough,
    "rectifiers behind 1e-12 to 1e12 ohm": rectifier,
    "feedthrough of mixed scales": scaled_feedthrough,
    "skew feedthrough, 15 to 30 pairs": skew_feedthrough,
    "stiff and lossless": stiff_and_lossless,
    "offsets of rounding size": tiny_offsets,
    "circuits, refined": circuit,
}


def _restitution(rng: np.random.Generator, largest: float = 1.0) -> float:
    return float(min(rng.choice([0.0, 0.2, 0.5, 0.7, 0.9, 1.0, rng.random()]), largest))


def _mechanical(system: MechanicalSystem, q0: Vector, v0: Vector, end: float, rest: Vector | None) -> Case:
    """Gaps stay open, energy never grows, and at the end there is rest where that is known."""
    n = q0.size
    gaps = system.F @ q0 + system.offset
    if gaps.min() < 0.0:
        system = MechanicalSystem(
            system.mass,
            system.damping,
            system.stiffness,
            system.F,
            system.force,
            system.offset - gaps.min(),
            system.restitution,
        )
        rest = None
    force = system.force.after(0.0)

    def energy(x: Matrix) -> Vector:
        q, v = x[:, :n], x[:, n:]
        kinetic = np.einsum("ti,ij,tj->t", v, system.mass, v)
        return np.asarray(0.5 * kinetic + 0.5 * np.einsum("ti,ij,tj->t", q, system.stiffness, q) - q @ force)

    def fault(run: Trajectory) -> str:
        E = energy(run.x)
        scale = max(1.0, float(np.abs(E).max()))
        for event in run.events:
            before, after = energy(np.stack([event.x_before, event.x_after]))
            if after - before > 1e-11 * scale:
                return f"energy grows at a {event.kind}"
        gap = run.x[:, :n] @ system.F.T + system.offset
        checks = (
            (np.diff(E).max(initial=0.0) <= 1e-9 * scale, "energy grows"),
            (gap.min() >= -1e-9, "penetration"),
            (run.u.min() >= 0.0, "a force that pulls"),
            (np.abs(run.u * run.y).max() <= 1e-8 * max(1.0, float(run.u.max())), "force at a distance"),
            (
                rest is None or np.abs(run.x[-1] - np.append(rest, 0.0 * rest)).max() <= 1e-9,
                "no rest where it is due",
            ),
        )
        return next((text for holds, text in checks if not holds), "")

    return Case(lambda interrupt: system.simulate(q0, v0, (0.0, end), interrupt=interrupt), fault)


def _passive(system: LCS, x0: Vector, end: float) -> Case:
    """Hold that |x|**2 / 2 is a storage function."""

    def fault(run: Trajectory) -> str:
        stored = np.sum(run.x**2, axis=1)
        grows = float(np.diff(stored).max(initial=0.0)) > 1e-9 * stored[0]
        return "energy grows" if grows else _equations(system, run)

    return _system(system, x0, end, fault)


def _system(system: LCS, x0: Vector, end: float, fault: Callable[[Trajectory], str]) -> Case:
    return Case(lambda interrupt: simulate(system, x0, (0.0, end), interrupt=interrupt), fault)


def _everywhere(system: LCS, run: Trajectory) -> str:
    """Return what of the system's equations does not hold at events, refined points or inside flows."""
    return _equations(system, run) or _equations(system, run.refined(400)) or _rates(system, run)


def _equations(system: LCS, run: Trajectory) -> str:
    """Return what of y = Cx + Du + g, 0 <= y _|_ u >= 0 does not hold, beside the terms of each row."""
    g = np.array([system.g.after(t) for t in run.t])
    terms = np.abs(run.x) @ np.abs(system.C).T + np.abs(run.u) @ np.abs(system.D).T + np.abs(g)
    left = np.abs(run.x @ system.C.T + run.u @ system.D.T + g - run.y)
    if (left > 1e-7 * terms.max(axis=0)).any():
        return "y = Cx + Du + g does not hold"
    if (run.u < -1e-9 * run.u.max(axis=0)).any() or (run.y < -1e-9 * terms.max(axis=0)).any():
        return "u or y is negative"
    least = run.u.max(axis=0) * np.maximum(1e-9 * run.y.max(axis=0), 1e-12 * terms.max(axis=0))
    return _unless(bool((run.u * run.y <= least).all()), "u and y are not complementary")


def _rates(system: LCS, run: Trajectory) -> str:
    """Return whether x' = Ax + Bu + f fails inside a flow, by central differences."""
    for flow in run.flows:
        length = flow.end - flow.start
        if length < 1e-6:
            continue
        t, h = 0.37 * flow.start + 0.63 * flow.end, min(1e-6, 1e-3 * length)
        (before, x, after), u, _ = flow.at(np.array([t - h, t, t + h]))
        force = system.f.after(t)
        rate = system.A @ x + system.B @ u[1] + force
        size = np.abs(system.A) @ np.abs(x) + np.abs(system.B) @ np.abs(u[1]) + np.abs(force)
        size += 1e-9 * np.abs(x) / h + 1e-6
        if (np.abs((after - before) / (2.0 * h) - rate) > 1e-4 * size).any():
            return "x' = Ax + Bu + f does not hold"
    return ""


def _by_radau(
    rate: Callable[[float, float], float], times: Vector, size: float = 1.0, longest: float = math.inf
) -> Vector:
    """Return the solution from 0, in steps no longer than what happens in between takes."""
    with np.errstate(divide="ignore"):  # where nothing moves
        found = solve_ivp(
            lambda t, x: [rate(t, float(x[0]))],
            (0.0, float(times[-1])),
            [0.0],
            method="Radau",
            t_eval=times,
            rtol=1e-9,
            atol=1e-10 * size,
            max_step=min(float(times[-1]) / 300.0, longest),
        )
    return np.asarray(found.y[0])


def _unless(holds: bool, text: str) -> str:
    return "" if holds else text
