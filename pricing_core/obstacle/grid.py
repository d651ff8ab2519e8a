"""The nodes: whole numbers in a coordinate that a smooth map carries to x, with given places on nodes."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from pricing_core.arrays import Vector
from pricing_core.march_settings import MOST_COARSE_CELLS

if TYPE_CHECKING:
    from scipy.interpolate import BSpline

# Cell over the mean one, and the mean over the widest: a spline through uneven ones turns back.
NARROWEST = 0.6
MORE = 1.15  # cells from one attempt to the next
NEWTON_STEPS = 3  # from the table's place to that of the map: each doubles the digits
TABLE = 8  # points of the table for each cell of the coarsest grid


@dataclass(frozen=True, slots=True, eq=False)
class GridMap:
    """x = X(y) for y from 0 to `cells`, of which the whole numbers are the nodes of the coarsest grid.

    Parameters
    ----------
    left, right : float
    cells : int
    spline : BSpline or None
        X; None where it is a straight line.
    """

    left: float
    right: float
    cells: int
    spline: BSpline | None = None

    @property
    def size(self) -> float:
        """The mean width of a cell."""
        return (self.right - self.left) / self.cells

    def place(self, y: Vector, derivative: int = 0) -> Vector:
        """Return X(y), or a derivative of it."""
        if self.spline is not None:
            return np.asarray(self.spline(y, nu=derivative))
        if derivative == 0:
            return self.left + self.size * np.asarray(y)
        return np.full(np.shape(y), self.size if derivative == 1 else 0.0)

    def inverse(self, x: Vector) -> Vector:
        """Return y with X(y) = x; beyond the ends it goes on as a straight line."""
        y = (np.asarray(x) - self.left) / self.size
        if self.spline is None:
            return y
        table, known = _table(self)
        inside = (x >= known[0]) & (x <= known[-1])
        found = np.interp(x, known, table)
        for _ in range(NEWTON_STEPS):
            found = np.clip(found - (self.place(found) - x) / self.place(found, 1), 0.0, self.cells)
        return np.where(inside, found, y)


@lru_cache(maxsize=16)
def _table(of: GridMap) -> tuple[Vector, Vector]:
    """Return numbers y and the places X(y), to begin with where y is looked for."""
    numbers = np.linspace(0.0, of.cells, TABLE * of.cells + 1)
    return numbers, of.place(numbers)


def grid_map(left: float, right: float, cells: int, on_nodes: Vector, fixed: tuple[bool, bool]) -> GridMap:
    """Return a map of [left, right] with given places on whole numbers.

    It has more cells where so few would have to be of very different widths. Where the most cells still have, they are
    even, with none of the places on a node.

    Parameters
    ----------
    cells : int
        At least so many; even.
    on_nodes : Vector, shape (k,)
        Places inside the interval in order. One that lies nearer than a cell to another, or to an end that is fixed,
        is left out.
    fixed : (bool, bool)
        Whether the left and the right end may not be moved; the others move by up to half a cell.
    """
    while True:
        found = _through(left, right, cells, on_nodes, fixed)
        if found.spline is None:
            return found
        widths = np.diff(_table(found)[1]) * TABLE / found.size
        if widths.min() >= NARROWEST and widths.max() <= 1.0 / NARROWEST:
            return found
        if cells >= MOST_COARSE_CELLS:
            return GridMap(left, right, cells)
        cells = min(2 * math.ceil(MORE * cells / 2.0), MOST_COARSE_CELLS)


def _through(left: float, right: float, cells: int, on_nodes: Vector, fixed: tuple[bool, bool]) -> GridMap:
    """Return a smooth map through the places, at the whole numbers nearest to where an even map has them."""
    size = (right - left) / cells
    places, numbers = [left], [0]
    for place in on_nodes:
        number = round((place - left) / size)
        if numbers[-1] < number < cells:
            places.append(float(place))
            numbers.append(number)
    if len(places) == 1:
        return GridMap(left, right, cells)
    if not fixed[0]:  # the ends go with their neighbours
        places[0] = places[1] - size * numbers[1]
    places.append(right if fixed[1] else places[-1] + size * (cells - numbers[-1]))
    numbers.append(cells)
    if len(places) == 3 and not (fixed[0] and fixed[1]):
        slope = (places[-1] - places[0]) / cells
        if np.allclose(places, places[0] + slope * np.array(numbers), rtol=0.0, atol=1e-13 * (right - left)):
            return GridMap(places[0], places[-1], cells)
    from scipy.interpolate import make_interp_spline  # noqa: PLC0415  even grids do without it

    degree = min(5, len(places) - 1)
    spline = make_interp_spline(np.array(numbers, dtype=np.float64), np.array(places), k=degree)
    return GridMap(places[0], places[-1], cells, spline)


@dataclass(frozen=True, slots=True, eq=False)
class Grid:
    """The nodes X(i / refined), i = 0, ..., n - 1, and the derivatives of the map by i.

    Parameters
    ----------
    x, slope, bend : Vector, shape (n,)
        X, X' and X'' at the nodes.
    map : GridMap
    refined : int
        Cells for each cell of the coarsest grid.
    """

    x: Vector
    slope: Vector
    bend: Vector
    map: GridMap
    refined: int

    @classmethod
    def of(cls, chosen: GridMap, refined: int) -> Grid:
        """Return the nodes of a map, with so many cells for each of the coarsest grid."""
        y = np.arange(chosen.cells * refined + 1) / refined
        slope, bend = chosen.place(y, 1) / refined, chosen.place(y, 2) / refined**2
        return cls(chosen.place(y), slope, bend, chosen, refined)

    def index(self, x: Vector) -> Vector:
        """Return the number of the node at x, between nodes and beyond the ends as well."""
        return self.map.inverse(x) * self.refined

    def place(self, index: Vector) -> Vector:
        """Return x at a number of a node, which need not be whole."""
        return self.map.place(np.asarray(index) / self.refined)
