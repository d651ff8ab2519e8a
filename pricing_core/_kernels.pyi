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
def march_strikes(
    factors: Matrix, matrices: NDArray[np.float64], values: Matrix, obstacle: Matrix
) -> Matrix: ...

class MarchSettings:
    def __new__(
        cls, *, cells: int, width: float, steps: float, rounded: float, fewest: float
    ) -> MarchSettings: ...

class VolatilitySurface:
    def __new__(
        cls,
        *,
        times: Vector,
        logs: Vector,
        values: Matrix,
        slopes: Matrix,
    ) -> VolatilitySurface: ...

class SegmentTable:
    def __new__(
        cls,
        *,
        sign: Vector,
        x: Vector,
        owner: NDArray[np.int64],
        european: BoolVector,
        first: NDArray[np.int64],
        duration: Vector,
        rate: Vector,
        dividend_yield: Vector,
        volatility: Vector,
        exercisable: BoolVector,
        exercise_at_end: BoolVector,
        fraction: Vector,
        amount: Vector,
        escrow: Vector,
        local: list[tuple[VolatilitySurface, float, float] | None] | None = None,
    ) -> SegmentTable: ...

class MarchedSegments:
    value: Vector
    error: Vector
    european: Vector
    boundary: Vector
    boundary_error: Vector
    exercised: BoolVector
    settled: BoolVector
    steps: NDArray[np.int64]
    levels: NDArray[np.int64]
    local: Matrix
    local_change: Matrix
    by_segment: Matrix
    by_segment_change: Matrix
    def ends(self, contract: int) -> list[Matrix]: ...

def march_segments(
    table: SegmentTable,
    tolerance: Vector,
    settings: MarchSettings,
    greeks: int,
    threads: int,
    interrupt: Callable[[], bool] | None,
) -> MarchedSegments: ...
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
def sparse_sweeps(
    indptr: NDArray[np.int64],
    indices: NDArray[np.int64],
    data: Vector,
    q: Vector,
    lower: Vector,
    upper: Vector,
    z: Vector,
    relaxation: float,
    tolerance: float,
    max_sweeps: int,
    alternating: bool,
    interrupt: Callable[[], bool] | None = None,
) -> tuple[Vector, int]: ...
def price_options(
    is_put: BoolVector,
    spot: Vector,
    strike: Vector,
    expiry: Vector,
    rate: Vector,
    dividend_yield: Vector,
    volatility: Vector,
    tolerance: Vector,
    greeks: int,
    shared: bool,
    threads: int,
    interrupt: Callable[[], bool] | None,
) -> tuple[dict[str, Vector], BoolVector, BoolVector, NDArray[np.int64]]: ...
def solve_puts(
    x: Vector,
    rate: Vector,
    dividend: Vector,
    spread: Vector,
    first: NDArray[np.int64],
    tolerance: Vector,
    limits: Matrix | None,
    spread_step: float | None,
    fewest: int,
    most: int,
    threads: int,
    interrupt: Callable[[], bool] | None,
) -> tuple[Matrix, BoolVector, BoolVector, NDArray[np.int64]]: ...
def march_boundaries(
    steps: int, rate: Vector, dividend: Vector, spread: Vector, interrupt: Callable[[], bool] | None
) -> tuple[Vector, BoolVector]: ...
