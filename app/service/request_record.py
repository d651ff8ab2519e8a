"""The record of a request: what is known of it when it ends, for its line in the log and for the metrics."""

from collections import Counter
from dataclasses import dataclass, field
from typing import Any

from fastapi import Request


@dataclass(slots=True)
class RequestRecord:
    """The facts that routes, lanes and handlers note while a request is answered.

    Parameters
    ----------
    client : str
        The name of its key, or its address.
    trace : str or None
        Its `traceparent`, where that is one.
    cost : float or None
        Seconds of one thread that its work is expected to take.
    waited : float or None
        Seconds that it waited for a thread; None where it needed none.
    engine : str or None
        The method that answered it.
    contracts : Counter
        What it asked to price, by the status of the answer.
    problem : str or None
        The name of the problem that it was answered with.
    """

    client: str
    trace: str | None = None
    cost: float | None = None
    waited: float | None = None
    engine: str | None = None
    contracts: Counter[str] = field(default_factory=Counter)
    problem: str | None = None

    def answered(self, status: str, engine: str | None = None, count: int = 1) -> None:
        """Count contracts that have been answered with a status."""
        self.contracts[status] += count
        self.engine = engine or self.engine

    def fields(self) -> dict[str, Any]:
        """Return the fields of the line of the log, without those that are not known."""
        known = {
            "client": self.client,
            "traceparent": self.trace,
            "cost": None if self.cost is None else float(f"{self.cost:.3g}"),
            "waited": None if self.waited is None else round(self.waited, 6),
            "engine": self.engine,
            "contracts": dict(self.contracts) or None,
            "problem": self.problem,
        }
        return {name: value for name, value in known.items() if value is not None}


def record_of(request: Request) -> RequestRecord:
    """Return the record of a request."""
    record: RequestRecord = request.state.record
    return record
