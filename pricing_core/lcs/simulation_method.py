"""How a complementarity system is simulated: from event to event, or by implicit steps, with the choices of each."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import ArrayLike

from pricing_core.arrays import (
    IndexSet,
    Vector,
    as_extended_number,
    as_number,
    as_real_array,
    as_vector,
    as_whole_number,
    check_callable,
    check_choice,
)
from pricing_core.errors import InvalidInputError
from pricing_core.lcp import Method
from pricing_core.lcs.mode_selection import OnNonUnique
from pricing_core.lcs.time_stepping import ImpulseScheme, Multipliers, Scheme
from pricing_core.stepping import FixedStep, PIController

Rebound: TypeAlias = Callable[[Vector, Vector, IndexSet], tuple[Vector, Vector]]

TOLERANCE, ABSOLUTE_TOLERANCE = 1e-5, 1e-8
FIRST_STEP = 1e-3  # fraction of the interval


@dataclass(frozen=True, slots=True)
class EventDriven:
    """Event-driven simulation (11.78): the flow in a mode is exact, and its events are located to rounding.

    Modes are selected, and jumps made, by the rational complementarity problem. No excursion of an output below -1e-11
    of its size is missed; transversal events are located to 1e-12, a contact of multiplicity m to the m-th root of
    that. Where events accumulate, their limit is extrapolated: what takes part jumps there, all else flows on. What
    rises by no more than rounding between two impacts is at rest. What has died out is no longer followed, and
    where no output can reach zero any more the rest of the interval is passed at once: rest, drift and oscillations
    cost nothing for their length.

    Parameters
    ----------
    on_nonunique : {"raise", "first"} or callable
        What happens where a state has several continuations: an error, the one nearest the present mode, or that
        which the callable chooses, given t, x and the modes. Inputs that no output sees are an error too, unless a
        choice is made: they are then zero. For k <= 10: with more pairs the first continuation that is found is taken.
    max_events : int
        At least 0; the run ends with an error at one more.
    rebound : callable, optional
        Another law for the jumps than the projection of (11.78), for systems with D = 0: given the states before and
        after that, shape (n,), and the pairs with y_i = 0, it returns the state to go on from, shape (n,), and the
        impulse of u, shape (k,).

    Raises
    ------
    InvalidInputError
        A field lies outside what is allowed.

    Notes
    -----
    Cost of an event: about 0.1 ms for few pairs and 0.2 ms for twelve, and once for every mode that is met about 2 ms
    for short numbers and n + k <= 24, where ranks are exact, otherwise some tenths of a millisecond.
    """

    on_nonunique: OnNonUnique = "raise"
    max_events: int = 100_000
    rebound: Rebound | None = None

    def __post_init__(self) -> None:
        chosen = self.on_nonunique
        if not callable(chosen) and not (isinstance(chosen, str) and chosen in ("raise", "first")):
            raise InvalidInputError("on_nonunique", chosen, '"raise", "first" or a function of (t, x, modes)')
        object.__setattr__(self, "max_events", as_whole_number("max_events", self.max_events, 0))
        if self.rebound is not None:
            check_callable("rebound", self.rebound, "the states before and after, and the contacts")


@dataclass(frozen=True, slots=True)
class TimeStepping:
    """Time stepping (11.65): one LCP per implicit stage, with error control or a constant step.

    The robust second way, of order 1 or 2, for systems with hundreds of pairs.

    Parameters
    ----------
    scheme : {"auto", "implicit-euler", "sdirk2", "theta", "moreau", "stewart-trinkle"}
        "auto" takes the second-order "sdirk2" for relative degree 0 and 1, where the state is continuous after the
        start, and "implicit-euler" for relative degree 2, where it may jump at any time. "moreau" and
        "stewart-trinkle" are for mechanical systems alone, whose impacts and friction they take as impulses: "auto"
        means "moreau" there where the restitution is > 0 or there is friction.
    theta : float, optional
        Implicit weight of the schemes "theta" and "moreau", from 1/2 to 1; 1/2 if missing.
    step : float, optional
        Constant step, > 0, in the units of t; where it is inf the times to report alone are the steps. Without it a
        PI controller keeps the local error, estimated by step doubling, below absolute_tolerance + tolerance |x|. A
        switch of mode is located to that accuracy, or to 1e-9 of the interval.
    tolerance : float, optional
        Relative tolerance of controlled steps, >= 0; 1e-5 if missing.
    absolute_tolerance : float or array_like of shape (n,), optional
        Absolute tolerance of controlled steps, > 0, in the units of x: one number, or one for each state where their
        units differ; 1e-8 if missing. Kept as a float or a tuple.
    lcp_method : {"auto", "lemke", "murty", "psor", "policy", "tridiagonal", "multigrid", "block-pivoting", \
"projected-gradients", "enumeration", "exact"}
        See `pricing_core.lcp.solve`.
    multipliers : {"any", "least-norm"}
        Where the step's multipliers are not unique, those of least norm (for positive semidefinite problems; Han,
        Tiwari, Camlibel, Pang 2009). Event-driven runs always report these.

    Raises
    ------
    InvalidInputError
        A field lies outside what is allowed, or the others leave it without effect: theta with another scheme than
        "theta" and "moreau", a tolerance with a constant step.
    """

    scheme: Scheme | ImpulseScheme | Literal["auto"] = "auto"
    theta: float | None = None
    step: float | None = None
    tolerance: float | None = None
    absolute_tolerance: ArrayLike | None = None
    lcp_method: Method = "auto"
    multipliers: Multipliers = "any"

    def __post_init__(self) -> None:
        check_choice("scheme", self.scheme, ("auto", *get_args(Scheme), *get_args(ImpulseScheme)))
        check_choice("lcp_method", self.lcp_method, get_args(Method))
        check_choice("multipliers", self.multipliers, get_args(Multipliers))
        for name, (read, holds, allowed) in _NUMBERS.items():
            given = getattr(self, name)
            if given is not None:
                number = read(name, given)
                if not holds(number):
                    raise InvalidInputError(name, given, allowed)
                object.__setattr__(self, name, number)
        if self.theta is not None and self.scheme not in ("theta", "moreau"):
            raise InvalidInputError("theta", self.theta, 'left out unless scheme is "theta" or "moreau"')
        if self.step is not None:
            for name in ("tolerance", "absolute_tolerance"):
                if getattr(self, name) is not None:
                    raise InvalidInputError(name, getattr(self, name), "left out with a constant step")

    def controller(self, states: int) -> FixedStep | PIController:
        """Return what chooses the steps of a system with so many states.

        Raises
        ------
        InvalidInputError
            There are absolute tolerances for another number of states.
        """
        if self.step is not None:
            return FixedStep(self.step)
        absolute = ABSOLUTE_TOLERANCE if self.absolute_tolerance is None else self.absolute_tolerance
        if isinstance(absolute, tuple):
            as_vector("absolute_tolerance", absolute, states)
        relative = TOLERANCE if self.tolerance is None else self.tolerance
        return PIController(relative, absolute, start=FIRST_STEP)


SimulationMethod: TypeAlias = EventDriven | TimeStepping | Literal["event-driven", "time-stepping"]
BY_NAME: dict[str, type[EventDriven] | type[TimeStepping]] = {
    "event-driven": EventDriven,
    "time-stepping": TimeStepping,
}


def as_method(method: object) -> EventDriven | TimeStepping:
    """Return the method itself, or the one that a name stands for, with its defaults.

    Raises
    ------
    InvalidInputError
        It is neither.

    Examples
    --------
    >>> as_method("event-driven")
    EventDriven(on_nonunique='raise', max_events=100000, rebound=None)
    """
    if isinstance(method, EventDriven | TimeStepping):
        return method
    if isinstance(method, str) and method in BY_NAME:
        return BY_NAME[method]()
    raise InvalidInputError(
        "method", method, '"event-driven", "time-stepping", an EventDriven(...) or a TimeStepping(...)'
    )


def check_unused(method: EventDriven | TimeStepping, fields: Sequence[str], system: str) -> None:
    """Raise InvalidInputError where a field that has no effect for a kind of system is not as it is by default."""
    usual = type(method)()
    for name in fields:
        if getattr(method, name) != getattr(usual, name):
            raise InvalidInputError(
                name, getattr(method, name), f"left out for {system}, where it has no effect"
            )


def _float_or_tuple(field: str, value: ArrayLike) -> float | tuple[float, ...]:
    numbers = as_real_array(field, value)
    return tuple(as_vector(field, numbers).tolist()) if numbers.ndim else float(numbers)


# How each field is read, what must hold then, and what is said otherwise.
_NUMBERS: dict[str, tuple[Callable[[str, Any], Any], Callable[[Any], bool], str]] = {
    "theta": (as_number, lambda theta: 0.5 <= theta <= 1.0, "at least 1/2 and at most 1"),
    "step": (as_extended_number, lambda step: step > 0.0, "a number > 0"),
    "tolerance": (as_number, lambda tolerance: tolerance >= 0.0, "a finite number >= 0"),
    "absolute_tolerance": (
        _float_or_tuple,
        lambda tolerance: bool(np.all(np.greater(tolerance, 0.0))),
        "> 0",
    ),
}
