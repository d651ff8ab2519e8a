from collections.abc import Callable
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from pricing_core.arrays import BoolVector, Matrix, Vector

__version__: str

def instruction_set() -> Literal["avx512", "avx2", "portable"]: ...
def brennan_schwartz(
    lower: Vector, diagonal: Vector, upper: Vector, q: Vector, contact_first: bool
) -> Vector: ...
def equilibrate(matrix: Matrix) -> tuple[Vector, Vector]: ...
def growing_basic_set(lower: Vector, diagonal: Vector, upper: Vector, q: Vector) -> BoolVector: ...
def lemke(
    matrix: Matrix,
    q: Vector,
    covering: Vector,
    max_pivots: int,
    interrupt: Callable[[], bool] | None = None,
) -> tuple[str, Vector, BoolVector, int]: ...
def policy_iteration(
    lower: Vector,
    diagonal: Vector,
    upper: Vector,
    q: Vector,
    basic_set: BoolVector,
    tolerance: float,
    max_systems: int,
    interrupt: Callable[[], bool] | None = None,
) -> tuple[Vector, int]: ...
def projected_sor(
    lower: Vector,
    diagonal: Vector,
    upper: Vector,
    q: Vector,
    z: Vector,
    relaxation: float,
    tolerance: float,
    max_sweeps: int,
    interrupt: Callable[[], bool] | None = None,
) -> tuple[Vector, int]: ...
def solve_puts(
    x: Vector,
    rate: Vector,
    dividend: Vector,
    spread: Vector,
    first: NDArray[np.int64],
    tolerance: Vector,
    limits: Matrix | None,
    fewest: int,
    most: int,
    threads: int,
    interrupt: Callable[[], bool] | None,
) -> tuple[Matrix, BoolVector, BoolVector, NDArray[np.int64]]: ...
def march_boundaries(
    steps: int, rate: Vector, dividend: Vector, spread: Vector, interrupt: Callable[[], bool] | None
) -> tuple[Vector, BoolVector]: ...
def solve_schedules(
    sign: Vector,
    x: Vector,
    first: NDArray[np.int64],
    segments: Matrix,
    level: NDArray[np.int64],
    tolerance: Vector,
    times: Vector,
    first_time: NDArray[np.int64],
    walks: int,
    threads: int,
    interrupt: Callable[[], bool] | None,
) -> tuple[Matrix, Vector, BoolVector, Vector, NDArray[np.float64]]: ...
def march_segment(
    nodes: Vector,  # (N + 2,), s = S/K, increasing
    lower: Vector,  # (N,), L at the interior nodes, per year; the first row reads the lower end node
    diagonal: Vector,  # (N,)
    upper: Vector,  # (N,), the last row reads the upper end node
    values: Vector,  # (N + 2,), in units of the strike, at the first of the times
    contact: BoolVector,  # (N,), a guess of the contact set
    times: Vector,  # (M + 1,), years before the segment's end, increasing
    scheme: int,  # 0: implicit Euler, 1: SDIRK2
    sign: float,  # 1 for a put, -1 for a call
    escrow: float,  # at the segment's end, in units of the strike
    rate: float,  # per year
    dividend_yield: float,  # per year
    exercisable: bool,
    lines: Matrix,  # (2, 2), (a, b) of a + b s at the lower and the upper end, at the segment's end
    contact_at_left: bool,  # whether the end of the grid lies in the exercise region
    contact_at_right: bool,
    tangents: Matrix,  # (P, N + 2), derivatives of the values by P parameters
    tangent_operators: Matrix,  # (P, 3, N), those of lower, diagonal and upper
    tangent_changes: Matrix,  # (P, 3), those of rate, dividend yield and escrow
    tangent_lines: Matrix,  # (P, 2, 2), those of lines
) -> tuple[Vector, Vector, BoolVector, Vector, float, Matrix, Matrix]:
    # values (N + 2,), slack (N,), contact (N,), multiplier (N,) per year, largest residual at the end of a step,
    # exercise regions in s after each step (M, 2), derivatives of the values by the parameters (P, N + 2)
    ...
