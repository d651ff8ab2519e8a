"""The numbers of the march of obstacle problems, in NumPy and in the kernel."""

from __future__ import annotations

# Half the width of an interval that is chosen, in standard deviations: beyond it lies 4e-8 of a normal distribution.
WIDTH = 5.5
# Cells of the coarsest grid over that width.
CELLS = 32
# Steps for each standard deviation of a segment and cell. The stage matrix is an M-matrix up to sqrt(6 gamma) = 1.617.
STEPS = 1.4
# By which the steps may be more when their number is rounded.
ROUNDED = 1.07
# The shortest step between breaks over the one that this would be without them, in the root of the clock: the stage
# matrix is an M-matrix from 1.4/1.617 on.
SHORTEST = 0.87
# Cells of the coarsest grid, at least and at most, and of the finest.
LEAST_CELLS, MOST_COARSE_CELLS, MOST_CELLS = 16, 1024, 4096
# Pieces of a segment in which a diffusion that depends on the time is looked at, and of the time between two breaks at
# least; those in which it is counted how often coefficients rise and fall; and the share of the clock that goes with
# the time.
PIECES, FEWEST_PIECES, PIECES_OF_TURNS, CLOCK_SHARE = 32, 4, 256, 0.2
