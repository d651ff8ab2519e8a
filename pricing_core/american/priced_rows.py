"""Prices and their derivatives in columns."""

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from pricing_core.american.contracts.contract import Option
from pricing_core.american.flat.limits import ClosedValue
from pricing_core.american.results import (
    NO_FURTHER_GREEKS,
    Diagnostics,
    FurtherGreeks,
    Status,
    Valuation,
    assemble,
)
from pricing_core.arrays import BoolVector, Vector


@dataclass(frozen=True, slots=True, eq=False)
class PricedRows:
    """Money per unit of underlying, by row; NaN where there is nothing.

    Parameters
    ----------
    value, european, delta, gamma, theta, vega, rho, dividend_rho, boundary, error : Vector
        As in `pricing_core.american.Valuation`.
    exercised : bool array
        Whether the spot lies in the exercise region, and exercise pays.
    """

    value: Vector
    european: Vector
    delta: Vector
    gamma: Vector
    theta: Vector
    vega: Vector
    rho: Vector
    dividend_rho: Vector
    boundary: Vector
    error: Vector
    exercised: BoolVector

    def priced(self, rows: NDArray[np.intp]) -> "PricedRows":
        """Return these columns of some of the rows."""
        return PricedRows(*(getattr(self, name)[rows] for name in PricedRows.__slots__))

    def valuation(
        self,
        option: Option,
        spot: float,
        *,
        status: Status,
        method: str,
        diagnostics: Diagnostics,
        further: FurtherGreeks = NO_FURTHER_GREEKS,
    ) -> Valuation:
        """Return the valuation of the only row."""
        return assemble(
            option,
            spot,
            ClosedValue(*(getattr(self, field.name).item() for field in fields(ClosedValue))),
            european=self.european.item(),
            boundary=self.boundary.item(),
            exercise_now=self.exercised.item(),
            status=status,
            method=method,
            diagnostics=diagnostics,
            further=further,
        )
