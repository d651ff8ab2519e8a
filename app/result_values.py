"""Results of the library as JSON has them."""

import math
from collections.abc import Iterable
from typing import Any

from pricing_core.american.contracts.result_fields import ResultField


def by_name(outputs: Iterable[ResultField], found: object) -> dict[str, Any]:
    """Return outputs of a result by name: arrays and tuples as lists, None in the place of a NaN in a list.

    A number that is not finite stays, for the answer to refuse.
    """
    return {output.name: _plain(output, getattr(found, output.name)) for output in outputs}


def _plain(output: ResultField, value: Any) -> Any:
    if output.kind != "list" or value is None:
        return value
    return [None if math.isnan(number) else float(number) for number in value]
