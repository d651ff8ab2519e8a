"""Every exception this library raises.

PricingCoreError
├── InvalidInputError (ValueError)     the question is wrong: field, value, what is allowed
└── NumericalError (ArithmeticError)   the question stands, the method could not answer it
    ├── InfeasibleError                proved: there is no solution
    ├── RayTerminationError            Lemke's method stopped on a ray: nothing is proved
    ├── IterationLimitError            an iteration did not converge within its limit
    ├── RelativeDegreeError            the time-stepping scheme cannot converge for this system
    └── StepSizeError                  step-size control reached its smallest or its last step
"""

SHOWN_CHARACTERS = 40


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
        super().__init__(f"{field} = {_shown(value)}: must be {allowed}")

    @property
    def message_without_value(self) -> str:
        """The sentence that is safe to send to a stranger."""
        return f"{self.field} must be {self.allowed}"

    def __reduce__(self) -> tuple[type["InvalidInputError"], tuple[str, object, str]]:
        return type(self), (self.field, self.value, self.allowed)


class NumericalError(PricingCoreError, ArithmeticError):
    """A well-posed question that the chosen method could not answer."""


class InfeasibleError(NumericalError):
    """The problem is proved to have no solution."""


class RayTerminationError(NumericalError):
    """Lemke's method ended on a secondary ray; the problem may still have a solution."""


class IterationLimitError(NumericalError):
    """An iteration ran into its limit before it converged."""


class RelativeDegreeError(NumericalError):
    """The system's relative degree is too high for the time-stepping scheme to converge."""


class StepSizeError(NumericalError):
    """Step-size control could not meet its tolerance."""


def _shown(value: object) -> str:
    text = repr(value)
    return text if len(text) <= SHOWN_CHARACTERS else text[: SHOWN_CHARACTERS - 3] + "..."
