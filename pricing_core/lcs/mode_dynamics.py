"""The flow of one mode in coordinates of its consistent space, and the jump that leads there."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dgebal

from pricing_core.arrays import IndexSet, Matrix, Vector
from pricing_core.kernel import enter_mode, initial_signs, leading_signs
from pricing_core.lcs.autonomous import AutonomousForm
from pricing_core.lcs.mode_maps import ModeMaps, exact_maps, floating_maps

Table: TypeAlias = NDArray[np.float64]

REACH = 2.0  # time that one Taylor polynomial reaches, in units of 1/|rate|
DEGREE = 26  # degree of that polynomial, as in the kernel: REACH**27/27! is 1e-20
LONGEST = 1e308  # any interval of finite numbers
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
    Shares(0.0, 0.0, 0.0),
)


class State(NamedTuple):
    """The vector z, and the sizes of the terms that its entries are sums of: their rounding is a share of these."""

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
    scaled_rate: Matrix = field(init=False, repr=False)  # in time/step
    derivatives: Table = field(init=False, repr=False)  # (orders, k, d): the outputs and on, in time/step
    output_sizes: Matrix = field(init=False, repr=False)  # (k, d)
    active: NDArray[np.bool_] = field(init=False, repr=False)  # (k,)

    def __post_init__(self) -> None:
        k, d = self.outputs.shape
        scaled = self.rate * self.step if self.step < LONGEST else np.zeros_like(self.rate)
        derivatives = np.empty((min(d, MOST_ORDERS) + 1, k, d))
        derivatives[0] = self.outputs
        for order in range(1, len(derivatives)):
            derivatives[order] = derivatives[order - 1] @ scaled
        active = np.zeros(k, dtype=bool)
        active[list(self.mode)] = True
        values = {
            "scaled_rate": scaled,
            "derivatives": derivatives,
            "output_sizes": np.abs(self.outputs),
            "active": active,
            **{
                name: np.ascontiguousarray(getattr(self, name))
                for name in ("outputs", "coordinates", "impulses")
            },
        }
        for name, value in values.items():
            object.__setattr__(self, name, value)

    def flowed(self, starts: Matrix, places: Vector) -> Matrix:
        """Return the coordinates at these places in a step, at most 1, from starts of shape (m, d): shape (m, d)."""
        total, term, shares = starts.copy(), starts, places[:, None]
        for j in range(1, DEGREE + 1):
            term = (term @ self.scaled_rate.T) * (shares / j)
            if not term.any():
                break
            total += term
        return total

    def enter(self, state: State) -> State:
        """Return the coordinates after the jump, zero where they are rounding, and the sizes of their terms."""
        return State(*enter_mode(self.coordinates, state.z, state.sizes))

    def leave(self, coordinates: State) -> State:
        """Return z at these coordinates, and the sizes of its terms."""
        return State(self.basis @ coordinates.z, np.abs(self.basis) @ coordinates.sizes)

    def jumps_from(self, z: Vector, c: Vector) -> bool:
        """Tell whether z is not in V_I, by more than rounding: z jumps to the coordinates c."""
        if self.basis.shape[0] == self.basis.shape[1]:
            return False
        left = np.abs(z - self.basis @ c)
        return float(left.max(initial=0.0)) > CAREFUL.value * max(float(np.abs(z).max(initial=0.0)), 1e-300)

    def initial_signs(self, coordinates: State, shares: Shares = CAREFUL) -> Vector:
        """Return each output's sign just after the coordinates are c: of its first derivative that is not zero."""
        return np.asarray(
            initial_signs(self.derivatives, self.scaled_rate, *coordinates, shares.value, shares.derivative)
        )

    def signs(self, state: State, shares: Shares = CAREFUL) -> Vector:
        """Return each output's sign from z on: of its leading impulse, else just after the jump."""
        return self._signs_after(state, self.initial_signs(self.enter(state), shares), shares)

    def _signs_after(self, state: State, after: Vector, shares: Shares) -> Vector:
        if self.impulses.shape[0] == 0:
            return after
        leading = leading_signs(self.impulses, *state, shares.impulse)
        return np.where(leading != 0.0, leading, after)

    def entered(self, state: State, shares: Shares = CAREFUL) -> Entry | None:
        """Return how z goes on in the mode if I is in S(z) (11.77): every output is initially nonnegative."""
        c = self.enter(state)
        after = self.initial_signs(c, shares)
        if (self._signs_after(state, after, shares) < 0.0).any():
            return None
        continues = self.impulses.shape[0] == 0 or not (after < 0.0).any()
        return Entry(self, c, shares, continues)

    def continues(self, coordinates: State, shares: Shares = CAREFUL) -> bool:
        """Tell whether the mode can go on from these coordinates."""
        return not (self.initial_signs(coordinates, shares) < 0.0).any()


class Entry(NamedTuple):
    """How a state goes on in a mode, and the shares with which its signs were told."""

    dynamics: ModeDynamics
    c: State  # after the jump
    shares: Shares
    continues: bool  # whether the mode goes on after its impulses


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
