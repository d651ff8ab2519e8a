"""The carry of a chain: a yield curve that call and put of every expiry agree on, with standard errors."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pricing_core.american.contracts.curves import Curve
from pricing_core.american.implied.carry_pairs import Pairs
from pricing_core.american.implied.implied_carry import ExpiryCarry, ImpliedCarry
from pricing_core.arrays import Vector


@dataclass(frozen=True, slots=True, eq=False)
class Carry(ImpliedCarry):
    """The carry that the quotes of a chain imply; arrays of shape (n,) have one entry per expiry, in order.

    The columns of `ImpliedCarry` come first. Where the pairs of an expiry tell nothing, forward and dividend_yield are
    those of the curve, which the other expiries tell.

    Parameters
    ----------
    standard_error : Vector
        Standard error of dividend_yield, 1/year; NaN for an expiry without pairs.
    curve : float or PiecewiseConstant
        The yield from expiry to expiry.
    pairs : Pairs, pair_residual : Vector, pair_used : bool array, each of shape (m,)
        The pairs that were looked at, what each misses parity by, money, and which count.
    stock, stock_error : Vector
        What the stock to be had at each expiry is worth now by its own pairs, and the standard error of that, money;
        NaN where the status is not "ok".
    told : tuple of ExpiryCarry
        What the pairs of each expiry tell on their own.
    gain : Vector
        By what an error of parity is multiplied on its way to the stock's value, for each expiry that is "ok".
    """

    standard_error: Vector
    curve: Curve
    pairs: Pairs | None
    pair_residual: Vector
    pair_used: NDArray[np.bool_]
    stock: Vector
    stock_error: Vector
    told: tuple[ExpiryCarry, ...]
    gain: Vector

    @property
    def is_known(self) -> bool:
        """Whether the quotes of any expiry imply a carry."""
        return bool((self.status == "ok").any())
