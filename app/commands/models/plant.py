"""The keys of a linear system that elements connect: x' = Ax + Bu, y = Cx + Du."""

from collections.abc import Mapping

from app.commands.model_keys import MATRIX, Key

PLANT: Mapping[str, Key] = {
    "A": MATRIX.described("n x n, by rows", required=True),
    "B": MATRIX.described("n x k, by rows", required=True),
    "C": MATRIX.described("k x n, by rows", required=True),
    "D": MATRIX.described("k x k, by rows; zero where missing"),
}
