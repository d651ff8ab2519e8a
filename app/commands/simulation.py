"""A simulated model as people meet it: named columns over one axis, and events."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from pricing_core.arrays import Matrix, Vector
from pricing_core.lcs import Event, Trajectory
from pricing_core.models.trajectory import ModelTrajectory, Pieces

if TYPE_CHECKING:
    from matplotlib.figure import Figure

CURVE_POINTS = 1_500  # Number of points of a curve in a picture.
# Share of the largest number below which one is shown as zero, or as no jump.
ROUNDING = 1e-13


@dataclass(frozen=True, slots=True, eq=False)
class Columns:
    """Quantities of one kind: states, multipliers, slacks.

    Parameters
    ----------
    symbol : str
        The key in JSON.
    title : str
        Title in pictures.
    names : tuple of str
    values : Matrix, shape (m, len(names))
    """

    symbol: str
    title: str
    names: tuple[str, ...]
    values: Matrix


@dataclass(frozen=True, slots=True, eq=False)
class Samples:
    """Columns at the same points of an axis; a jump is two rows with equal points.

    Parameters
    ----------
    axis : str
        Its key in JSON.
    points : Vector, shape (m,)
    columns : tuple of Columns
    unit : str
        Of the axis, where the model has units; otherwise it is in those of the model file.
    """

    axis: str
    points: Vector
    columns: tuple[Columns, ...]
    unit: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class Modes:
    """What the modes of events mean.

    Parameters
    ----------
    names : tuple of str
        Names of the slacks; or, where a mode says which pieces the elements of a model are on, of the elements.
    pieces : tuple of (before, after), optional
        For each event the number of each element's piece.
    piece_names : tuple of str
        By number; the numbers themselves where there are none.
    """

    names: tuple[str, ...]
    pieces: tuple[tuple[Pieces | None, Pieces | None], ...] | None = None
    piece_names: tuple[str, ...] = ()

    def in_words(self, mode: tuple[int, ...]) -> str:
        """Return the slacks that vanish in a mode, or the piece of each element.

        Examples
        --------
        >>> Modes(("y1", "y2")).in_words((1,))
        'y2'
        >>> Modes(("u1",), (((0,), (1,)),), ("upper", "slides", "lower")).in_words((1,))
        'u1 slides'
        """
        if self.pieces is None:
            return " ".join(self.names[i] for i in mode) or "-"
        words = [self.piece_names[i] if self.piece_names else f"on {i}" for i in mode]
        return ", ".join(f"{name} {word}" for name, word in zip(self.names, words, strict=True))


@dataclass(frozen=True, slots=True, eq=False)
class Simulation:
    """What `pricing simulate` prints, writes and draws.

    Parameters
    ----------
    headline : str
        How the run ended, in a line.
    samples : Samples
        The rows to report.
    curves : Samples
        The same, as finely as a picture wants it.
    events : tuple of Event
    state_names : tuple of str
        Names of the states in events.
    modes : Modes
    facts : mapping
        Status, scheme, counters.
    picture : function, optional
        Draws the model's own picture, in the place of the curves.
    model : str
        Name of the model, as in its file.
    """

    headline: str
    samples: Samples
    curves: Samples
    events: tuple[Event, ...]
    state_names: tuple[str, ...]
    modes: Modes
    facts: Mapping[str, Any]
    picture: "Callable[[], Figure] | None" = None
    model: str = ""


def of_trajectory(
    trajectory: Trajectory,
    *,
    states: Sequence[str] | None = None,
    multipliers: Sequence[str] | None = None,
    slacks: Sequence[str] | None = None,
) -> Simulation:
    """Return the simulation of a trajectory; without names the columns are x1, ..., u1, ..., y1, ...."""
    names = tuple(states or numbered("x", trajectory.x.shape[1]))
    u = tuple(multipliers or numbered("u", trajectory.u.shape[1]))
    y = tuple(slacks or numbered("y", trajectory.y.shape[1]))

    def samples(run: Trajectory) -> Samples:
        columns = (
            Columns("x", "state", names, run.x),
            Columns("u", "multiplier", u, run.u),
            Columns("y", "slack", y, run.y),
        )
        return Samples("t", run.t, columns)

    return of_samples(
        trajectory, samples(trajectory), samples(trajectory.refined(CURVE_POINTS)), names, Modes(y)
    )


def of_model(run: ModelTrajectory, titles: tuple[str, str], *, modes: Modes | None = None) -> Simulation:
    """Return the simulation of a model in its own variables.

    Parameters
    ----------
    run : ModelTrajectory
    titles : (str, str)
        Titles of u and y in pictures.
    modes : Modes, optional
        The number of each element's piece where missing.
    """
    states, count = numbered("x", run.x.shape[1]), run.u.shape[1]
    modes = modes or Modes(numbered("u", count), run.pieces)

    def samples(run: ModelTrajectory) -> Samples:
        columns = (
            Columns("x", "state", states, run.x),
            Columns("u", titles[0], numbered("u", count), run.u),
            Columns("y", titles[1], numbered("y", count), run.y),
        )
        return Samples("t", run.t, columns)

    return of_samples(run.lcs, samples(run), samples(run.refined(CURVE_POINTS)), states, modes)


def of_samples(
    trajectory: Trajectory, samples: Samples, curves: Samples, states: tuple[str, ...], modes: Modes
) -> Simulation:
    """Return the simulation with the events and counters of a trajectory."""
    count = len(trajectory.events)
    return Simulation(
        headline=(
            f"{trajectory.status} ({trajectory.scheme}): "
            f"{trajectory.accepted} steps, {count} event{'s' * (count != 1)}"
        ),
        samples=samples,
        curves=curves,
        events=trajectory.events,
        state_names=states,
        modes=modes,
        facts={
            "status": trajectory.status,
            "scheme": trajectory.scheme,
            "accepted": trajectory.accepted,
            "rejected": trajectory.rejected,
            "forced": trajectory.forced,
        },
    )


def numbered(letter: str, count: int) -> tuple[str, ...]:
    """Return x1, x2, ....

    Examples
    --------
    >>> numbered("x", 3)
    ('x1', 'x2', 'x3')
    """
    return tuple(f"{letter}{i + 1}" for i in range(count))
