from pricing_core.arrays import Vector

__version__: str

def brennan_schwartz(
    lower: Vector, diagonal: Vector, upper: Vector, q: Vector, contact_first: bool
) -> Vector: ...
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
