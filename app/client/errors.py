"""What can go wrong between a client and the service, beside what the library itself raises."""

from pricing_core.errors import PricingCoreError


class ServiceError(PricingCoreError):
    """The service did not answer the question."""


class ServiceUnavailableError(ServiceError, ConnectionError):
    """The service is away, busy or too slow, and asking again has not helped."""


class ServiceRefusedError(ServiceError):
    """The service refuses the request, and asking again would not help.

    Parameters
    ----------
    status : int
        The status of the answer, such as 401 for a missing key or 413 for a body that is too large.
    message : str
        What the service says is wrong.
    """

    def __init__(self, status: int, message: str) -> None:
        self.status = status
        super().__init__(f"status {status}: {message}")


class BrokenAnswerError(ServiceError):
    """What came back is not an answer of the service: of another kind, cut short or without a number."""
