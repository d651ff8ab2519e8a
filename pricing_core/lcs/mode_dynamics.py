"""The flow of one mode in coordinates of its consistent space, and the jump that leads there."""

from dataclasses import dataclass, field
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dgebal

from pricing_core.arrays import IndexSet, Matrix, Vector
from pricing_core.lcs.autonomous import AutonomousForm
from pricing_core.lcs.mode_maps import ROUNDING, ModeMaps, exact_maps, floating_maps, without_rounding

Table: TypeAlias = NDArray[np.float64]

REACH = 2.0  # time that one Taylor polynomial reaches, in units of 1/|rate|
DEGREE = 26  # degree of that polynomial: REACH**27/27! is 1e-20
LONGEST = 1e308  # any interval of finite numbers
MOST_TABULATED = 40  # coordinates up to which the Taylor polynomials' coefficients are tabulated
POWERS = np.arange(DEGREE + 1)
LEAST_SHARE = 0.1  # of the balanced rates' norm that sets the step, where they only push each other on
MOST_ORDERS = 4  # derivatives of the outputs that are tabulated


class Shares(NamedTuple):
    """Shares of its terms' sizes below which an output, one of its derivatives, and an impulse count as zero."""

    value: float
    derivative: float
    impulse: float


# From what accumulated rounding and tangency leave open to the signs of the numbers as they are. Where bounces die
# out, a velocity that is taken for zero may ask for a jump that is not: the second line takes that for none as well.
CAREFUL = Shares(1e-11, 1e-9, 1e-11)
LADDER = (
    CAREFUL,
    Shares(1e-11, 1e-9, 1e-7),
    Shares(1e-13, 1e-12, 1e-13),
    Shares(1e-15, 1e-14, 1e-15),
    Shares(0, 0, 0),
)


class State(NamedTuple):
    """z, and the sizes of the terms that its entries are sums of: their rounding is a share of these."""

    z: Vector  # (N,)
    sizes: Vector  # (N,)


@dataclass(frozen=True, slots=True, eq=False)
class ModeDynamics:
    """z = V c, c' = R c on V_I (11.71), after the jump c = W z, W V = 1.

    All numbers are in the units of the autonomous form. The outputs are what must not be negative: u_i for i in I
    and y_i otherwise. The coordinates are some of the entries of z, so that what is not coupled stays apart.

    Parameters
    ----------
    mode : tuple of int
        I.
    basis : Matrix, shape (N, d)
        V, the identity in the rows of the coordinates.
    coordinates : Matrix, shape (d, N)
        W.
    rate : Matrix, shape (d, d)
        R.
    outputs : Matrix, shape (k, d)
        The outputs as functions of the coordinates.
    impulses : array, shape (r, k, N)
        The outputs' coefficients of the derivatives of delta as functions of z before the jump, the highest first.
    step : float
        The time that one Taylor polynomial reaches.
    maps : ModeMaps, optional
        The same matrices as they were found, rational where that is known.
    """

    mode: IndexSet
    basis: Matrix
    coordinates: Matrix
    rate: Matrix
    outputs: Matrix
    impulses: Table
    step: float
    maps: ModeMaps | None = None
    _tables: list[Table] = field(
        init=False, repr=False
    )  # (DEGREE + 1, d, d) and (DEGREE + 1, k, d), once asked for
    derivatives: Table = field(init=False, repr=False)  # (orders, k, d), in time/step
    derivative_sizes: Table = field(init=False, repr=False)  # (2, orders, k, d): of entries, of their terms
    output_sizes: Matrix = field(init=False, repr=False)  # (k, d)
    active: NDArray[np.bool_] = field(init=False, repr=False)  # (k,)

    def __post_init__(self) -> None:
        k, d = self.outputs.shape
        scaled = self._scaled_rate()
        rows, sizes, both = self.outputs, np.abs(self.outputs), np.abs(scaled)
        orders = min(d, MOST_ORDERS) + 1
        derivatives, terms = np.empty((orders, k, d)), np.empty((orders, k, d))
        for order in range(orders):
            derivatives[order], terms[order] = rows, sizes
            rows, sizes = rows @ scaled, sizes @ both
        active = np.zeros(k, dtype=bool)
        active[list(self.mode)] = True
        values = {
            "_tables": [],
            "derivatives": derivatives,
            "derivative_sizes": np.stack([np.abs(derivatives), terms]),
            "output_sizes": np.abs(self.outputs),
            "active": active,
        }
        for name, value in values.items():
            object.__setattr__(self, name, value)

    def expansion(self, c: Vector) -> Table:
        """Return the Taylor coefficients of the coordinates in time/step, shape (DEGREE + 1, d)."""
        if c.size <= MOST_TABULATED:
            return np.asarray(self._tabulated()[0] @ c)
        terms = np.empty((DEGREE + 1, c.size))
        terms[0] = c
        scaled = self._scaled_rate()
        for j in range(DEGREE):
            terms[j + 1] = scaled @ terms[j] / (j + 1)
        return terms

    def output_expansion(self, c: Vector, terms: Table) -> Table:
        """Return the Taylor coefficients of the outputs, given those of the coordinates, shape (DEGREE + 1, k)."""
        return terms @ self.outputs.T if c.size > MOST_TABULATED else np.asarray(self._tabulated()[1] @ c)

    def _scaled_rate(self) -> Matrix:
        return self.rate * self.step if self.step < LONGEST else np.zeros_like(self.rate)

    def _tabulated(self) -> list[Table]:
        if not self._tables:
            scaled = self._scaled_rate()
            taylor = np.empty((DEGREE + 1, *scaled.shape))
            taylor[0] = np.eye(scaled.shape[0])
            for j in range(DEGREE):
                taylor[j + 1] = scaled @ taylor[j] / (j + 1)
            self._tables.extend([taylor, self.outputs @ taylor])
        return self._tables

    def coordinates_of(self, z: Vector) -> Vector:
        """Return W z, zero where that is no more than rounding."""
        return np.asarray(without_rounding(self.coordinates @ z, np.abs(self.coordinates) @ np.abs(z)))

    def enter(self, state: State) -> State:
        """Return the coordinates after the jump, and the sizes of their terms."""
        return State(self.coordinates_of(state.z), np.abs(self.coordinates) @ state.sizes)

    def leave(self, coordinates: State) -> State:
        """Return z at these coordinates, and the sizes of its terms."""
        return State(self.basis @ coordinates.z, np.abs(self.basis) @ coordinates.sizes)

    def is_consistent(self, z: Vector) -> bool:
        """Tell whether z is in V_I, to rounding: no jump."""
        if self.basis.shape[0] == self.basis.shape[1]:
            return True
        left = np.abs(z - self.basis @ self.coordinates_of(z))
        return float(left.max(initial=0.0)) <= CAREFUL.value * max(float(np.abs(z).max(initial=0.0)), 1e-300)

    def leading_impulses(self, state: State, share: float = CAREFUL.impulse) -> Vector:
        """Return each output's sign of its leading impulse, 0 without one.

        `share` is that of its terms' sizes below which an impulse counts as none.
        """
        values = self.impulses @ state.z
        found = _signs(values, share * (np.abs(self.impulses) @ state.sizes))
        return _first_nonzero(found) if found.shape[0] else np.zeros(self.outputs.shape[0])

    def initial_signs(self, coordinates: State, shares: Shares = CAREFUL) -> Vector:
        """Return each output's sign just after the coordinates are c: of its first derivative that is not zero."""
        values = self.derivatives @ coordinates.z
        sizes, terms = self.derivative_sizes @ coordinates.sizes
        # What is tangential leaves a slope of the order of the root of rounding.
        least = np.maximum(shares.derivative * sizes[0], min(ROUNDING, shares.derivative) * terms)
        least[0] = shares.value * sizes[0]
        signs = _first_nonzero(_signs(values, least))
        if self.derivatives.shape[0] <= self.rate.shape[0] and not signs.all():
            return self._later_signs(signs, coordinates, shares)
        return signs

    def _later_signs(self, signs: Vector, coordinates: State, shares: Shares) -> Vector:
        """Return the signs with those that derivatives beyond the tabulated ones decide."""
        scaled = self._scaled_rate()
        both = np.abs(scaled)
        vector, sizes = coordinates
        levels = shares.derivative * (self.output_sizes @ sizes)
        tabulated = self.derivatives.shape[0]
        for order in range(1, self.rate.shape[0] + 1):
            vector, sizes = scaled @ vector, both @ sizes
            if not vector.any():
                break
            if order >= tabulated:
                least = np.maximum(levels, min(ROUNDING, shares.derivative) * (self.output_sizes @ sizes))
                signs = np.where(signs == 0.0, _signs(self.outputs @ vector, least), signs)
                if signs.all():
                    break
        return signs

    def is_slow(self, coordinates: State, outputs: tuple[int, ...]) -> bool:
        """Tell whether the first derivatives of these outputs are next to nothing beside the terms they consist of."""
        if self.derivatives.shape[0] < 2:
            return True
        pairs = list(outputs)
        slopes = np.abs(self.derivatives[1, pairs] @ coordinates.z)
        levels = self.derivative_sizes[0, 1, pairs] @ coordinates.sizes
        return bool((slopes <= CAREFUL.derivative * levels).all())

    def signs(self, state: State, shares: Shares = CAREFUL) -> Vector:
        """Return each output's sign from z on: of its leading impulse, else just after the jump."""
        after = self.initial_signs(self.enter(state), shares)
        if self.impulses.shape[0] == 0:
            return after
        leading = self.leading_impulses(state, shares.impulse)
        return np.where(leading != 0.0, leading, after)

    def admits(self, state: State, shares: Shares = CAREFUL) -> bool:
        """Tell whether I is in S(z) (11.77): every output is initially nonnegative (Definition 11.1)."""
        return bool((self.signs(state, shares) >= 0.0).all())

    def continues(self, coordinates: State, shares: Shares = CAREFUL) -> bool:
        """Tell whether the mode can go on from these coordinates."""
        return bool((self.initial_signs(coordinates, shares) >= 0.0).all())


def mode_dynamics(form: AutonomousForm, mode: IndexSet) -> ModeDynamics | None:
    """Return the dynamics of a mode, None where u is not unique in it or not every state can jump to it.

    Cost: where the outputs of the mode have one relative degree of at most 2, some products and one inverse of order
    |I|; elsewhere the sequences of `mode_geometry`.
    """
    maps = exact_maps(form, mode) if form.is_exact else floating_maps(form, mode)
    if maps is None:
        return None
    rate = maps.rate
    return ModeDynamics(
        mode=mode,
        basis=maps.basis,
        coordinates=maps.coordinates,
        rate=rate,
        outputs=maps.outputs,
        impulses=maps.impulses,
        step=longest_step(rate),
        maps=maps,
    )


def longest_step(rate: Matrix) -> float:
    """Return the time that one Taylor polynomial reaches: of the motion's own rates, whatever the units.

    The remainder is of the order of (|R**p|**(1/p) step)**27 / 27! in the units in which R is balanced.
    """
    if not rate.size or not np.any(rate):
        return LONGEST
    balanced = dgebal(rate, scale=1, permute=0)[0]
    square = balanced @ balanced
    norms = (
        np.linalg.norm(balanced, 1),
        max(np.linalg.norm(square @ balanced, 1) ** (1 / 3), np.linalg.norm(square @ square, 1) ** 0.25),
    )
    norm = float(max(min(norms), LEAST_SHARE * norms[0]))
    return REACH / norm if norm > REACH / LONGEST else LONGEST


def _first_nonzero(signs: Table) -> Vector:
    """Return the first entry of each column that is not zero, 0 without one."""
    first = np.argmax(signs != 0.0, axis=0)
    return np.asarray(signs[first, np.arange(signs.shape[1])])


def _signs(values: Table, tolerances: Table) -> Table:
    return np.where(np.abs(values) <= tolerances, 0.0, np.sign(values))
