"""The result of a simulation in the form in which it is printed and drawn: named columns over one axis, and events."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

from app.commands.labels import Labels, check_different
from app.commands.mode_band import Band, of_active_pairs, of_pieces
from pricing_core.arrays import Matrix, Vector
from pricing_core.lcs import Event, Trajectory
from pricing_core.models.trajectory import ModelTrajectory, Pieces

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
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
    units : tuple of str
        One for each name, empty where it is not known; or none at all.
    """

    symbol: str
    title: str
    names: tuple[str, ...]
    values: Matrix
    units: tuple[str, ...] = ()


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
        Unit of the axis, where the model has units; otherwise it is in those of the model file.
    """

    axis: str
    points: Vector
    columns: tuple[Columns, ...]
    unit: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class Orbit:
    """Two states along a run, at enough points for a smooth curve.

    Parameters
    ----------
    names, units : (str, str)
    points : Vector, shape (m,)
        The times; a jump is two rows with equal times.
    values : Matrix, shape (m, 2)
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    points: Vector
    values: Matrix


class Scene(Protocol):
    """The part of an animation beside the curves, in axes of its own."""

    def prepare(self, axes: "Axes") -> None:
        """Draw what does not move, and set the limits."""

    def show(self, time: float) -> "list[Artist]":
        """Move the rest to where it is at a time, and return it."""


@dataclass(frozen=True, slots=True, eq=False)
class Modes:
    """The meaning of the modes of events, in words.

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
    """Everything that `pricing simulate` prints, writes and draws.

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
    band : Band, optional
        The modes over time.
    orbit : Orbit, optional
        The phase plane, where there are two states.
    scene : function, optional
        Returns what an animation shows beside the curves.
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
    band: Band | None = None
    orbit: Orbit | None = None
    scene: Callable[[], Scene] | None = None


def of_trajectory(trajectory: Trajectory, labels: Labels | None = None) -> Simulation:
    """Return the simulation of a trajectory; without names the columns are x1, ..., u1, ..., y1, ...."""
    return of_run(
        trajectory,
        trajectory,
        (("x", "state"), ("u", "multiplier"), ("y", "slack")),
        labels,
        lambda names: Modes(names["y"]),
    )


def of_model(
    run: ModelTrajectory,
    titles: tuple[str, str],
    labels: Labels | None = None,
    *,
    elements: str = "u",
    piece_names: tuple[str, ...] | None = (),
) -> Simulation:
    """Return the simulation of a model in its own variables.

    Parameters
    ----------
    run : ModelTrajectory
    titles : (str, str)
        Titles of u and y in pictures.
    labels : Labels, optional
    elements : {"u", "y"}
        Whose names the elements have.
    piece_names : tuple of str, optional
        Words for the pieces that elements are on: numbers where it is empty. None: a mode is where y vanishes.
    """
    return of_run(
        run.lcs,
        run,
        (("x", "state"), ("u", titles[0]), ("y", titles[1])),
        labels,
        lambda names: Modes(names[elements], None if piece_names is None else run.pieces, piece_names or ()),
    )


def of_run(
    trajectory: Trajectory,
    run: Trajectory | ModelTrajectory,
    kinds: Sequence[tuple[str, str]],
    labels: Labels | None,
    modes: Callable[[Mapping[str, tuple[str, ...]]], Modes],
) -> Simulation:
    """Return the simulation of a run whose attributes are the quantities, by symbol and title."""
    said = labels or Labels({}, {})
    counts = {symbol: getattr(run, symbol).shape[1] for symbol, _ in kinds}
    names = {symbol: said.names_of(symbol, count) for symbol, count in counts.items()}
    check_different([name for part in names.values() for name in part])

    def samples(at: Trajectory | ModelTrajectory) -> Samples:
        columns = (
            Columns(symbol, title, names[symbol], getattr(at, symbol), said.units_of(symbol, counts[symbol]))
            for symbol, title in kinds
        )
        return Samples("t", at.t, tuple(columns), said.time)

    return of_samples(trajectory, samples(run), samples(run.refined(CURVE_POINTS)), names["x"], modes(names))


def of_samples(
    trajectory: Trajectory,
    samples: Samples,
    curves: Samples,
    states: tuple[str, ...],
    modes: Modes,
    band: Band | None = None,
) -> Simulation:
    """Return the simulation with the events and counters of a trajectory; the band is that of the modes if missing."""
    count = len(trajectory.events)
    if band is None and modes.pieces is None:
        band = of_active_pairs(trajectory, modes.names, "= 0")
    elif band is None and modes.pieces is not None:
        band = of_pieces(trajectory, modes.names, modes.pieces, modes.piece_names)
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
        band=band,
        orbit=_orbit(trajectory, curves, states),
    )


def _orbit(trajectory: Trajectory, curves: Samples, states: tuple[str, ...]) -> Orbit | None:
    if len(states) != 2:
        return None
    units = {
        name: unit for kind in curves.columns for name, unit in zip(kind.names, kind.units, strict=False)
    }
    run = trajectory.refined(CURVE_POINTS)
    return Orbit(states, tuple(units.get(name, "") for name in states), run.t, run.x)
