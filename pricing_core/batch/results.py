"""The sound rows of a chunk priced, and what the others lack."""

import json
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from pricing_core.american import price_many
from pricing_core.american.price_table import SENSITIVITIES
from pricing_core.american.tables.columns import as_objects
from pricing_core.arrays import Vector
from pricing_core.batch.contracts import Contracts, explain
from pricing_core.batch.schema import RESULT_FLAG, RESULT_NUMBERS, RESULT_TEXTS, result_schema
from pricing_core.errors import InvalidInputError

INVALID = "invalid_input"
Reasons = Mapping[int, InvalidInputError]


def price_contracts(contracts: Contracts, threads: int | None) -> tuple[pa.RecordBatch, Reasons]:
    """Price the sound rows; return one row of results per contract and, by index, why a row has no price.

    Parameters
    ----------
    threads : int, optional
        Passed to `price_many`.
    """
    rows = len(contracts.columns["tolerance"])
    numbers = {name: np.full(rows, np.nan) for name in RESULT_NUMBERS}
    flag = np.zeros(rows, dtype=bool)
    schema = result_schema(list(contracts.columns))
    names = [name for name in schema.names if name in (*RESULT_TEXTS, SENSITIVITIES)]
    texts: dict[str, NDArray[np.object_]] = {name: np.full(rows, "", dtype=object) for name in names}
    texts["status"][list(contracts.faults)] = INVALID
    reasons = dict(contracts.faults)
    sound = [index for index in range(rows) if index not in contracts.faults]
    if sound:
        table = price_many(_columns(contracts, sound), threads=threads)
        for name in RESULT_NUMBERS:
            numbers[name][sound] = table[name]
        flag[sound] = table[RESULT_FLAG]
        for name in names:
            texts[name][sound] = _as_json(table[name]) if name == SENSITIVITIES else table[name]
        reasons.update(_unpriced(contracts, sound, table))
    return _result_table(numbers, flag, texts, reasons, schema), reasons


def _columns(contracts: Contracts, sound: Sequence[int]) -> dict[str, NDArray[Any]]:
    # As objects: an array of text gives every cell the width of the longest and drops trailing NULs.
    return {name: as_objects([values[i] for i in sound]) for name, values in contracts.columns.items()}


def _as_json(sensitivities: NDArray[np.object_]) -> list[str]:
    """Return a list of numbers per row as text, "" for none, null for NaN."""
    finite = ([None if math.isnan(number) else number for number in row] for row in sensitivities)
    return [json.dumps(numbers) if numbers else "" for numbers in finite]


def _unpriced(contracts: Contracts, sound: Sequence[int], table: Mapping[str, NDArray[Any]]) -> Reasons:
    reasons: dict[int, InvalidInputError] = {}
    for position in np.flatnonzero(np.isnan(table["price"])).tolist():
        index = sound[position]
        status, message = str(table["status"][position]), str(table["message"][position])
        fault = InvalidInputError("", status, f"within reach of the method ({message or status})")
        reasons[index] = explain(contracts.row(index)) or fault
    return reasons


def _result_table(
    numbers: Mapping[str, Vector],
    flag: NDArray[np.bool_],
    texts: Mapping[str, NDArray[np.object_]],
    reasons: Reasons,
    schema: pa.Schema,
) -> pa.RecordBatch:
    unknown = np.zeros(flag.size, dtype=bool)
    unknown[list(reasons)] = True
    arrays = [pa.array(numbers[name], from_pandas=True) for name in RESULT_NUMBERS]  # NaN is null
    arrays.append(pa.array(flag, mask=unknown))
    arrays.extend(pa.array([text or None for text in column], pa.string()) for column in texts.values())
    return pa.RecordBatch.from_arrays(arrays, schema=schema)
