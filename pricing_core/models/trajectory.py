"""What the simulation of a model reports: in the model's own variables, with the run of its LCS behind them."""

from __future__ import annotations

import itertools
from bisect import bisect_left, bisect_right
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Literal, NamedTuple, Protocol, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from pricing_core.arrays import Matrix, Vector
from pricing_core.lcs import Event, Trajectory
from pricing_core.lcs.flow import Flow, evaluate_each
from pricing_core.lcs.run_table import named_columns, table_of

if TYPE_CHECKING:
    import pyarrow

Pieces: TypeAlias = tuple[int, ...]
External: TypeAlias = Callable[[Matrix, Matrix, Matrix], tuple[Matrix, Matrix]]

ALONG = np.array([0.0, 0.25, 0.5, 0.75, 1.0])  # places of a flow at which its pieces are looked at
AT_ONCE = 1e-6  # of a step: what a flow without length is given for it


class Switch(NamedTuple):
    """A change of pieces: which piece each element is on before and after, None where the run does not tell."""

    time: float
    before: Pieces | None
    after: Pieces | None


class Reading(Protocol):
    """How a model reads the run of its complementarity system."""

    def external(self, x: Matrix, u: Matrix, y: Matrix) -> tuple[Matrix, Matrix]:
        """Return the model's inputs and outputs from the system's states, inputs and outputs at m times."""

    def pieces(self, flows: tuple[Flow, ...]) -> list[Pieces]:
        """Return the pieces that the elements are on in each flow."""


@dataclass(frozen=True, slots=True, eq=False)
class ModelTrajectory:
    """The state x(t), and the inputs u and outputs y of the linear system as its elements connect them.

    Calling it gives x(t), as `pricing_core.lcs.Trajectory` does.

    Parameters
    ----------
    t : Vector, shape (m,)
    x : Matrix, shape (m, n)
    u : Matrix, shape (m, k)
        What the elements give: relay outputs, values of characteristics.
    y : Matrix, shape (m, k)
        What they are given: relay inputs, arguments of characteristics.
    switches : tuple of Switch
        The events at which pieces change.
    lcs : Trajectory
        The run of the linear complementarity system that was simulated, with its own u and y.
    pieces : tuple of (before, after)
        For each event the pieces that the elements are on before and after it; None where the run does not tell.
    unique : True or None
        True where the state is proved to have no other continuation from anywhere; None where that is not known.
    external : callable
        Function from x, and from the system's u and y, to those of the model.
    """

    t: Vector
    x: Matrix
    u: Matrix
    y: Matrix
    switches: tuple[Switch, ...]
    lcs: Trajectory
    pieces: tuple[tuple[Pieces | None, Pieces | None], ...]
    unique: Literal[True] | None
    external: External = field(repr=False)

    @property
    def events(self) -> tuple[Event, ...]:
        """The events of the run; their modes are those of the complementarity system."""
        return self.lcs.events

    @property
    def status(self) -> Literal["finished", "interrupted"]:
        """Whether the run reached its end."""
        return self.lcs.status

    def __call__(self, t: ArrayLike) -> Matrix:
        """Return x(t), shape (n,) for a scalar, (len(t), n) for a vector."""
        return self.lcs(t)

    def to_table(
        self,
        *,
        states: Sequence[str] | None = None,
        inputs: Sequence[str] | None = None,
        outputs: Sequence[str] | None = None,
    ) -> pyarrow.Table:
        """Return the run as a `pyarrow.Table` of m rows: t, and a column for each component of x, u and y.

        Parameters
        ----------
        states, inputs, outputs : sequence of str, optional
            Names of the columns; x1, ..., u1, ..., y1, ... where missing.

        Raises
        ------
        InvalidInputError
            Names that are not one for each column, or not different.
        MissingExtraError
            pyarrow, of the extra "batch", is not installed.
        """
        parts = [
            ("states", "x", self.x, states),
            ("inputs", "u", self.u, inputs),
            ("outputs", "y", self.y, outputs),
        ]
        return table_of(named_columns(self.t, parts))

    def refined(self, count: int) -> ModelTrajectory:
        """Return the run at `count` times or somewhat more, as `pricing_core.lcs.Trajectory.refined` does."""
        if not self.lcs.flows:
            return self
        run = self.lcs.refined(count)
        u, y = self.external(run.x, run.u, run.y)
        return replace(self, t=run.t, x=run.x, u=u, y=y, lcs=run)


def of_lcs(run: Trajectory, reading: Reading, unique: Literal[True] | None) -> ModelTrajectory:
    """Return the run of a complementarity system in the variables of the model."""
    u, y = reading.external(run.x, run.u, run.y)
    pieces = tuple(_around_events(run, reading)) if run.flows else ((None, None),) * len(run.events)
    switches = tuple(
        Switch(event.time, *around)
        for event, around in zip(run.events, pieces, strict=True)
        if around[0] != around[1]
    )
    return ModelTrajectory(run.t, run.x, u, y, switches, run, pieces, unique, reading.external)


def sampled(flows: tuple[Flow, ...]) -> tuple[Matrix, Matrix, Matrix]:
    """Return x, u and y at the places `ALONG` of all flows, one after the other, u being the least."""
    lengths = [flow.end - flow.start or AT_ONCE * flow.dynamics.step / flow.form.units.rate for flow in flows]
    times = [flow.start + ALONG * length for flow, length in zip(flows, lengths, strict=True)]
    return evaluate_each(flows, times)[1:]


def _around_events(run: Trajectory, reading: Reading) -> list[tuple[Pieces | None, Pieces | None]]:
    """Return the pieces before and after each event: those of the flows that meet there."""
    flows = tuple(
        flow
        for flow, following in itertools.zip_longest(run.flows, run.flows[1:])
        if following is None or flow.start < flow.end
    )
    starts, found = [flow.start for flow in flows], reading.pieces(flows)
    around: list[tuple[Pieces | None, Pieces | None]] = []
    last: Pieces | None = None
    for event in run.events:
        place = bisect_left(starts, event.time) - 1
        before = last or (found[place] if place >= 0 else None)
        last = found[bisect_right(starts, event.time) - 1]
        around.append((before, last))
    return around
