"""The fitted surface of implied volatilities, with its derivatives, its standard errors and what is proved of it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from pricing_core.american.contracts.local_volatility import hat_weights
from pricing_core.american.implied.black_spread import black_time_value
from pricing_core.arrays import Matrix, Vector
from pricing_core.chains.surface.arbitrage import NoArbitrage
from pricing_core.chains.surface.coordinates import Coordinates
from pricing_core.chains.surface.essvi import ESSVI
from pricing_core.chains.surface.forward_greeks import forward_greeks
from pricing_core.chains.surface.jet import Jet
from pricing_core.chains.surface.smoothing import Scales
from pricing_core.chains.surface.svi import SVI
from pricing_core.chains.surface.total_variance import TotalVariance
from pricing_core.errors import InvalidInputError

COMPLEX_STEP = 1e-30  # Relative step of derivatives along the imaginary axis, which lose no digits.


@dataclass(frozen=True, slots=True)
class ExpiryFit:
    """The smile that was fitted to one expiry, and how.

    Parameters
    ----------
    expiry : float
        Years.
    status : {"ok", "thin", "invalid_input"}
        "thin": fewer than five quotes, or all on one side of the forward; the shape comes from the expiries beside it.
        "invalid_input": no usable quote; the surface passes the expiry over.
    message : str
        Why, where the status is not "ok".
    quotes_used : int
    forward : float
        Money.
    least_x, most_x : float
        Between which coordinates its quotes lie.
    rms : float
        Root mean square of mid less fit in stated deviations.
    svi : SVI, optional
        The smile of this expiry alone; none where it is thin.
    essvi : ESSVI, optional
        Its smile in the backbone.
    """

    expiry: float
    status: str
    message: str
    quotes_used: int
    forward: float
    least_x: float = math.nan
    most_x: float = math.nan
    rms: float = math.nan
    svi: SVI | None = None
    essvi: ESSVI | None = None


@dataclass(frozen=True)
class ImpliedSurface:
    """Implied volatilities over strike and expiry, see `fit_surface`.

    Parameters
    ----------
    coordinates : Coordinates
        Forwards, dividends due, and the coordinate x of the smiles.
    variance : TotalVariance
        Total variance in that coordinate.
    covariance : Matrix, shape (m n, m n)
        Covariance of the coefficients of all smiles, the forwards being certain.
    by_forward : Matrix, shape (m n, m)
        What the coefficients change by with a standard error of each expiry's forward.
    forward_error : Vector, shape (m,)
        Standard errors of ln(forward).
    statuses : tuple of ExpiryFit
        For each of the expiries that were given.
    proof : NoArbitrage
        For each of the expiries that were fitted.
    scales : Scales
        How far the quotes deviate from the smiles, and the smiles from the backbone.
    programmes : int
        Number of quadratic programmes that freed the smiles of arbitrage.
    """

    coordinates: Coordinates
    variance: TotalVariance
    covariance: Matrix
    by_forward: Matrix
    forward_error: Vector
    statuses: tuple[ExpiryFit, ...]
    proof: NoArbitrage
    scales: Scales
    programmes: int = 0

    @property
    def expiries(self) -> Vector:
        """The expiries that were fitted, years, shape (m,)."""
        return self.variance.expiries

    def volatility(self, strike: ArrayLike, expiry: float) -> Vector:
        """Return implied volatilities, 1/sqrt(year), at strikes of any shape, money; NaN where there is none.

        With cash dividends there is none at strikes up to the value of the dividends that are due after the expiry.
        """
        return self._volatility(strike, expiry)[0]

    def total_variance(self, k: ArrayLike, expiry: float) -> Vector:
        """Return volatility^2 expiry at k = ln(strike/forward), of any shape."""
        strike = self.coordinates.forward(expiry) * np.exp(np.asarray(k, dtype=np.float64))
        return np.asarray(self.volatility(strike, expiry) ** 2 * expiry)

    def derivatives(self, x: ArrayLike, expiry: float) -> tuple[Vector, Vector, Vector, Vector]:
        """Return w, w_x, w_xx and w_T in closed form at the surface's own coordinate, each of shape (k,).

        x is ln(strike/forward) where no cash dividend is due after the expiry, see `Coordinates`; w is the total
        variance of the martingale X at its strike e^x.
        """
        jet, by_time = self.variance.at(np.atleast_1d(np.asarray(x, dtype=np.float64)), _years(expiry))
        return jet.value, jet.first, jet.second, by_time

    def european_price(self, option_type: str, strike: ArrayLike, expiry: float) -> Vector:
        """Return European prices, money, at strikes of any shape."""
        strikes = np.asarray(strike, dtype=np.float64)
        forward, discount = self.coordinates.forward(expiry), self.coordinates.discount(expiry)
        spread = self.volatility(strikes, expiry) * math.sqrt(expiry)
        value = black_time_value(np.abs(np.log(strikes / forward)), spread)[0] * np.minimum(strikes, forward)
        ahead = forward - strikes if option_type == "call" else strikes - forward
        return np.asarray(discount * (np.maximum(ahead, 0.0) + value))

    def standard_error(self, strike: ArrayLike, expiry: float) -> Vector:
        """Return the standard errors of implied volatilities, at strikes of any shape.

        They hold the noise of the quotes, estimated from their residuals, what is not known between the quotes, and
        what is not known of the forwards.
        """
        strikes, by_variance = np.asarray(strike, dtype=np.float64), self._volatility(strike, expiry)[1]
        x, terms = self._terms(strikes.ravel(), expiry)
        return np.asarray(self.spread(x, terms).reshape(strikes.shape) * by_variance)

    def price_error(self, option_type: str, strike: ArrayLike, expiry: float) -> Vector:
        """Return the standard errors of European prices, money, at strikes of any shape.

        An error of the forward moves a price directly, and through the volatilities that the quotes then have.
        """
        strikes = np.asarray(strike, dtype=np.float64)
        flat = strikes.ravel()
        volatility, by_variance = self._volatility(flat, expiry)
        forward, discount = self.coordinates.forward(expiry), self.coordinates.discount(expiry)
        vega, delta = forward_greeks(option_type, forward, flat, volatility, expiry)
        weights = hat_weights(self.expiries, np.array([expiry]))[0] * self.forward_error
        x, terms = self._terms(flat, expiry)
        factor = discount * vega * by_variance
        terms = [(i, order, factor * values) for i, order, values in terms]
        directly = discount * forward * delta[:, None] * weights
        return np.asarray(self.spread(x, terms, directly).reshape(strikes.shape))

    def _terms(self, strike: Vector, expiry: float) -> tuple[Vector, list[tuple[int, int, Vector]]]:
        """Return the coordinates of strikes, and by what the smiles there count for the total variance."""
        x = self.coordinates.x(strike, expiry)
        x = np.where(np.isfinite(x), x, 0.0)
        smiles, terms = self.variance.smiles(x), []
        for i in range(self.expiries.size):
            step = COMPLEX_STEP * np.maximum(np.abs(smiles[i].value), 1e-300)
            moved = list(smiles)
            moved[i] = Jet(smiles[i].value + 1j * step, smiles[i].first, smiles[i].second)
            jet, _ = self.variance.between(moved, x, expiry)
            if np.iscomplexobj(jet.value) and np.any(np.imag(jet.value) != 0.0):
                terms.append((i, 0, np.imag(jet.value) / step))
        return x, terms

    def spread(
        self, x: Vector, terms: list[tuple[int, int, Vector]], directly: Matrix | None = None
    ) -> Vector:
        """Return the standard deviation of sums of smiles and their derivatives at the coordinate x, shape (k,).

        Parameters
        ----------
        terms : list of (expiry's index, order of the derivative 0 to 2, factors of shape (k,))
        directly : Matrix, shape (k, m), optional
            What is added with a standard error of each expiry's forward.
        """
        n = self.variance.basis.size
        rows = np.zeros((x.size, n * self.expiries.size))
        for i in sorted({term[0] for term in terms}):
            theta = float(self.variance.theta[i])
            splines = self.variance.basis.jets(x / math.sqrt(theta))
            by_order = (theta * splines.value, math.sqrt(theta) * splines.first, splines.second)
            for _, order, factors in (term for term in terms if term[0] == i):
                rows[:, i * n : (i + 1) * n] += factors[:, None] * by_order[order]
        used = np.flatnonzero(rows.any(axis=0))
        part = rows[:, used]
        variance = np.einsum("ij,ij->i", part @ self.covariance[np.ix_(used, used)], part)
        shifted = part @ self.by_forward[used] + (0.0 if directly is None else directly)
        return np.asarray(np.sqrt(np.maximum(variance, 0.0) + (shifted**2).sum(axis=1)))

    def _volatility(self, strike: ArrayLike, expiry: float) -> tuple[Vector, Vector]:
        """Return volatilities and their derivatives by the total variance of X."""
        strikes = np.asarray(strike, dtype=np.float64)
        flat = np.ravel(strikes)
        x = self.coordinates.x(flat, _years(expiry))
        reached = np.isfinite(x)
        jet, _ = self.variance.at(np.where(reached, x, 0.0), expiry)
        found, slope = self.coordinates.volatility(jet.value, flat, expiry)
        shape = strikes.shape
        return np.where(reached, found, np.nan).reshape(shape), np.where(reached, slope, np.nan).reshape(
            shape
        )


def _years(expiry: float) -> float:
    if not (math.isfinite(expiry) and expiry > 0.0):
        raise InvalidInputError("expiry", expiry, "a number of years above 0")
    return float(expiry)
