"""Every exception this library raises, as a tree, and its warnings.

::

    PricingCoreError
    ├── InvalidInputError (ValueError)     the question is wrong: field, value, what is allowed
    ├── MissingExtraError (ImportError)    a module of an extra is not installed: the message says which extra
    ├── ClusterError (ConnectionError)      workers are missing, lost, or of another version
    └── NumericalError (ArithmeticError)   the question stands, the method could not answer it
        ├── InfeasibleError                proved: there is no solution
        ├── NotFoundError                  no solution was found: nothing is proved
        ├── RayTerminationError            Lemke's method stopped on a ray: nothing is proved
        ├── IterationLimitError            an iteration did not converge within its limit
        ├── RelativeDegreeError            the time-stepping scheme cannot converge for this system
        ├── StepSizeError                  step-size control reached its smallest or its last step
        ├── NonUniqueError                 a state has several continuations, and none was chosen
        └── ZenoError                      infinitely many events accumulate, and nothing goes on from their limit

    UnusualColumnWarning (UserWarning)     a column of a table looks like days, percent or cents
    DiscardedPartsWarning (UserWarning)    a batch begins afresh where an earlier one has left finished parts
    KernelMissingWarning (UserWarning)     there is no compiled kernel: options are priced 500 to 2,000 times slower
"""

from __future__ import annotations

from fractions import Fraction
from typing import Any

SHOWN_CHARACTERS = 40


class Told(str):
    """A description in the place of a value, such as "1001 entries": shown without quotes, and safe to send."""

    __slots__ = ()

    def __repr__(self) -> str:
        return str(self)


class PricingCoreError(Exception):
    """The root of the tree."""


class InvalidInputError(PricingCoreError, ValueError):
    """An argument lies outside what is allowed.

    Parameters
    ----------
    field : str
        Name of the argument, in the vocabulary of the public interface.
    value : object
        What was given; the message shows at most 40 characters of it.
    allowed : str
        What is allowed, completing "must be ...".

    Examples
    --------
    >>> print(InvalidInputError("volatility", -0.2, "a number >= 0"))
    volatility = -0.2: must be a number >= 0
    """

    def __init__(self, field: str, value: object, allowed: str) -> None:
        self.field = field
        self.value = value
        self.allowed = allowed
        super().__init__(f"{field} = {shown(value)}: must be {allowed}")

    @property
    def message_without_value(self) -> str:
        """The message without anything of what was given."""
        return f"{self.field} must be {self.allowed}"

    @property
    def message_for_strangers(self) -> str:
        """The message that may be sent to a client: it holds the value only where the library has worded it."""
        return str(self) if isinstance(self.value, Told) else self.message_without_value

    def __reduce__(self) -> tuple[type[InvalidInputError], tuple[str, object, str]]:
        return type(self), (self.field, self.value, self.allowed)


class ClusterError(PricingCoreError, ConnectionError):
    """The scheduler or the workers of a cluster cannot do the work, and the work itself is not why."""


class DamagedPartError(PricingCoreError, OSError):
    """What a batch has kept of its work is not what was written."""


class NumericalError(PricingCoreError, ArithmeticError):
    """A well-posed question that the chosen method could not answer.

    Attributes
    ----------
    best : LCPSolution or None
        The point of a complementarity problem with the smallest residual that was met; it is no solution. Else None.
    """

    best: Any = None


class InfeasibleError(NumericalError):
    """The problem is proved to have no solution."""


class NotFoundError(NumericalError):
    """No solution was found; the problem may still have one."""


class RayTerminationError(NumericalError):
    """Lemke's method ended on a secondary ray; the problem may still have a solution."""


class IterationLimitError(NumericalError):
    """An iteration ran into its limit before it converged."""


class RelativeDegreeError(NumericalError):
    """The system's relative degree is too high for the time-stepping scheme to converge."""


class StepSizeError(NumericalError):
    """Step-size control could not meet its tolerance."""


class NonUniqueError(NumericalError):
    """A state has several continuations, and nothing says which one to take."""


class ZenoError(NumericalError):
    """Events accumulate at an instant from which there is no continuation."""


class MissingExtraError(PricingCoreError, ImportError):
    """A module that an extra of the distribution installs is not there."""


class UnusualColumnWarning(UserWarning):
    """A column of a table looks as if it were in another unit: days, percent or cents."""


class DiscardedPartsWarning(UserWarning):
    """A batch begins afresh on an output for which an earlier run has left finished parts."""


class KernelMissingWarning(UserWarning):
    """The compiled kernel was not built, so that the method of lines in NumPy prices every option."""


def shown(value: object) -> str:
    """Return what a message shows of a value: its repr, of a fraction 1/3, at most 40 characters of it.

    Examples
    --------
    >>> shown(Fraction(-1, 3))
    '-1/3'
    >>> shown(10**5000)
    'a value of type int'
    """
    try:
        text = str(value) if isinstance(value, Fraction) else repr(value)
    except ValueError:  # integers of thousands of digits have no repr
        return f"a value of type {type(value).__name__}"
    return text if len(text) <= SHOWN_CHARACTERS else text[: SHOWN_CHARACTERS - 3] + "..."
