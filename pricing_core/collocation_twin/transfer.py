"""From the value just after an event to the profile just before it: the spot's drop, then the holder's choice."""

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from pricing_core.arrays import Vector
from pricing_core.collocation_twin.held import Held
from pricing_core.collocation_twin.panels import Feature, Fineness, gauss_nodes, panels
from pricing_core.collocation_twin.profile import Piece, Profile
from pricing_core.collocation_twin.stretch import Stretch
from pricing_core.roots import find_root

SCANNED = 48  # intervals in which the holder's choice may change
INDIFFERENT = 1e-14
SAME_END = 1e-12


class Transferred(NamedTuple):
    """The profile at a stretch's end, and what it shows.

    contact: the end of the contact set that reaches to the far side (0 for a put, infinity for a call), -inf or inf
    without one; edges: ends of all exercised intervals.
    """

    profile: Profile
    contact: float
    edges: tuple[float, ...]
    features: tuple[Feature, ...]
    at_zero: float


def at_expiry(stretch: Stretch) -> Transferred:
    """Return the payoff, after the dividends of that time, or what exercise just before them brings."""
    sign, keep, amount = stretch.sign, 1.0 - stretch.fraction, stretch.amount
    at_zero = 1.0 if sign > 0.0 else 0.0
    pieces = [Piece(-math.inf, math.inf, at_zero, 0.0)]
    if keep > 0.0:
        strike, gone = _log((1.0 + amount) / keep), _log(amount / keep)
        inside = (
            Piece(gone, strike, 1.0 + amount, -keep)
            if sign > 0.0
            else Piece(strike, math.inf, -1.0 - amount, keep)
        )
        zero = Piece(strike, math.inf, 0.0, 0.0) if sign > 0.0 else Piece(-math.inf, strike, 0.0, 0.0)
        pieces = [inside, zero]
        if sign > 0.0 and gone > -math.inf:
            pieces.insert(0, Piece(-math.inf, gone, 1.0, 0.0))
    kinks = [end for piece in pieces for end in (piece.lower, piece.upper) if math.isfinite(end)]
    exercised: list[tuple[float, float]] = []
    if stretch.exercise_at_end:
        pieces, exercised = _choose(pieces, stretch)
    contact, edges = _contact(exercised, stretch.sign)
    features = tuple(Feature(x, 0.0) for x in sorted({*kinks, *edges}))
    empty = np.zeros(0)
    pieces = [piece for piece in pieces if piece.constant or piece.slope]
    return Transferred(Profile(tuple(pieces), empty, empty), contact, edges, features, at_zero)


@dataclass(frozen=True, slots=True)
class _Drop:
    """x after the event as a function of x before it."""

    keep: float
    amount: float

    def after(self, x: Vector) -> Vector:
        return np.log(np.maximum(self.keep * np.exp(x) - self.amount, 1e-300))

    def before(self, x: float) -> float:
        return x if self.amount == 0.0 and self.keep == 1.0 else _log((math.exp(x) + self.amount) / self.keep)


def before_event(
    later: Held,
    stretch: Stretch,
    features: tuple[Feature, ...],
    ends: tuple[float, float],
    fineness: Fineness,
) -> Transferred:
    """Return the profile at the end of `stretch`, before its event.

    Parameters
    ----------
    later : Held
        The stretch after the event.
    features : tuple of Feature
        Places where the value after the event is not smooth.
    ends : (float, float)
        The interval of x that matters; beyond it the value is continued linearly in the spot.
    """
    if stretch.fraction >= 1.0:
        return _worthless(later, stretch)
    drop = _Drop(1.0 - stretch.fraction, stretch.amount)
    sign, edge = stretch.sign, drop.before(later.edge) if later.boundary is not None else math.nan
    if not ends[0] < edge < ends[1]:  # a contact set that far away is continued like what is held
        edge = math.nan
    gone = stretch.gone()
    lower, upper = gone, math.inf
    pieces = [Piece(-math.inf, gone, later.at_zero, 0.0)] if gone > -math.inf else []
    if not math.isnan(edge):
        constant, slope = sign * (later.strike + drop.amount), -sign * drop.keep
        pieces.append(
            Piece(lower, edge, constant, slope) if sign > 0.0 else Piece(edge, math.inf, constant, slope)
        )
        lower, upper = (edge, upper) if sign > 0.0 else (lower, edge)
    moved = _moved(features, drop) + tuple(Feature(x, 0.0) for x in (edge,) if math.isfinite(x))
    if gone > ends[0]:
        moved += (Feature(gone, 0.25 * fineness.spread),)
    inside = max(lower, ends[0]), min(upper, ends[1])
    held = [inside] if inside[0] < inside[1] else []
    exercised: list[tuple[float, float]] = []
    contact = -sign * math.inf
    edges: tuple[float, ...] = ()
    if stretch.exercise_at_end:
        if (
            stretch.is_continuous
            and not math.isnan(edge)
            and abs(later.strike - stretch.strike(0.0)) < SAME_END
        ):
            contact, edges = edge, (edge,)
        else:
            pieces, exercised = _choose(pieces, stretch)
            held, more = _exercise_held(later, drop, stretch, held, (lower, upper))
            exercised = _joined(exercised + more)
            pieces = [p for p in pieces if not _is_paid(p, stretch)]
            pieces += [Piece(a, b, sign * stretch.strike(0.0), -sign) for a, b in exercised]
            contact, edges = _contact(exercised, sign)
            moved += tuple(Feature(x, 0.0) for x in edges)
    cuts = [panel for a, b in held for panel in panels(a, b, moved, fineness)]
    nodes, weights = gauss_nodes(cuts, fineness.points)
    values = later.value(drop.after(nodes))[0] if nodes.size else nodes
    pieces += _tails(later, drop, held, (lower, upper), inside)
    profile = Profile(tuple(pieces), nodes, weights * values)
    return Transferred(profile, contact, edges, moved, _at_zero(later, stretch))


def _at_zero(later: Held, stretch: Stretch) -> float:
    """Return what the option is worth at spot zero, after what its holder may do then."""
    if stretch.exercise_at_end and stretch.sign > 0.0:
        return max(later.at_zero, stretch.strike(0.0))
    return later.at_zero


def _worthless(later: Held, stretch: Stretch) -> Transferred:
    """Return the profile where the whole spot is paid out."""
    pieces = [Piece(-math.inf, math.inf, later.at_zero, 0.0)]
    exercised: list[tuple[float, float]] = []
    if stretch.exercise_at_end:
        pieces, exercised = _choose(pieces, stretch)
    contact, edges = _contact(exercised, stretch.sign)
    empty = np.zeros(0)
    features = tuple(Feature(x, 0.0) for x in edges)
    return Transferred(
        Profile(tuple(pieces), empty, empty), contact, edges, features, _at_zero(later, stretch)
    )


def _log(x: float) -> float:
    return math.log(x) if x > 0.0 else -math.inf


def _moved(features: tuple[Feature, ...], drop: _Drop) -> tuple[Feature, ...]:
    """Return the features where they are before the event; their scales shrink as ln(spot) does."""
    moved = []
    for feature in features:
        spot = math.exp(feature.place)
        moved.append(Feature(drop.before(feature.place), feature.scale * spot / (spot + drop.amount)))
    return tuple(moved)


def _is_paid(piece: Piece, stretch: Stretch) -> bool:
    """Whether the piece is the payoff."""
    return (
        abs(piece.constant - stretch.sign * stretch.strike(0.0)) < SAME_END
        and abs(piece.slope + stretch.sign) < SAME_END
    )


def _choose(pieces: list[Piece], stretch: Stretch) -> tuple[list[Piece], list[tuple[float, float]]]:
    """Return the larger of linear pieces and payoff, and the intervals of the latter."""
    sign, strike = stretch.sign, stretch.strike(0.0)
    chosen: list[Piece] = []
    exercised: list[tuple[float, float]] = []
    for piece in pieces:
        constant, slope = sign * strike - piece.constant, -sign - piece.slope  # what exercise brings more
        crossing = _log(-constant / slope) if slope != 0.0 and -constant / slope > 0.0 else math.nan
        inner = [crossing] if piece.lower + SAME_END < crossing < piece.upper - SAME_END else []
        cuts = [piece.lower, *inner, piece.upper]
        for a, b in pairwise(cuts):
            middle = math.exp(_inside(a, b))
            pays = constant + slope * middle >= -INDIFFERENT and strike * sign - sign * middle > 0.0
            if pays:
                exercised.append((a, b))
                chosen.append(Piece(a, b, sign * strike, -sign))
            else:
                chosen.append(Piece(a, b, piece.constant, piece.slope))
    return chosen, _joined(exercised)


def _inside(a: float, b: float) -> float:
    """Return a place between two, next to the finite one where the other is infinite."""
    if a == -math.inf:
        return b - 1.0 if b < math.inf else 0.0
    return 0.5 * (a + b) if b < math.inf else a + 1.0


def _exercise_held(
    later: Held,
    drop: _Drop,
    stretch: Stretch,
    held: list[tuple[float, float]],
    open_ends: tuple[float, float],
) -> tuple[list[tuple[float, float]], list[tuple[float, float]]]:
    """Split the held interval where the payoff is larger: (held, exercised); its outer ends go to the open ends."""
    if not held:
        return held, []
    (start, stop), strike = held[0], stretch.strike(0.0)

    def above(x: Vector) -> Vector:
        return np.asarray(later.value(drop.after(x))[0] - stretch.sign * (strike - np.exp(x)))

    scanned = np.linspace(start, stop, SCANNED + 1)
    excess = above(scanned)
    changes = np.flatnonzero((excess[1:] > INDIFFERENT) != (excess[:-1] > INDIFFERENT))
    roots = [
        find_root(lambda x: float(above(np.array([x]))[0]), float(scanned[k]), float(scanned[k + 1]))
        for k in changes.tolist()
    ]
    cuts = [start, *roots, stop]
    kept: list[tuple[float, float]] = []
    exercised: list[tuple[float, float]] = []
    for k, (a, b) in enumerate(pairwise(cuts)):
        if float(above(np.array([0.5 * (a + b)]))[0]) > INDIFFERENT:
            kept.append((a, b))
        else:
            exercised.append((a if k else open_ends[0], b if k < len(roots) else open_ends[1]))
    return kept, exercised


def _joined(intervals: list[tuple[float, float]]) -> list[tuple[float, float]]:
    """Return the union of intervals that may touch, in order."""
    joined: list[tuple[float, float]] = []
    for a, b in sorted(intervals):
        if joined and a <= joined[-1][1] + SAME_END:
            joined[-1] = joined[-1][0], max(b, joined[-1][1])
        else:
            joined.append((a, b))
    return joined


def _contact(exercised: list[tuple[float, float]], sign: float) -> tuple[float, tuple[float, ...]]:
    """Return the end of the exercised interval on the far side, and all finite ends."""
    ends = tuple(end for interval in exercised for end in interval if math.isfinite(end))
    contact = -sign * math.inf
    for a, b in exercised:
        if sign > 0.0 and a == -math.inf:
            contact = b
        if sign < 0.0 and b == math.inf:
            contact = a
    return contact, ends


def _tails(
    later: Held,
    drop: _Drop,
    held: list[tuple[float, float]],
    open_ends: tuple[float, float],
    inside: tuple[float, float],
) -> list[Piece]:
    """Return the lines in the spot that continue the value beyond the ends where it is held."""
    tails = []
    if held and held[0][0] == inside[0] > open_ends[0]:
        tails.append(Piece(open_ends[0], inside[0], *_tangent(later, drop, inside[0])))
    if held and held[-1][1] == inside[1] < open_ends[1]:
        tails.append(Piece(inside[1], open_ends[1], *_tangent(later, drop, inside[1])))
    return tails


def _tangent(later: Held, drop: _Drop, x: float) -> tuple[float, float]:
    """Return constant and slope of the tangent at x as a function of the spot."""
    after = drop.after(np.array([x]))
    value, by_x, _ = later.value(after)[:, 0]
    slope = drop.keep * float(by_x) * math.exp(-float(after[0]))
    return float(value) - slope * math.exp(x), slope
