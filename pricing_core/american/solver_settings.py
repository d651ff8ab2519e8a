"""What `price` may be told of how to solve."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, TypeAlias

from pricing_core.american.flat.resolution import Resolution, Scheme
from pricing_core.american.flat.tridiagonal_step import LCPMethod
from pricing_core.errors import InvalidInputError

Method: TypeAlias = Literal["auto", "lcs", "crank-nicolson"]
Greeks: TypeAlias = bool | Literal["extended"]


@dataclass(frozen=True, slots=True)
class SolverSettings:
    """The arguments of `pricing_core.american.price` beside the contract, each checked there.

    Raises
    ------
    InvalidInputError
        The method and the scheme of the resolution contradict each other.
    """

    tolerance: float
    method: Method = "auto"
    lcp_method: LCPMethod = "tridiagonal"
    greeks: Greeks = True
    resolution: Resolution | None = None
    interrupt: Callable[[], bool] | None = None

    def __post_init__(self) -> None:
        if self.method != "auto" and (self.scheme == "crank-nicolson") != (self.method == "crank-nicolson"):
            raise InvalidInputError(
                "method", self.method, f'"auto" where the resolution asks for the scheme "{self.scheme}"'
            )

    @property
    def is_automatic(self) -> bool:
        """Whether nothing asks for the general path."""
        return self.method == "auto" and self.lcp_method == "tridiagonal" and self.resolution is None

    @property
    def scheme(self) -> Scheme:
        """The one-step method of the general path."""
        asked = None if self.resolution is None else self.resolution.scheme
        return asked or ("crank-nicolson" if self.method == "crank-nicolson" else "sdirk2")

    def is_interrupted(self) -> bool:
        """Ask the interrupt, if there is one."""
        return self.interrupt is not None and self.interrupt()
