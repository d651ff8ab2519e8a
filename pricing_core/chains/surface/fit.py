"""From volatilities to a surface without arbitrage: SVI per expiry, eSSVI across, and smooth corrections on top."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from scipy.linalg import block_diag

from pricing_core.american.contracts.market import Market
from pricing_core.arrays import Matrix, Vector
from pricing_core.chains.interruption import check_interrupt
from pricing_core.chains.surface.arbitrage import NoArbitrage, prove
from pricing_core.chains.surface.coordinates import Coordinates
from pricing_core.chains.surface.essvi import ESSVI, calibrate_essvi
from pricing_core.chains.surface.implied_surface import ExpiryFit, ImpliedSurface
from pricing_core.chains.surface.repair import without_arbitrage
from pricing_core.chains.surface.smile_basis import SmileBasis
from pricing_core.chains.surface.smile_quotes import SmileQuotes
from pricing_core.chains.surface.smoothing import Posterior, Scales, SmoothingProblem
from pricing_core.chains.surface.svi import FEWEST_QUOTES, SVI, calibrate_svi
from pricing_core.chains.surface.total_variance import TotalVariance, joined
from pricing_core.errors import InvalidInputError, Told

SMALLEST = 0.02  # Smallest deviation that counts, as a share of the median one of an expiry; chosen.
FARTHEST = 4.0  # Residuals, in estimated deviations, beyond which a quote loses weight; chosen.
GAUSSIAN = 1.4826  # Standard deviation of a Gaussian in its median absolute deviations.
NEGLIGIBLE = 0.1  # Residuals, in stated deviations, up to which none does; chosen.
REWEIGHTINGS = 3  # Number of times that far quotes lose weight, and the scales are estimated again.
A_DAY = (
    1.0 / 365.0
)  # Years: the smiles of sooner expiries tell nothing of the others, and are fitted alone; measured.
FARTHEST_OF_A_DAY = (
    10.0  # Standard deviations from the forward beyond which their quotes do not count; chosen.
)
LAST_DAY_ABOVE = "less than a day left, and more total variance than the next expiry has"
USUAL_SLOPE = 0.3  # Slope of the wings of a smile that is not known, in sqrt(theta); chosen.


@dataclass(frozen=True, slots=True)
class _Smile:
    """The quotes of an expiry in the surface's coordinate."""

    quotes: SmileQuotes
    x: Vector
    variance: Vector
    deviation: Vector
    by_forward: Vector  # of the variance
    svi: SVI | None

    @property
    def columns(self) -> tuple[Vector, Vector, Vector]:
        return self.x, self.variance, self.deviation

    @property
    def problem(self) -> str:
        """Say what is thin about it."""
        if self.x.size < FEWEST_QUOTES:
            return f"{self.x.size} quotes: the shape of the smile comes from the expiries beside it"
        if self.x[0] > 0.0 or self.x[-1] < 0.0:
            return "all quotes on one side of the forward: the other side comes from the expiries beside it"
        return ""


def fit_surface(
    quotes: Sequence[SmileQuotes],
    market: Market,
    *,
    scales: Scales | None = None,
    interrupt: Callable[[], bool] | None = None,
) -> ImpliedSurface:
    """Fit a surface without butterfly and calendar arbitrage to volatilities, weighted by their deviations.

    Every expiry has an SVI of its own (quasi-explicit calibration), from which an eSSVI across the expiries begins;
    the smiles are that eSSVI with corrections that are as smooth as the quotes allow (`smoothing`), moved as little as
    needed until the absence of arbitrage is proved (`arbitrage`, `repair`). Expiries with less than a day left, whose
    smiles are those of a single jump, are fitted on their own: their quotes would tie the next weeks to hours. An
    expiry that cannot be fitted is passed over, and its status says why.

    Parameters
    ----------
    quotes : sequence of SmileQuotes
        One per expiry, in any order.
    market : Market
        Spot, rate, yield (with what it costs to borrow) and dividends. Its volatility is not used.
    scales : Scales, optional
        The scales of a fit to nearly the same quotes, which then are not estimated again.
    interrupt : callable, optional
        Asked at every iteration; True ends the work.

    Returns
    -------
    ImpliedSurface

    Raises
    ------
    InvalidInputError
        No expiry has a usable quote, an expiry comes twice, or dividends are escrowed or worth the spot.
    NumericalError
        The interrupt came, or the deviations are of too different sizes.
    """
    ordered = sorted(quotes, key=lambda smile: smile.expiry)
    told = Told(f"{len(ordered)} expiries")
    for early, late in pairwise(ordered):
        if early.expiry == late.expiry:
            raise InvalidInputError("expiry", late.expiry, "given once")
    usable = [smile for smile in ordered if smile.expiry > 0.0 and smile.usable.any()]
    if not usable:
        raise InvalidInputError("quotes", told, "some with a usable volatility")
    coordinates = Coordinates(market, usable[-1].expiry)
    smiles = [
        smile for smile in (_read(each, coordinates, interrupt) for each in usable) if smile is not None
    ]
    if not smiles:
        raise InvalidInputError("quotes", told, "some with a strike above the dividends due")
    lasting = [smile for smile in smiles if smile.quotes.expiry >= A_DAY]
    last_day = [smile for smile in smiles if smile.quotes.expiry < A_DAY]
    groups = [group for group in (lasting, last_day) if group]
    backbones = [
        calibrate_essvi([smile.columns for smile in group], _starts(group), interrupt) for group in groups
    ]
    basis = _basis(smiles, [own for backbone in backbones[::-1] for own in backbone])
    group = _fitted(basis, groups[0], backbones[0], scales, None, interrupt)
    if lasting and last_day:
        group = group.after(_fitted(basis, last_day, backbones[1], None, group.variance, interrupt))
    return ImpliedSurface(
        coordinates,
        replace(group.variance, clock=coordinates.clock),
        group.covariance,
        group.by_forward,
        np.array([smile.quotes.forward_error for smile in group.smiles]),
        _statuses(ordered, group),
        group.proof,
        group.scales,
        group.programmes,
    )


@dataclass(frozen=True, slots=True)
class _Group:
    """Smiles that are fitted together, and what is found."""

    smiles: list[_Smile]
    backbone: list[ESSVI]
    variance: TotalVariance
    covariance: Matrix
    by_forward: Matrix
    proof: NoArbitrage
    scales: Scales
    programmes: int

    def after(self, soon: _Group) -> _Group:
        """Return both groups as one, the other the earlier; this one alone where that has no proof."""
        if not soon.proof.holds:
            return self
        variance = joined(soon.variance, self.variance)
        return replace(
            self,
            smiles=soon.smiles + self.smiles,
            backbone=soon.backbone + self.backbone,
            variance=variance,
            covariance=block_diag(soon.covariance, self.covariance),
            by_forward=block_diag(soon.by_forward, self.by_forward),
            proof=prove(variance),
        )


def _basis(smiles: Sequence[_Smile], backbone: Sequence[ESSVI]) -> SmileBasis:
    """Return the splines that reach as far as all quotes do."""
    z = [smile.x / math.sqrt(own.theta) for smile, own in zip(smiles, backbone, strict=True)]
    return SmileBasis.covering(min(float(each[0]) for each in z), max(float(each[-1]) for each in z))


def _fitted(
    basis: SmileBasis,
    smiles: list[_Smile],
    backbone: list[ESSVI],
    scales: Scales | None,
    later: TotalVariance | None,
    interrupt: Callable[[], bool] | None,
) -> _Group:
    """Return the group of smiles without arbitrage, nor with those that are later and given."""
    posterior = _smoothed(basis, smiles, backbone, scales, interrupt)
    found = without_arbitrage(posterior, later, interrupt)
    shifts = [smile.by_forward / own[2] for smile, own in zip(smiles, posterior.problem.smiles, strict=True)]
    errors = np.array([smile.quotes.forward_error for smile in smiles])
    return _Group(
        smiles,
        backbone,
        found.variance,
        posterior.covariance,
        posterior.responses(shifts) * errors,
        found.proof,
        posterior.scales,
        found.programmes,
    )


def _read(
    quotes: SmileQuotes, coordinates: Coordinates, interrupt: Callable[[], bool] | None
) -> _Smile | None:
    """Return the usable quotes of an expiry in the surface's coordinate; none where there is none."""
    check_interrupt(interrupt)
    keep = np.flatnonzero(quotes.usable)
    strike, volatility = quotes.strike[keep], quotes.volatility[keep]
    variance, by_volatility = coordinates.variance(volatility, strike, quotes.expiry)
    x = coordinates.x(strike, quotes.expiry)
    deviation = by_volatility * quotes.deviation[keep]
    sound = np.isfinite(x) & np.isfinite(variance) & (deviation > 0.0) & np.isfinite(deviation)
    if not sound.any():
        return None
    if quotes.expiry < A_DAY:
        near = variance[sound][np.argmin(np.abs(x[sound]))]
        sound &= np.abs(x) <= FARTHEST_OF_A_DAY * math.sqrt(near)
    order = np.argsort(x[sound], kind="stable")
    by_forward = by_volatility * quotes.by_forward[keep]  # type: ignore[index]
    x, variance, deviation, by_forward = (
        column[sound][order] for column in (x, variance, deviation, by_forward)
    )
    deviation = np.maximum(deviation, SMALLEST * np.median(deviation))
    svi = calibrate_svi(x, variance, deviation) if np.unique(x).size >= FEWEST_QUOTES else None
    return _Smile(quotes, x, variance, deviation, by_forward, svi)


def _starts(smiles: Sequence[_Smile]) -> list[ESSVI]:
    """Return where the search of the backbone begins: level, slope and bend of SVI at the money."""
    found: list[ESSVI] = []
    for smile in smiles:
        usual = found[-1].psi / math.sqrt(found[-1].theta) if found else 2.0 * USUAL_SLOPE
        if smile.svi is None:
            near = int(np.argmin(np.abs(smile.x)))
            theta = float(smile.variance[near])
            found.append(ESSVI(theta, *(2 * [0.5 * usual * math.sqrt(theta)])))
            continue
        money = np.array([0.0])
        theta = max(float(smile.svi.at(money)[0]), 1e-8)
        slope = float(smile.svi.slope(money)[0])
        reach = 0.1 * math.sqrt(theta)
        low, high = smile.svi.slope(np.array([-reach, reach]))
        bend = max(float(high - low) / (2.0 * reach), 0.0)
        psi = max(math.sqrt(2.0 * theta * bend + slope**2), 1.2 * abs(slope), 0.1 * math.sqrt(theta))
        found.append(ESSVI(theta, 0.5 * (psi - slope), 0.5 * (psi + slope)))
    return found


def _smoothed(
    basis: SmileBasis,
    smiles: Sequence[_Smile],
    backbone: Sequence[ESSVI],
    scales: Scales | None,
    interrupt: Callable[[], bool] | None,
) -> Posterior:
    """Return the most probable smiles, quotes far away from them having lost weight."""
    expiries = np.array([smile.quotes.expiry for smile in smiles])
    problem = SmoothingProblem(basis, expiries, backbone, [smile.columns for smile in smiles])
    posterior = Posterior(problem, problem.most_likely(None, interrupt) if scales is None else scales)
    loss = [np.ones(smile.x.size) for smile in smiles]
    for _ in range(REWEIGHTINGS):
        noise = posterior.scales.noise
        stated = [np.abs(r) * noise * lost for r, lost in zip(posterior.residuals(), loss, strict=True)]
        usual = min(noise, GAUSSIAN * float(np.median(np.concatenate(stated))))
        limit = max(FARTHEST * usual, NEGLIGIBLE)
        loss = [np.maximum(each / limit, 1.0) ** 2 for each in stated]
        if all(float(lost.max()) <= 1.0 for lost in loss):
            break
        columns = [
            (smile.x, smile.variance, smile.deviation * lost)
            for smile, lost in zip(smiles, loss, strict=True)
        ]
        weighted = replace(problem, smiles=columns)
        found = weighted.most_likely(posterior.scales, interrupt) if scales is None else scales
        posterior = Posterior(weighted, found)
    return posterior


def _statuses(ordered: Sequence[SmileQuotes], group: _Group) -> tuple[ExpiryFit, ...]:
    """Return what was fitted to each expiry, in their order."""
    fitted = {id(smile.quotes): i for i, smile in enumerate(group.smiles)}
    found = []
    for quotes in ordered:
        i = fitted.get(id(quotes))
        if i is None:
            sound = quotes.expiry < A_DAY and quotes.usable.any()
            message = LAST_DAY_ABOVE if sound else "no quote with a volatility and a deviation above 0"
            found.append(ExpiryFit(quotes.expiry, "invalid_input", message, 0, quotes.forward))
            continue
        smile = group.smiles[i]
        rest = (smile.variance - group.variance.smile(i, smile.x).value) / smile.deviation
        found.append(
            ExpiryFit(
                quotes.expiry,
                "thin" if smile.problem else "ok",
                smile.problem,
                smile.x.size,
                quotes.forward,
                float(smile.x[0]),
                float(smile.x[-1]),
                float(np.sqrt(np.mean(rest**2))),
                smile.svi,
                group.backbone[i],
            )
        )
    return tuple(found)
