import datetime as dt

import numpy as np
import pytest

from pricing_core.chains.cleaning import FLAGS, as_words, counts, flag_quotes, usable
from pricing_core.chains.quotes import read_quotes
from pricing_core.chains.read_chain import read_chain
from pricing_core.errors import InvalidInputError

GOOD = {
    "underlying_symbol": "XYZ",
    "underlying_price": 100.0,
    "quote_date": "2026-03-02",
    "expiration": "2026-06-19",
    "strike": 100.0,
    "option_type": "call",
    "contract_symbol": "XYZ260619C00100000",
    "contract_multiplier": 100,
    "bid": 5.0,
    "ask": 5.2,
}


def flagged(*changes: dict, valuation: object = None) -> list[str]:
    """Return the flags of rows that differ from a good one, behind two good rows."""
    fillers = [
        {"strike": 90.0, "contract_symbol": "XYZ260619C00090000", "bid": 11.5, "ask": 11.8},
        {"strike": 110.0, "contract_symbol": "XYZ260619C00110000", "bid": 1.5, "ask": 1.6},
    ]
    rows = [GOOD | change for change in (*fillers, *changes)]
    quotes = read_quotes(read_chain(rows), valuation)
    words = as_words(flag_quotes(quotes))
    assert words[:2] == ["", ""]
    return words[2:]


@pytest.mark.parametrize(
    ("change", "flag"),
    [
        ({}, ""),
        ({"bid": 5.4}, "crossed"),
        ({"bid": 5.2}, "locked"),
        ({"bid": 0.0}, "one_sided"),
        ({"ask": None}, "one_sided"),
        ({"bid": 0.0, "ask": 0.0}, "zero"),
        ({"bid": None, "ask": None}, "zero"),
        ({"bid": -1.0}, "unreadable"),
        ({"strike": "x"}, "unreadable"),
        ({"strike": 0.0}, "unreadable"),
        ({"expiration": "2026-02-20", "contract_symbol": None}, "expired"),
        ({"quote_date": "2026-02-27"}, "stale"),
        ({"underlying_price": 101.0}, "stale"),
        ({"contract_multiplier": 10}, "adjusted"),
        ({"contract_symbol": "XYZ1260619C00100000"}, "adjusted"),
        ({"strike": 80.0, "contract_symbol": None, "bid": 19.0, "ask": 19.2}, "below_intrinsic"),
        ({"strike": 80.0, "contract_symbol": None, "bid": 19.4, "ask": 20.5}, ""),
    ],
)
def test_each_reason_is_a_flag_of_its_row(change, flag):
    assert flagged(change) == [flag]


def test_of_several_quotes_of_an_option_the_narrowest_sound_one_counts():
    assert flagged({}, {"bid": 5.05, "ask": 5.1}, {"bid": 5.3}) == ["duplicate", "", "duplicate,crossed"]


def test_flags_are_counted_and_told_ones_take_part():
    rows = [
        GOOD,
        GOOD | {"bid": 5.2, "strike": 105.0, "contract_symbol": None},
        GOOD | {"bid": 9.0, "strike": 110.0},
    ]
    flags = flag_quotes(read_quotes(read_chain(rows)))
    assert counts(flags) == {"crossed": 1, "locked": 1}
    assert usable(flags).tolist() == [True, True, False]
    assert set(flags) <= set(FLAGS)


def test_the_valuation_is_the_latest_date_unless_given():
    table = read_chain([GOOD, GOOD | {"quote_date": "2026-03-03", "strike": 105.0}])
    assert read_quotes(table).valuation == dt.date(2026, 3, 3)
    quotes = read_quotes(table, "2026-03-02T10:00")
    assert quotes.valuation == dt.datetime(2026, 3, 2, 10)
    assert np.allclose(quotes.expiry, (109.0 + 6.0 / 24.0) / 365.0, rtol=0.0, atol=1e-15)


@pytest.mark.parametrize(
    ("name", "other"), [("underlying_symbol", "ABC"), ("currency", "EUR"), ("exercise", "european")]
)
def test_mixed_chains_are_refused(name, other):
    first = {"currency": "USD", "exercise": "american"}
    table = read_chain([GOOD | first, GOOD | first | {name: other, "strike": 105.0}])
    with pytest.raises(InvalidInputError, match=f"{name} .*one by one"):
        read_quotes(table)


def test_a_table_without_a_readable_row_says_what_is_wrong_with_the_first():
    with pytest.raises(InvalidInputError, match="strike = 'x'"):
        read_quotes(read_chain([GOOD | {"strike": "x"}]))
