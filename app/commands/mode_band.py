"""The modes of a run as rows of bars: which constraints are active, what each element does, and when."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pricing_core.arrays import Vector
from pricing_core.lcs import Trajectory
from pricing_core.models import ContactTrajectory
from pricing_core.models.trajectory import Pieces

States = NDArray[np.int_]
BLANK = -1  # the state that is not drawn
AT_REST = 1e-9  # share of the largest velocity below which a contact sticks


@dataclass(frozen=True, slots=True, eq=False)
class Band:
    """Rows of states over time, one for each constraint, contact or element.

    Parameters
    ----------
    names : tuple of str
        Names of the r rows.
    edges : Vector, shape (m + 1,)
    states : ndarray of int, shape (m, r)
        Between the edges; `BLANK` where there is nothing to show.
    words : tuple of str
        What the states 0, 1, ... are.
    """

    names: tuple[str, ...]
    edges: Vector
    states: States
    words: tuple[str, ...]

    def bars(self, row: int) -> list[tuple[float, float, int]]:
        """Return start, length and state of each bar of a row, those of equal states joined."""
        column = self.states[:, row]
        begins = np.flatnonzero(np.diff(column, prepend=BLANK - 1))
        ends = np.append(begins[1:], column.size)
        return [
            (float(self.edges[i]), float(self.edges[j] - self.edges[i]), int(column[i]))
            for i, j in zip(begins, ends, strict=True)
            if column[i] != BLANK
        ]

    def words_at(self, time: float) -> list[str]:
        """Return the words that each row shows at a time, an empty text where it shows none."""
        last = len(self.states) - 1
        at = min(max(int(np.searchsorted(self.edges, time, side="right")) - 1, 0), last)
        return ["" if state == BLANK else self.words[state] for state in self.states[at].tolist()]


def of_active_pairs(
    run: Trajectory, names: Sequence[str], word: str, inverted: Sequence[bool] | None = None
) -> Band | None:
    """Return the band of a complementarity system: where y_i = 0, or for inverted pairs where it is not."""
    edges, active = _active(run)
    if edges.size < 2 or not names:
        return None
    shown = active if inverted is None else active ^ np.array(inverted)
    return Band(tuple(names), edges, np.where(shown, 0, BLANK), (word,))


def with_switches(
    run: Trajectory, band: Band | None, names: Sequence[str], positions: Sequence[Sequence[bool]]
) -> Band | None:
    """Return the band with a row for each switch, which tells when it is closed; `positions` are those in each flow."""
    edges, _ = _active(run)
    closed = np.array(positions, dtype=bool)
    if edges.size < 2 or not names or len(closed) != edges.size - 1:
        return band
    if band is None:
        return Band(tuple(names), edges, np.where(closed, 0, BLANK), ("closed",))
    states = np.hstack([np.where(closed, len(band.words), BLANK), band.states])
    return Band((*names, *band.names), edges, states, (*band.words, "closed"))


def of_contacts(run: Trajectory, names: Sequence[str]) -> Band | None:
    """Return the band of contacts: where they touch, with friction whether they stick or slide."""
    if not isinstance(run, ContactTrajectory) or run.friction_force.size == 0:
        return of_active_pairs(run, names, "touches")
    if run.t.size < 2:
        return None
    speed = np.abs(run.slip).reshape(run.t.size, len(names), -1).max(axis=2)
    fastest = max(float(speed.max()), float(np.abs(run.x[:, run.x.shape[1] // 2 :]).max()))
    sliding = speed > AT_REST * fastest
    states = np.where(run.u > 0.0, sliding.astype(int), BLANK)[1:]
    return Band(tuple(names), run.t, states, ("sticks", "slides"))


def of_pieces(
    run: Trajectory,
    names: Sequence[str],
    pieces: Sequence[tuple[Pieces | None, Pieces | None]],
    piece_names: Sequence[str],
) -> Band | None:
    """Return the band of elements on pieces, None where the run does not tell."""
    known = [pair for pair in pieces if pair[0] is not None and pair[1] is not None]
    if not known or len(known) < len(pieces):
        return None
    rows = [known[0][0], *(after for _, after in known)]
    states = np.array(rows)
    words = tuple(piece_names) or tuple(f"piece {i}" for i in range(int(states.max()) + 1))
    edges = np.array([run.t[0], *(event.time for event in run.events), run.t[-1]])
    return Band(tuple(names), edges, states, words)


def _active(run: Trajectory) -> tuple[Vector, NDArray[np.bool_]]:
    """Return edges and which y_i = 0 between them."""
    k = run.y.shape[1]
    if not run.flows:  # a step tells of itself at its end
        return run.t, (run.u > run.y)[1:]
    edges = np.array([*(flow.start for flow in run.flows), run.flows[-1].end])
    active = np.zeros((len(run.flows), k), dtype=np.bool_)
    for row, flow in zip(active, run.flows, strict=True):
        row[[i for i in flow.mode if i < k]] = True
    return edges, active
