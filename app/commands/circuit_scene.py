"""A circuit as an animation shows it: nodes in a ring, charges that flow along the branches, diodes that conduct."""

import itertools
from collections.abc import Sequence

import numpy as np

from app.commands.animation import interpolated
from app.commands.mode_band import Band
from pricing_core.arrays import Matrix, Vector
from pricing_core.extras import needs_extra
from pricing_core.models import CircuitRun
from pricing_core.models.circuits.elements import Branch, Diode, Element
from pricing_core.models.circuits.equations import GROUND

with needs_extra("plot"):
    from matplotlib import colormaps
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.patches import Polygon

ORDERED = 7  # nodes up to which the shortest ring is searched among all
DOTS = 4  # charges on a branch
LAPS = 6.0  # branches that a charge passes in a run at the largest mean current
ARROW = 0.09  # half the length of a diode's triangle, where the ring has radius 1
BEND = 0.34  # between branches that join the same nodes
ALONG = np.linspace(0.0, 1.0, 41)
ROUNDING = 1e-9  # share of the largest voltage below which one is shown as zero
CONDUCTING, BLOCKING = "#009E73", "white"


class CircuitScene:
    """Nodes coloured by voltage, charges that move with the currents, and diodes that are filled while they conduct."""

    def __init__(self, run: CircuitRun, elements: Sequence[Element], band: Band | None) -> None:
        self._run, self._band = run, band
        self._branches = [branch for element in elements for branch in element.branches]
        self._diodes = {element.name for element in elements if isinstance(element, Diode)}
        nodes = [*dict.fromkeys(end for branch in self._branches for end in (branch.plus, branch.minus))]
        self._places = ring(nodes, self._branches)
        self._paths = paths(self._branches, self._places)
        self._charges = self._laps()
        size = max((float(np.abs(run.voltages[node]).max()) for node in nodes), default=0.0)
        self._largest = size or 1.0

    def prepare(self, axes: Axes) -> None:
        """Draw the branches with their names, and create the artists that move."""
        axes.set_aspect("equal")
        axes.set_axis_off()
        axes.set_xlim(-1.45, 1.45)
        axes.set_ylim(-1.4, 1.4)
        self._triangles: list[tuple[str, Polygon]] = []
        for branch, path in zip(self._branches, self._paths, strict=True):
            axes.plot(*path.T, color="#9aa4ad", linewidth=1.5, zorder=1)
            middle, way = path[20], path[21] - path[19]
            way /= max(float(np.linalg.norm(way)), 1e-12)
            across = np.array([-way[1], way[0]])
            outward = across if across @ middle >= 0.0 else -across
            name = middle + 0.15 * outward
            axes.text(float(name[0]), float(name[1]), branch.name, ha="center", va="center", fontsize=9)
            if branch.name in self._diodes:
                corners = middle + ARROW * np.array([way, across - way, -across - way])
                triangle = Polygon(corners, edgecolor="black", linewidth=1.2, zorder=3)
                axes.add_patch(triangle)
                bar = middle + ARROW * np.array([way + across, way - across])
                axes.plot(*bar.T, color="black", linewidth=1.8, zorder=4)
                self._triangles.append((branch.name, triangle))
        (self._dots,) = axes.plot([], [], "o", color="#E69F00", markersize=5, zorder=2)
        x, y = np.array(list(self._places.values())).T
        self._discs = axes.scatter(x, y, s=260, edgecolors="black", linewidths=1.0, zorder=5)
        self._labels = [
            axes.text(float(place[0]), float(place[1]), "", ha="center", va="center", fontsize=9)
            for place in 1.26 * np.array(list(self._places.values()))
        ]

    def show(self, time: float) -> list[Artist]:
        """Move the charges, colour the nodes, fill the diodes."""
        run = self._run
        volts = [interpolated(run.t, run.voltages[node], time) for node in self._places]
        shades = colormaps["coolwarm"](0.5 + 0.5 * np.array(volts) / self._largest)
        self._discs.set_facecolor([tuple(shade) for shade in shades.tolist()])
        for label, node, value in zip(self._labels, self._places, volts, strict=True):
            shown = value if abs(value) > ROUNDING * self._largest else 0.0
            label.set_text("ground" if node == GROUND else f"{node}\n{shown:.3g} V")
        conducting = (
            set()
            if self._band is None
            else {
                name for name, word in zip(self._band.names, self._band.words_at(time), strict=True) if word
            }
        )
        for name, triangle in self._triangles:
            triangle.set_facecolor(CONDUCTING if name in conducting else BLOCKING)
        shares = [(interpolated(run.t, laps, time) + np.arange(DOTS) / DOTS) % 1.0 for laps in self._charges]
        dots = np.vstack(
            [
                np.column_stack([np.interp(share, ALONG, path[:, axis]) for axis in (0, 1)])
                for share, path in zip(shares, self._paths, strict=True)
            ]
        )
        self._dots.set_data(*dots.T)
        return [self._dots, *(triangle for _, triangle in self._triangles), self._discs, *self._labels]

    def _laps(self) -> list[Vector]:
        """Return how often the charges of each branch have passed it, at the times of the run."""
        t = self._run.t
        passed = []
        for branch in self._branches:
            current = self._run.currents[branch.name]
            passed.append(np.concatenate([[0.0], np.cumsum(0.5 * (current[1:] + current[:-1]) * np.diff(t))]))
        moved = max((float(np.abs(np.diff(charge)).sum()) for charge in passed), default=0.0)
        return [LAPS * charge / (moved or 1.0) for charge in passed]


def ring(nodes: Sequence[str], branches: Sequence[Branch]) -> dict[str, Vector]:
    """Return places on a circle, the first node or ground at the bottom, such that branches are short."""
    bottom = GROUND if GROUND in nodes else nodes[0]
    others = [node for node in nodes if node != bottom]
    angles = 2.0 * np.pi * np.arange(len(nodes)) / len(nodes) - 0.5 * np.pi
    places = np.column_stack([np.cos(angles), np.sin(angles)])

    def length(order: Sequence[str]) -> float:
        at = {node: places[i] for i, node in enumerate((bottom, *order))}
        return sum(float(np.linalg.norm(at[one.plus] - at[one.minus])) for one in branches)

    orders = itertools.permutations(others) if len(nodes) <= ORDERED else [tuple(others)]
    best = min(orders, key=length)
    return {node: places[i] for i, node in enumerate((bottom, *best))}


def paths(branches: Sequence[Branch], places: dict[str, Vector]) -> list[Matrix]:
    """Return points along each branch, shape (len(ALONG), 2); those that join the same nodes bend apart."""
    ends = [frozenset((branch.plus, branch.minus)) for branch in branches]
    found, seen = [], dict.fromkeys(ends, 0)
    for branch, pair in zip(branches, ends, strict=True):
        start, end = places[branch.plus], places[branch.minus]
        bend = BEND * (seen[pair] - 0.5 * (ends.count(pair) - 1))
        seen[pair] += 1
        # The same side for both directions.
        first, second = sorted(pair) if len(pair) == 2 else (branch.plus, branch.minus)
        way = places[second] - places[first]
        across = np.array([-way[1], way[0]]) / max(float(np.linalg.norm(way)), 1e-12)
        bow = (4.0 * bend * ALONG * (1.0 - ALONG))[:, None] * across
        found.append((1.0 - ALONG)[:, None] * start + ALONG[:, None] * end + bow)
    return found
