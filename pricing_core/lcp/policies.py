"""The loop of Howard's policy iteration: evaluate a policy, improve it, until it cannot be improved."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

from pricing_core.errors import IterationLimitError

Policy = TypeVar("Policy")
Value = TypeVar("Value")


def iterate_policies(
    evaluate: Callable[[Policy], Value],
    improve: Callable[[Value], Policy | None],
    policy: Policy,
    *,
    limit: int,
    remedy: str = "raise max_iterations",
) -> tuple[Value, int]:
    """Return the value of the first policy that cannot be improved, and the number of evaluations.

    Parameters
    ----------
    evaluate : callable
        Solves the equations that a policy leaves.
    improve : callable
        A better policy for that value, or None.
    policy
        The first one.
    remedy : str
        Ends the message of the error.

    Raises
    ------
    IterationLimitError
        `limit` evaluations were not enough.

    Notes
    -----
    Source: Howard 1960. It is Newton's method on min over policies of the residual = 0.

    Examples
    --------
    The least of three costs:

    >>> cost = [3.0, 1.0, 2.0]
    >>> iterate_policies(lambda k: k, lambda k: 1 if cost[k] > 1.0 else None, 0, limit=9)
    (1, 2)
    """
    for iteration in range(1, limit + 1):
        value = evaluate(policy)
        following = improve(value)
        if following is None:
            return value, iteration
        policy = following
    raise IterationLimitError(f"policy iteration did not converge within {limit} iterations: {remedy}")
