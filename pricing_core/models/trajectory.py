"""What the simulation of a model reports: in the model's own variables, with the run of its LCS behind them."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Literal, NamedTuple, TypeAlias

from numpy.typing import ArrayLike

from pricing_core.arrays import IndexSet, Matrix, Vector
from pricing_core.lcs import Event, Trajectory

Pieces: TypeAlias = tuple[int, ...]
External: TypeAlias = Callable[[Matrix, Matrix], tuple[Matrix, Matrix]]


class Switch(NamedTuple):
    """A change of pieces: which piece each element is on before and after, None where the run does not tell."""

    time: float
    before: Pieces | None
    after: Pieces | None


@dataclass(frozen=True, slots=True, eq=False)
class ModelTrajectory:
    """x(t), and the inputs u and outputs y of the linear system as its elements connect them.

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
    lcs : Trajectory
        The run of the linear complementarity system that was simulated, with its own u and y.
    external : callable
        Function from its u and y to those of the model.
    pieces : callable
        Function from a mode of that system to the pieces that the elements are on.
    """

    t: Vector
    x: Matrix
    u: Matrix
    y: Matrix
    switches: tuple[Switch, ...]
    lcs: Trajectory
    external: External = field(repr=False)
    pieces: Callable[[IndexSet], Pieces] = field(repr=False)

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

    def refined(self, count: int) -> "ModelTrajectory":
        """Return the run at `count` times or somewhat more, as `pricing_core.lcs.Trajectory.refined` does."""
        if not self.lcs.flows:
            return self
        run = self.lcs.refined(count)
        u, y = self.external(run.u, run.y)
        return replace(self, t=run.t, x=run.x, u=u, y=y, lcs=run)


def of_lcs(run: Trajectory, external: External, pieces: Callable[[IndexSet], Pieces]) -> ModelTrajectory:
    """Return the run of a complementarity system in the variables of the model, given the pieces of a mode."""
    u, y = external(run.u, run.y)
    return ModelTrajectory(run.t, run.x, u, y, _switches(run.events, pieces), run, external, pieces)


def as_they_are(u: Matrix, y: Matrix) -> tuple[Matrix, Matrix]:
    """Return the inputs and outputs of a complementarity system that are those of the model."""
    return u, y


def _switches(events: tuple[Event, ...], pieces: Callable[[IndexSet], Pieces]) -> tuple[Switch, ...]:
    """Return the events at which pieces change, given the pieces of a mode."""
    switches = []
    for event in events:
        before, after = (
            None if mode is None else pieces(mode) for mode in (event.mode_before, event.mode_after)
        )
        if before != after:
            switches.append(Switch(event.time, before, after))
    return tuple(switches)
