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
def premium_march(
    steps: int,
    width: float,
    rate: Vector,
    dividend: Vector,
    spread: Vector,
    nodes: NDArray[np.int64],
    halvings: NDArray[np.int64],
    tangents: bool,
    threads: int,
) -> tuple[NDArray[np.float64], Vector, Vector, BoolVector]: ...
def premium_values(
    steps: int,
    width: float,
    x: Vector,
    rate: Vector,
    dividend: Vector,
    spread: Vector,
    nodes: NDArray[np.int64],
    halvings: NDArray[np.int64],
    tangents: bool,
    threads: int,
) -> tuple[Matrix, Vector, BoolVector]: ...
def profile_values(
    width: float,
    rate: Vector,
    dividend: Vector,
    spread: Vector,
    nodes: NDArray[np.int64],
    halvings: NDArray[np.int64],
    profiles: NDArray[np.float64],
    frame: Vector,
    boundary: Vector,
    row: NDArray[np.int64],
    x: Vector,
) -> Matrix: ...
