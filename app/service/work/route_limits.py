"""The limits of a route: bytes of a body, and seconds in which a request is answered."""

from collections.abc import Callable
from typing import NamedTuple, TypeAlias

from app.settings import Settings


class RouteLimits(NamedTuple):
    """The limits of one request.

    Parameters
    ----------
    body_bytes : int
    body_seconds : float
        Until all of the body is here.
    deadline_seconds : float
        Until its work ends, waiting included.
    """

    body_bytes: int
    body_seconds: float
    deadline_seconds: float


# Share of the deadline of a batch that is left to write and send its answer, which says of every row what became of it,
# once its work has ended; chosen.
WRITING_SHARE = 0.05


# What a route is declared with.
Limits: TypeAlias = Callable[[Settings], RouteLimits]


def for_contract(settings: Settings) -> RouteLimits:
    """Return the limits of a question about one contract."""
    return RouteLimits(settings.max_body_bytes, settings.body_seconds, settings.deadline_seconds)


def for_batch(settings: Settings) -> RouteLimits:
    """Return the limits of a question about many contracts, whose rows may arrive while others are answered."""
    return RouteLimits(
        settings.max_batch_bytes,
        settings.batch_deadline_seconds,
        (1.0 - WRITING_SHARE) * settings.batch_deadline_seconds,
    )
