"""Contracts packed for the kernel: money in strikes, an escrow in the place of the drops; no kernel is needed."""

import math

import numpy as np
import pytest

from pricing_core.american import Market, Option
from pricing_core.american.book.book import Book
from pricing_core.american.engines.multiplier_collocation.levels import pack
from pricing_core.american.engines.multiplier_collocation.served import log_moneyness
from tests.problems.schedules import CONTRACTS

BOOK = Book.of(list(CONTRACTS.values()))


def test_money_is_counted_in_strikes():
    dividends = [{"time": 0.5, "amount": 3.0}]
    option, market = Option("put", 50.0, 1.0), Market(60.0, 0.05, 0.2, 0.01, cash_dividends=dividends)
    packed = pack(Book.of([(option, market)]))
    assert packed.sign.tolist() == [1.0]
    assert packed.x[0] == pytest.approx(math.log(1.2), abs=1e-15)
    # duration, rate, dividend yield, volatility, exercisable, exercise at end, fraction, amount, escrow
    assert packed.segments.tolist() == [
        [0.5, 0.05, 0.01, 0.2, 1.0, 1.0, 0.0, 0.06, 0.0],
        [0.5, 0.05, 0.01, 0.2, 1.0, 1.0, 0.0, 0.0, 0.0],
    ]


def test_an_escrow_takes_the_place_of_the_drops():
    dividends = [{"time": 0.5, "amount": 3.0}]
    market = Market(60.0, 0.05, 0.2, 0.01, cash_dividends=dividends, dividend_model="escrowed")
    book = Book.of([(Option("call", 50.0, 1.0), market)])
    packed = pack(book)
    assert packed.sign.tolist() == [-1.0]
    assert packed.segments[:, 7:].tolist() == [[0.0, 0.06], [0.0, 0.0]]
    assert packed.x[0] == pytest.approx(math.log((60.0 - 3.0 * math.exp(-0.025)) / 50.0), abs=1e-15)


def test_taking_rows_and_packing_may_be_exchanged():
    rows = np.array([7, 2, 11, 2])
    one, other = pack(BOOK).take(rows), pack(BOOK.take(rows))
    for name in ("sign", "x", "first", "segments"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))
    assert pack(BOOK).european().segments[:, 4:6].sum() == 0.0
    np.testing.assert_array_equal(pack(BOOK).european().segments, pack(BOOK.european()).segments)


def test_a_spot_of_zero_is_infinitely_far_away():
    assert log_moneyness(Book.of([(Option("put", 50.0, 1.0), Market(0.0, 0.05, 0.2))])) == -math.inf
