"""The animation of a simulation: its scene beside its curves, with a line at the present time."""

from typing import BinaryIO

import numpy as np

from app.commands.simulation import Orbit, Scene, Simulation
from app.commands.simulation_plots import (
    COLOURS,
    TITLES,
    Legend,
    draw_curves,
    draw_orbit,
    panels_of,
    rows_of,
)
from pricing_core.arrays import Vector
from pricing_core.errors import InvalidInputError, Told
from pricing_core.extras import needs_extra

with needs_extra("plot"):
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from PIL import Image

FRAMES, FRAMES_A_SECOND = 120, 20
SIZE, DOTS_PER_INCH = (11.0, 5.6), 80
SMALL = Legend(7.0, 6, 6)
PANELS = 3  # beside the scene, one for each kind of quantity


class OrbitScene:
    """The phase plane of two states, with a point that moves along it."""

    def __init__(self, orbit: Orbit) -> None:
        self._orbit = orbit

    def prepare(self, axes: Axes) -> None:
        """Draw the orbit."""
        draw_orbit(axes, self._orbit)
        (self._point,) = axes.plot([], [], "o", color=COLOURS[1], markersize=9)

    def show(self, time: float) -> list[Artist]:
        """Move the point to where it is at a time."""
        x = [interpolated(self._orbit.points, column, time) for column in self._orbit.values.T]
        self._point.set_data([x[0]], [x[1]])
        return [self._point]


def animate_simulation(simulation: Simulation, file: BinaryIO, *, frames: int = FRAMES) -> None:
    """Write an animation as a GIF image that repeats: the whole run in six seconds.

    Parameters
    ----------
    file : BinaryIO
        Open for writing.
    frames : int

    Raises
    ------
    InvalidInputError
        There is nothing to show beside the curves: no scene, and not two states.
    """
    scene = scene_of(simulation)
    points = simulation.curves.points
    figure = Figure(figsize=SIZE, dpi=DOTS_PER_INCH, layout="constrained")
    canvas = FigureCanvasAgg(figure)
    figure.suptitle(TITLES.get(simulation.model, "Simulation"), fontsize=11)
    left, right = figure.subfigures(1, 2, width_ratios=[1.0, 1.1], squeeze=False)[0]
    stage = left.add_subplot()
    scene.prepare(stage)
    kinds = simulation.curves.columns
    panels = [panels_of(columns, kinds)[0] for columns in kinds if columns.names][:PANELS]
    heights = [1.0] * len(panels) + (
        [] if simulation.band is None else [0.15 + 0.14 * rows_of(simulation.band, SMALL)]
    )
    grid = right.add_gridspec(len(heights), 1, height_ratios=heights)
    column = draw_curves(right, [grid[i] for i in range(len(heights))], simulation, panels, SMALL)
    cursors = [axes.axvline(points[0], color="black", linewidth=1.0) for axes in column]
    clock = left.text(0.02, 0.02, "", fontsize=10)
    moving: list[Artist] = [*scene.show(float(points[0])), *cursors, clock]
    for artist in moving:
        artist.set_animated(True)
    canvas.draw()  # type: ignore[no-untyped-call]
    still = canvas.copy_from_bbox(figure.bbox)  # type: ignore[no-untyped-call]
    unit = simulation.curves.unit
    images = []
    for time in np.linspace(points[0], points[-1], frames).tolist():
        canvas.restore_region(still)  # type: ignore[no-untyped-call]
        scene.show(time)
        for cursor in cursors:
            cursor.set_xdata([time, time])
        clock.set_text(f"t = {time:.4g} {unit}".rstrip())
        for artist in moving:
            figure.draw_artist(artist)
        pixels = np.array(canvas.buffer_rgba())  # type: ignore[no-untyped-call]
        images.append(Image.fromarray(pixels[:, :, :3]))
    palette = images[len(images) // 2].quantize(256)
    first, *rest = [image.quantize(palette=palette, dither=Image.Dither.NONE) for image in images]
    first.save(
        file,
        format="GIF",
        save_all=True,
        append_images=rest,
        duration=1000 // FRAMES_A_SECOND,
        loop=0,
    )


def scene_of(simulation: Simulation) -> Scene:
    """Return the scene of an animation, or raise InvalidInputError where the model has none."""
    if simulation.scene is not None:
        return simulation.scene()
    if simulation.orbit is not None and simulation.curves.points.size > 1:
        return OrbitScene(simulation.orbit)
    raise InvalidInputError(
        "animate", Told(f"a {simulation.model} model"), "for a circuit, a mechanical system, or two states"
    )


def interpolated(points: Vector, values: Vector, time: float) -> float:
    """Return a value at a time, right-continuous where a point comes twice.

    Examples
    --------
    >>> interpolated(np.array([0.0, 1.0, 1.0, 2.0]), np.array([0.0, 1.0, 5.0, 6.0]), 1.0)
    5.0
    """
    right = int(np.clip(np.searchsorted(points, time, side="right"), 1, points.size - 1))
    left = right - 1
    width = points[right] - points[left]
    weight = (time - points[left]) / width if width > 0.0 else 1.0
    return float((1.0 - weight) * values[left] + weight * values[right])
