"""Limits on the size of the rows of a batch, and on their columns."""

from collections.abc import Sequence

from app.service.contract_schema import MOST_DIVIDENDS, MOST_PIECES
from pricing_core.american.arrow.schema import check_names
from pricing_core.american.contracts.fields import CASH_DIVIDENDS, COLUMN_FIELDS, PROPORTIONAL_DIVIDENDS
from pricing_core.errors import UnknownNameError

MOST_ROWS = 1_000_000  # of a batch; chosen
MOST_JSON_ROWS = (
    100_000  # of one that is asked or answered as one JSON object, which is held as a whole; chosen
)
LONGEST_COLUMNS = 1 << 21  # bytes of a batch as one JSON object: while C parses it nobody is answered; chosen
PIECE_WEIGHT = 4_096  # rows and entries of their lists that are priced together; chosen
LONGEST_TEXT = 16_384  # bytes of a cell of text; chosen

FIELDS = {field.name: field for field in COLUMN_FIELDS}


def most_entries(name: str) -> int:
    """Return the largest length of the lists in a column."""
    if name in (CASH_DIVIDENDS.name, PROPORTIONAL_DIVIDENDS.name):
        return MOST_DIVIDENDS
    return MOST_PIECES if FIELDS[name].kind == "curve" else FIELDS[name].most_entries


def check_columns(names: Sequence[str]) -> None:
    """Accept the names of columns.

    Raises
    ------
    InvalidInputError
        A name appears twice, is misspelt or unknown, or a required column is missing.
    """
    unknown = [name for name in names if name not in FIELDS]
    if unknown:
        raise UnknownNameError("column", unknown, FIELDS)
    check_names(names)
