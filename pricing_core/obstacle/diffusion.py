"""How the place moves, and at which rate values are discounted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from pricing_core.arrays import as_vector
from pricing_core.obstacle.functions import Function, Given, read_function


@dataclass(frozen=True, slots=True, eq=False)
class Diffusion:
    """dx = drift dt + volatility dW, with values discounted at a rate: L V = volatility^2/2 V'' + drift V' - rate V.

    Parameters
    ----------
    volatility : float or callable
        Per sqrt(year), above 0: a number or f(x, t), with x an array of shape (n,) and t in years from now.
    drift, rate : float or callable
        Per year, of either sign; numbers or f(x, t).
    breaks : sequence of float
        Times at which coefficients jump; at such a time they have the later value. Elsewhere they are continuous in t,
        and everywhere in x.

    Raises
    ------
    InvalidInputError
        One of them is neither a number nor a function.

    Examples
    --------
    The logarithm of a price with a volatility of 20 %, at a rate of 5 % and with a yield of 3 %:

    >>> Diffusion(0.2, drift=0.05 - 0.03 - 0.2**2 / 2, rate=0.05).is_constant
    True
    """

    volatility: Given
    drift: Given
    rate: Given
    breaks: Sequence[float] = ()
    functions: tuple[Function, Function, Function] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        names = ("volatility", "drift", "rate")
        read = tuple(read_function(name, getattr(self, name)) for name in names)
        object.__setattr__(self, "functions", read)
        object.__setattr__(self, "breaks", tuple(sorted(as_vector("breaks", self.breaks).tolist())))

    @property
    def is_constant(self) -> bool:
        """Whether no coefficient depends on the time."""
        return not any(function.has_t for function in self.functions)
