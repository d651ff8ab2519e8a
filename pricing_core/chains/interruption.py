"""Long work that ends early when it is told to."""

from __future__ import annotations

from collections.abc import Callable

from pricing_core.errors import NumericalError


def check_interrupt(interrupt: Callable[[], bool] | None) -> None:
    """Raise NumericalError once the interrupt says that the work is to end."""
    if interrupt is not None and interrupt():
        raise NumericalError("interrupted before the chain was fitted")
