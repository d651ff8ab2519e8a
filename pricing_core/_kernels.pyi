import numpy as np
from numpy.typing import NDArray

from pricing_core.arrays import BoolVector, Matrix, Vector

__version__: str

def brennan_schwartz(
    lower: Vector, diagonal: Vector, upper: Vector, q: Vector, contact_first: bool
) -> Vector: ...
def policy_iteration(
    lower: Vector,
    diagonal: Vector,
    upper: Vector,
    q: Vector,
    basic_set: BoolVector,
    tolerance: float,
    max_systems: int,
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
) -> tuple[Matrix, BoolVector, BoolVector, NDArray[np.int64]]: ...
def march_boundaries(
    steps: int, rate: Vector, dividend: Vector, spread: Vector
) -> tuple[Vector, BoolVector]: ...
def solve_schedules(
    sign: Vector,
    x: Vector,
    first: NDArray[np.int64],
    stretches: Matrix,
    level: NDArray[np.int64],
    tolerance: Vector,
    times: Vector,
    first_time: NDArray[np.int64],
    threads: int,
) -> tuple[Matrix, Vector, BoolVector]: ...
