"""Which mode a state goes on in: the index sets of S(z), nearest to the current one first."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Literal, TypeAlias

import numpy as np

from pricing_core.arrays import IndexSet, Vector
from pricing_core.errors import NonUniqueError, NotFoundError, NumericalError
from pricing_core.lcp import LCP, solve
from pricing_core.lcs.autonomous import AutonomousForm
from pricing_core.lcs.closed_form import ClosedForm, closed_form
from pricing_core.lcs.free_inputs import free_input_moves_state
from pricing_core.lcs.mode_dynamics import LADDER, Entry, ModeDynamics, Shares, State, mode_dynamics
from pricing_core.lcs.one_step_problem import OneStepProblem, one_step_problem
from pricing_core.lcs.slow_part import SlowPart, slow_part
from pricing_core.lcs.uniqueness import has_unique_state

OnNonUnique: TypeAlias = Literal["raise", "first"] | Callable[[float, Vector, tuple[IndexSet, ...]], IndexSet]

LARGEST_COMPLETE = 10  # pairs up to which all 2**k modes are looked at
SEARCHED = (1e2, 1e4, 1e6)  # real s, in the form's units, at which large systems are solved for their mode
PATIENCE = 3  # exchanges of all pairs that gain nothing
FEW_EXCHANGES = 4  # of all pairs, as long as fewer and fewer outputs are negative
MOST_EXCHANGES = 60
SAME_STATE = 1e-8  # relative: futures this close are one


@dataclass(frozen=True, slots=True, eq=False)
class ModeSelector:
    """The mode selection rule I in S(z) of (11.78), with the dynamics of every mode that was looked at.

    Parameters
    ----------
    form : AutonomousForm
    is_unique : bool
        Whether the state is known to have one continuation only: then the first mode found is taken.
    on_nonunique : {"raise", "first"} or callable
        A callable is given t, x and the modes, and returns one of them.
    """

    form: AutonomousForm
    is_unique: bool
    on_nonunique: OnNonUnique
    _known: dict[IndexSet, ModeDynamics | None] = field(default_factory=dict, init=False, repr=False)
    _slow: dict[int, SlowPart | None] = field(default_factory=dict, init=False, repr=False)
    _closed: dict[int, ClosedForm | None] = field(default_factory=dict, init=False, repr=False)
    _steps: dict[float, OneStepProblem] = field(default_factory=dict, init=False, repr=False)
    _taken: dict[tuple[IndexSet, IndexSet | None], IndexSet] = field(
        default_factory=dict, init=False, repr=False
    )

    def dynamics(self, mode: IndexSet) -> ModeDynamics | None:
        """Return the dynamics of a mode, None where u is not unique in it."""
        if mode not in self._known:
            self._known[mode] = mode_dynamics(self.form, mode)
        return self._known[mode]

    def slow_part(self, dynamics: ModeDynamics) -> SlowPart | None:
        """Return what is left of a mode once its fast part has died out, None where it has none."""
        key = id(dynamics)  # all dynamics are kept
        if key not in self._slow:
            self._slow[key] = slow_part(dynamics)
        return self._slow[key]

    def closed_form(self, dynamics: ModeDynamics) -> ClosedForm | None:
        """Return the closed form of a mode's flow, None where it is not known well enough."""
        key = id(dynamics)  # all dynamics are kept
        if key not in self._closed:
            self._closed[key] = closed_form(dynamics.rate)
        return self._closed[key]

    def select(self, state: State, t: float, near: IndexSet, without: IndexSet | None = None) -> Entry:
        """Return the mode in which z goes on, and how.

        Parameters
        ----------
        state : State
            In the form's units.
        near : tuple of int
            The mode so far: others are tried in the order of their distance from it.
        without : tuple of int, optional
            A mode that is known not to go on.

        Raises
        ------
        NotFoundError
            No admissible mode was found: nothing is proved, for signs are told in floating point.
        NonUniqueError
            There are several, with different futures.
        """
        if self.one_is_enough or self.on_nonunique == "first":
            for shares in LADDER:
                found = next(self._admitting(state, near, without, shares), None)
                if found is not None:
                    if self.one_is_enough:
                        self._taken[near, without] = found.dynamics.mode
                    return found
            raise self._no_mode(state.z, t)
        for shares in LADDER:
            every = list(self._admitting(state, near, without, shares))
            if every:
                break
        else:
            raise self._no_mode(state.z, t)
        if any(not self._same_future(every[0], other, state.z) for other in every[1:]):
            return self._chosen(every, state.z, t)
        if self.on_nonunique == "raise":
            self._check_free_inputs(every[0].dynamics, state, t)
        return every[0]

    @property
    def one_is_enough(self) -> bool:
        """Whether the first mode that is found is taken, without a look at the others."""
        return self.is_unique or self.form.system.shape[1] > LARGEST_COMPLETE

    def _admitting(
        self, state: State, near: IndexSet, without: IndexSet | None, shares: Shares
    ) -> Iterator[Entry]:
        """Yield the modes that go on from z."""
        for mode in self._candidates(state, near, self._taken.get((near, without), near), shares):
            dynamics = None if mode == without else self.dynamics(mode)
            entry = None if dynamics is None else dynamics.entered(state, shares)
            if entry is not None:
                yield entry

    def _candidates(self, state: State, near: IndexSet, last: IndexSet, shares: Shares) -> Iterator[IndexSet]:
        """Yield the mode taken last time, the nearest, those that signs lead to, what large s suggests.

        If they are few, all follow by distance.
        """
        k = self.form.system.shape[1]
        tried = set()
        for mode in itertools.chain(
            (last, near),
            self._exchanged(state, near, shares, 0, FEW_EXCHANGES),
            self._from_problems(state.z),
            self._exchanged(state, near, shares, PATIENCE, MOST_EXCHANGES),
        ):
            if mode not in tried:
                tried.add(mode)
                yield mode
        if k <= LARGEST_COMPLETE:
            for distance in range(1, k + 1):
                for changed in itertools.combinations(range(k), distance):
                    mode = tuple(sorted(set(near) ^ set(changed)))
                    if mode not in tried:
                        yield mode

    def _exchanged(
        self, state: State, near: IndexSet, shares: Shares, patience: int, most: int
    ) -> Iterator[IndexSet]:
        """Yield what exchanging the pairs with negative outputs leads to: all at once, later the last one alone.

        Principal pivoting on (11.77), which ends with a solution where G(s) is a P-matrix for large s (Murty 1974).
        """
        mode, fewest, left = near, self.form.system.shape[1] + 1, patience
        for _ in range(most):
            dynamics = self.dynamics(mode)
            if dynamics is None:
                return
            falling = np.flatnonzero(dynamics.signs(state, shares) < 0.0).tolist()
            if not falling:
                return
            if len(falling) < fewest:
                fewest, left = len(falling), patience
            elif patience:
                left -= 1
            else:
                return
            changed = falling if left > 0 or not patience else falling[-1:]
            mode = tuple(sorted(set(mode) ^ set(changed)))
            yield mode

    def _from_problems(self, z: Vector) -> Iterator[IndexSet]:
        """Yield the modes that solve the problem (11.77) at large real s, that of an implicit step of length 1/s."""
        for s in SEARCHED:
            try:
                if s not in self._steps:
                    self._steps[s] = one_step_problem(self.form.system, 1.0 / s)
                step = self._steps[s]
                solution = solve(step.lcp(step.free_state(z, 0.0), 0.0))
            except NumericalError:
                continue
            yield tuple(np.flatnonzero(solution.z > solution.w).tolist())

    def _same_future(self, one: Entry, other: Entry, z: Vector) -> bool:
        """Tell whether the states after the jump and all their derivatives agree."""
        a, b = one.c.z, other.c.z
        rates = one.dynamics.rate, other.dynamics.rate
        step = min(one.dynamics.step, other.dynamics.step, 1.0)
        for _ in range(z.size + 1):
            here, there = one.dynamics.basis @ a, other.dynamics.basis @ b
            size = max(float(np.max(np.abs(here), initial=0.0)), float(np.max(np.abs(z), initial=0.0)))
            if np.any(np.abs(here - there) > SAME_STATE * size):
                return False
            a, b = step * (rates[0] @ a), step * (rates[1] @ b)
        return True

    def _check_free_inputs(self, found: ModeDynamics, state: State, t: float) -> None:
        """Raise NonUniqueError where inputs that are zero, in pairs whose outputs stay zero, may as well move x."""
        signs, z = found.signs(state), state.z
        held = tuple(i for i in found.mode if signs[i] > 0.0)
        zero = np.flatnonzero(signs == 0.0).tolist()
        for count in range(len(zero) + 1):
            for others in itertools.combinations(zero, count):
                mode = tuple(sorted((*held, *others)))
                rising = tuple(i for i in zero if i not in others)
                if self.dynamics(mode) is None and free_input_moves_state(self.form, mode, held, rising):
                    x = (z * self.form.units.state)[: self.form.states]
                    raise NonUniqueError(
                        f"several continuations from x = {shown_state(x)} at t = {t:.12g}, with y = 0 and inputs that "
                        f'no output sees in the pairs {mode}: on_nonunique="first" leaves these inputs zero'
                    )

    def _chosen(self, every: list[Entry], z: Vector, t: float) -> Entry:
        """Return the mode that goes on where several do, with states that differ."""
        modes = tuple(entry.dynamics.mode for entry in every)
        x = (z * self.form.units.state)[: self.form.states]
        if callable(self.on_nonunique):
            wanted = tuple(self.on_nonunique(t, x, modes))
            if wanted not in modes:
                raise NonUniqueError(
                    f"on_nonunique chose the mode {wanted} at t = {t:.12g}: not one of {modes}"
                )
            return every[modes.index(wanted)]
        if has_unique_state(self.form.given):  # what differs is rounding
            return every[0]
        raise NonUniqueError(
            f"several continuations from x = {shown_state(x)} at t = {t:.12g}, in the modes {modes}: "
            'choose with on_nonunique="first" or a function of (t, x, modes)'
        )

    def _no_mode(self, z: Vector, t: float) -> NotFoundError:
        x = (z * self.form.units.state)[: self.form.states]
        looked = "every one" if self.form.system.shape[1] <= LARGEST_COMPLETE else "the likely ones"
        return NotFoundError(
            f"no mode that goes on was found from x = {shown_state(x)} at t = {t:.12g}: {looked} with a unique input "
            "looked at in floating point, nothing proved"
        )


def implicit_step(form: AutonomousForm, state: State, h: float) -> tuple[State, IndexSet] | None:
    """Return the state after an implicit Euler step of length h, in the form's units, and the mode that it ends in.

    None where the step's problem was not solved: from every state of a passive system it has a solution.
    """
    A, B, C, D = form.system.A, form.system.B, form.system.C, form.system.D
    try:
        resolved = np.linalg.solve(np.eye(A.shape[0]) - h * A, np.column_stack([h * B, state.z]))
        problem = LCP(D + C @ resolved[:, :-1], C @ resolved[:, -1])
        solution = solve(problem)
    except (NumericalError, np.linalg.LinAlgError):
        return None
    z = resolved[:, -1] + resolved[:, :-1] @ solution.z
    mode = tuple(np.flatnonzero(solution.z > solution.w).tolist())
    return State(z, np.maximum(state.sizes, np.abs(z))), mode


def shown_state(x: Vector) -> str:
    """Return x as messages show it."""
    return np.array2string(x, precision=6, threshold=8)
