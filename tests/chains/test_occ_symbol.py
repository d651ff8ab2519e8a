import datetime as dt

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pricing_core.chains.occ_symbol import read_occ_symbol
from pricing_core.errors import InvalidInputError

ROOTS = st.text(alphabet="ABCDEFGHIJKLMNOPQRSTUVWXYZ", min_size=1, max_size=6)


@given(
    root=ROOTS,
    day=st.dates(dt.date(2000, 1, 1), dt.date(2068, 12, 31)),
    side=st.sampled_from(["call", "put"]),
    thousandths=st.integers(1, 99_999_999),
    padded=st.booleans(),
    prefix=st.sampled_from(["", "O:"]),
)
def test_what_is_written_is_read_back(root, day, side, thousandths, padded, prefix):
    name = root.ljust(6) if padded else root
    found = read_occ_symbol(f"{prefix}{name}{day:%y%m%d}{side[0].upper()}{thousandths:08d}")
    assert (found.root, found.expiration, found.option_type) == (root, day, side)
    assert found.strike == thousandths / 1000.0


def test_an_adjusted_deliverable_shows_in_the_root():
    assert read_occ_symbol("AAPL7 140719C00092860").is_adjusted
    assert not read_occ_symbol("AAPL  140719C00650000").is_adjusted


@pytest.mark.parametrize(
    "text", ["", "AAPL", "AAPL140732C00650000", "AAPL140719X00650000", "TOOLONGS140719C00650000"]
)
def test_what_is_no_symbol_is_refused(text):
    with pytest.raises(InvalidInputError, match="contract_symbol"):
        read_occ_symbol(text)
