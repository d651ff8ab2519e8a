"""Every exception this library raises, as a tree, and its warnings.

::

    PricingCoreError
    ├── InvalidInputError (ValueError)     the question is wrong: field, value, what is allowed
    │   ├── MissingInputError              what must be given is not
    │   └── UnknownNameError               what is given has a name that is not known
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
    KernelMissingWarning (UserWarning)     there is no compiled kernel: options are priced 100 times slower and more
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from difflib import get_close_matches
from fractions import Fraction
from typing import Any

SHOWN_CHARACTERS = 40
# Unknown names that are shown and compared with the known ones, and characters of each; chosen.
MOST_NAMES, LONGEST_NAME = 10, SHOWN_CHARACTERS


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
    sentence : str
        The message, where "must be ..." would not say it; it may be sent to a client unless a class says otherwise.

    Examples
    --------
    >>> print(InvalidInputError("volatility", -0.2, "a number >= 0"))
    volatility = -0.2: must be a number >= 0
    """

    def __init__(self, field: str, value: object, allowed: str, sentence: str = "") -> None:
        self.field = field
        self.value = value
        self.allowed = allowed
        self.sentence = sentence
        super().__init__(sentence or f"{field} = {shown(value)}: must be {allowed}")

    @property
    def message_without_value(self) -> str:
        """The message without anything of what was given."""
        return self.sentence or f"{self.field} must be {self.allowed}"

    @property
    def message_for_strangers(self) -> str:
        """The message that may be sent to a client: it holds the value only where the library has worded it."""
        return str(self) if isinstance(self.value, Told) else self.message_without_value

    def called(self, field: str) -> InvalidInputError:
        """Return the same fault of something that the caller knows by another name."""
        return InvalidInputError(field, self.value, self.allowed)

    def __reduce__(self) -> tuple[type[InvalidInputError], tuple[Any, ...]]:
        return type(self), (self.field, self.value, self.allowed, self.sentence)


class MissingInputError(InvalidInputError):
    """What must be given is not.

    Parameters
    ----------
    missing : str, or mapping of str to str
        The name of what is missing; the names of several things, each with what it is, or "".
    remedy : str
        What to do about it, where that is not evident.

    Examples
    --------
    >>> print(MissingInputError("expiry", "give it, or valuation_date and expiration_date"))
    expiry is missing: give it, or valuation_date and expiration_date
    >>> print(MissingInputError({"strike": "money", "rate": "1/year", "option_type": ""}))
    strike (money), rate (1/year) and option_type are missing
    """

    def __init__(self, missing: str | Mapping[str, str], remedy: str = "") -> None:
        told = {missing: ""} if isinstance(missing, str) else dict(missing)
        names = [f"{name} ({what})" if what else name for name, what in told.items()]
        self.missing, self.remedy = missing, remedy
        sentence = f"{enumerated(names)} {'is' if len(names) == 1 else 'are'} missing"
        super().__init__(
            ", ".join(told), Told("missing"), "given", f"{sentence}: {remedy}" if remedy else sentence
        )

    def called(self, field: str) -> InvalidInputError:
        """Return the same fault of something that the caller knows by another name."""
        return MissingInputError(field, self.remedy)

    def __reduce__(self) -> tuple[type[InvalidInputError], tuple[Any, ...]]:
        return type(self), (self.missing, self.remedy)


class UnknownNameError(InvalidInputError):
    """What is given has a name that is not known.

    Parameters
    ----------
    kind : str
        What the names are of, such as "column".
    unknown : sequence of str
    known : collection of str
        All names that are known.
    owner : str
        What has columns, keys or arguments, where that is not evident.

    Examples
    --------
    >>> print(UnknownNameError("column", ["vol"], ["spot", "volatility"]))
    there is no column 'vol': did you mean volatility?
    >>> print(UnknownNameError("key", ["x", "y"], ["times", "values"], "rate"))
    rate has no key 'x' or 'y': choose from times and values
    """

    def __init__(self, kind: str, unknown: Sequence[str], known: Collection[str], owner: str = "") -> None:
        self.kind, self.unknown, self.known, self.owner = kind, unknown, known, owner
        shown_names = [shown(str(name)) for name in unknown[:MOST_NAMES]]
        more = f" and {len(unknown) - MOST_NAMES} more" if len(unknown) > MOST_NAMES else ""
        nearest = enumerated(nearest_names(unknown, known), "or")
        self.advice = f"did you mean {nearest}?" if nearest else f"choose from {enumerated([*known])}"
        none = f"{owner} has no" if owner else "there is no"
        sentence = f"{none} {kind} {enumerated(shown_names, 'or')}{more}: {self.advice}"
        field = f"{kind} of {owner}" if owner else kind
        super().__init__(
            field, Told("an unknown name"), nearest or f"one of {enumerated([*known], 'or')}", sentence
        )

    @property
    def message_without_value(self) -> str:
        """The message without the names that were given."""
        return (
            f"{self.owner} has no such {self.kind}: {self.advice}"
            if self.owner
            else (f"there is no such {self.kind}: {self.advice}")
        )

    @property
    def message_for_strangers(self) -> str:
        """The same: a client's own names are not sent back."""
        return self.message_without_value

    def called(self, field: str) -> InvalidInputError:
        """Return the same fault of something that the caller knows by another name."""
        return UnknownNameError(self.kind, self.unknown, self.known, field)

    def __reduce__(self) -> tuple[type[InvalidInputError], tuple[Any, ...]]:
        return type(self), (self.kind, self.unknown, self.known, self.owner)


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
    """The compiled kernel was not built, so that the march of obstacle problems in NumPy prices every option."""


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


def enumerated(words: Sequence[str], last: str = "and") -> str:
    """Return words with commas between them, and another word before the last.

    Examples
    --------
    >>> enumerated(["put", "call"], "or"), enumerated(["american", "european", "bermudan"], "or")
    ('put or call', 'american, european or bermudan')
    """
    return f" {last} ".join([", ".join(words[:-1]), words[-1]]) if len(words) > 1 else "".join(words)


def nearest_names(unknown: Sequence[str], known: Collection[str]) -> list[str]:
    """Return for unknown names the known ones that are most like them, or begin with them; none where none does.

    The case of letters does not count, nor what all known names begin with.

    Examples
    --------
    >>> nearest_names(["Spto", "vol"], ["spot", "volatility"])
    ['spot', 'volatility']
    >>> nearest_names(["PRICING_COLOUR", "PRICING_PROT"], ["PRICING_HOST", "PRICING_PORT"])
    ['PRICING_PORT']
    """
    shared = ""
    for letters in zip(*known, strict=False):
        if len(known) == 1 or len({*letters}) > 1:
            break
        shared += letters[0]
    ends = {name.removeprefix(shared).lower(): name for name in known}
    nearest = []
    for name in unknown[:MOST_NAMES]:
        end = str(name).removeprefix(shared)[:LONGEST_NAME].lower()
        alike = get_close_matches(end, ends, n=1) or [
            other for other in ends if end and other.startswith(end)
        ]
        nearest += [ends[other] for other in alike[:1]]
    return [*dict.fromkeys(nearest)]
