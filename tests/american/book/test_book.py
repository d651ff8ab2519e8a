import math
from dataclasses import replace

import numpy as np
import pytest

from pricing_core.american import Market, Option
from pricing_core.american.book.book import Book
from pricing_core.american.book.segments import Segments
from pricing_core.errors import InvalidInputError
from tests.problems.random_events import random_contracts
from tests.problems.schedules import CONTRACTS, terms_of

PLAIN = [
    (Option("put", 100.0, 1.0), Market(90.0, 0.05, 0.2)),
    (Option("call", 80.0, 0.5, "european"), Market(110.0, 0.02, 0.3, 0.04)),
    (Option("put", 100.0, 0.0), Market(0.0, 0.05, 0.2)),
]
EVERYTHING = [*PLAIN, *CONTRACTS.values(), *random_contracts(1, 60)]


def assert_same_books(one, other):
    for name in ("is_put", "strike", "spot", "escrowed", "first"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name), err_msg=name)
    for name in Segments.__slots__:
        np.testing.assert_array_equal(
            getattr(one.segments, name), getattr(other.segments, name), err_msg=name
        )
    for name in ("cash_dividends", "rate", "dividend_yield", "volatility"):
        mine, its = getattr(one.listed, name), getattr(other.listed, name)
        np.testing.assert_array_equal(mine.first, its.first, err_msg=name)
        np.testing.assert_array_equal(mine.values, its.values, err_msg=name)


def test_a_contract_without_events_has_one_segment():
    book = Book.of(PLAIN)
    assert book.is_simple
    assert book.is_plain
    assert book.count == 3
    assert book.first.tolist() == [0, 1, 2, 3]
    assert book.sign.tolist() == [1.0, -1.0, 1.0]
    assert book.expiry.tolist() == [1.0, 0.5, 0.0]
    assert book.segments.exercisable.tolist() == [True, False, True]
    assert book.payoff().tolist() == [10.0, 30.0, 100.0]
    assert book.now is book.segments


def test_a_contract_with_events_has_a_segment_up_to_each():
    book = Book.of([PLAIN[0], CONTRACTS["put, quarterly dividends"], CONTRACTS["call, curves"]])
    assert not book.is_simple
    assert not book.is_plain
    assert book.first.tolist() == [0, 1, 6, 9]
    assert book.expiry.tolist() == [1.0, 1.0, 1.0]
    assert book.segments.end[1:6].tolist() == [0.125, 0.375, 0.625, 0.875, 1.0]
    assert book.segments.due[1:6].tolist() == [1.0, 1.0, 1.0, 1.0, 0.0]
    assert book.segments.volatility[6:].tolist() == [0.15, 0.4, 0.2]
    assert book.now.end.tolist() == [1.0, 0.125, 0.3]
    assert book.per_segment(book.strike).size == 9
    assert book.segments.duration[1] == 0.125


def test_a_dividend_at_expiry_makes_no_segment_but_is_an_event():
    book = Book.of([CONTRACTS["put, dividend at expiry"]])
    assert book.is_simple
    assert not book.is_plain


def test_every_contract_of_a_book_is_what_it_is_alone():
    book = Book.of(EVERYTHING)
    for row, contract in enumerate(EVERYTHING):
        assert terms_of(book, row) == terms_of(Book.of([contract]))


def test_the_escrow_of_a_segment_is_the_worth_of_the_dividends_to_come():
    book = Book.of(EVERYTHING)
    for row in np.flatnonzero(book.escrowed).tolist():
        segments = book.segments_of(row)
        growth = np.append(0.0, np.cumsum([s.rate * s.duration for s in segments]))
        for k, segment in enumerate(segments):
            later = zip(segments[k:], growth[k + 1 :], strict=True)
            worth = math.fsum(s.due * math.exp(growth[k + 1] - grown) for s, grown in later)
            assert segment.escrow == pytest.approx(worth, rel=1e-14)
            assert segment.amount == 0.0
            assert segment.escrow_at(segment.start) == pytest.approx(
                worth * math.exp(growth[k] - growth[k + 1]), rel=1e-14
            )


def test_what_is_listed_is_what_the_market_lists_whatever_counts():
    dividends = [{"time": t, "amount": 1.0} for t in (0.0, 0.5, 2.0)]  # gone, due, after expiry
    market = Market(100.0, {"times": [0.5, 3.0], "values": [0.01, 0.02]}, 0.2, cash_dividends=dividends)
    listed = Book.of([PLAIN[0], (Option("put", 100.0, 1.0), market)]).listed
    assert (listed.cash_dividends.row(0), listed.cash_dividends.row(1)) == ((), (0.0, 0.5, 2.0))
    assert (listed.rate.row(1), listed.dividend_yield.row(1), listed.volatility.row(1)) == (
        (0.5, 3.0),
        (),
        (),
    )


@pytest.mark.parametrize("rows", [[], [2], [5, 0, 5], list(range(len(EVERYTHING)))[::-1]])
def test_taking_rows_gives_the_book_of_these_contracts(rows):
    chosen = np.array(rows, dtype=np.intp)
    assert_same_books(Book.of(EVERYTHING).take(chosen), Book.of([EVERYTHING[row] for row in rows]))
    few = [row for row in rows if row < len(PLAIN)]
    assert_same_books(Book.of(PLAIN).take(np.array(few, dtype=np.intp)), Book.of([PLAIN[row] for row in few]))


def test_taking_everything_in_order_is_the_book_itself():
    book = Book.of(EVERYTHING)
    assert book.take(np.arange(book.count)) is book
    assert book.take(np.arange(book.count)[::-1]) is not book


@pytest.mark.parametrize("rows", [slice(0, 2), slice(1, 3), slice(2, 2)])
@pytest.mark.parametrize("contracts", [PLAIN, EVERYTHING], ids=["simple", "with events"])
def test_a_part_holds_consecutive_contracts(contracts, rows):
    book = Book.of(contracts)
    part = book.part(rows)
    assert_same_books(part, Book.of(contracts[rows]))
    if book.is_simple and part.count:
        assert np.shares_memory(part.segments.rate, book.segments.rate)


@pytest.mark.parametrize(
    ("one", "other"), [(PLAIN, EVERYTHING), (EVERYTHING, PLAIN), (PLAIN, PLAIN), (PLAIN, [])]
)
def test_concatenated_books_are_one_behind_the_other(one, other):
    parts = [Book.of(one), Book.of(other), Book.of(one)]
    assert_same_books(Book.concatenated(parts), Book.of([*one, *other, *one]))


def test_places_go_through_every_segment_forward_and_backward():
    book = Book.of(EVERYTHING)
    counts = np.diff(book.first)
    for backward in (False, True):
        seen = []
        for place, (rows, at) in enumerate(book.by_place(backward=backward)):
            assert np.all(counts[rows] > place)
            expected = book.first[rows + 1] - 1 - place if backward else book.first[rows] + place
            np.testing.assert_array_equal(at, expected)
            seen += at.tolist()
        assert sorted(seen) == list(range(int(book.first[-1])))


def test_an_escrow_is_what_the_dividends_still_due_are_worth():
    dividends = [{"time": 0.25, "amount": 2.0}, {"time": 0.75, "amount": 3.0}]
    rates = {"times": [0.5, 1.0], "values": [0.02, 0.08]}
    escrowed = Market(100.0, rates, 0.2, cash_dividends=dividends, dividend_model="escrowed")
    contract = Option("put", 100.0, 1.0), escrowed
    book = Book.of([contract, (contract[0], replace(escrowed, dividend_model="spot"))])
    before_second = 3.0 * math.exp(-0.08 * 0.25 - 0.02 * 0.25)  # worth at 0.25
    half = 3.0 * math.exp(-0.08 * 0.25)  # worth at 0.5
    assert book.segments.end.tolist() == [0.25, 0.5, 0.75, 1.0] * 2
    assert book.escrow() == pytest.approx([2.0 + before_second, half, 3.0, 0.0, *[0.0] * 4], rel=1e-14)
    now = (2.0 + before_second) * math.exp(-0.02 * 0.25)
    assert book.escrow_now() == pytest.approx([now, 0.0], rel=1e-14)
    assert book.drops().tolist() == [0.0, 0.0, 0.0, 0.0, 2.0, 0.0, 3.0, 0.0]
    assert book.segments.due.tolist() == [2.0, 0.0, 3.0, 0.0] * 2
    assert book.diffusing() == pytest.approx([100.0 - now, 100.0])
    assert book.diffusing_at(np.array([50.0, 60.0])).spot == pytest.approx([50.0 + now, 60.0])


def test_escrowed_dividends_worth_the_spot_are_refused():
    market = Market(10.0, 0.0, 0.2, cash_dividends=[{"time": 0.5, "amount": 10.0}], dividend_model="escrowed")
    with pytest.raises(InvalidInputError, match="must be worth less today than the spot"):
        Book.of([PLAIN[0], (Option("put", 100.0, 1.0), market)])


def test_the_european_book_has_the_same_events_without_exercise():
    book = Book.of(EVERYTHING)
    found = book.european()
    assert not found.segments.exercisable.any()
    assert not found.segments.exercise_at_end.any()
    assert book.segments.exercisable.any()
    back = replace(
        found,
        segments=replace(
            found.segments,
            exercisable=book.segments.exercisable,
            exercise_at_end=book.segments.exercise_at_end,
        ),
    )
    assert_same_books(back, book)


def test_a_constant_volatility_takes_the_place_of_curves():
    book = Book.of(EVERYTHING)
    volatility = np.linspace(0.1, 0.5, book.count)
    found = book.with_volatility(volatility)
    np.testing.assert_array_equal(found.segments.volatility, np.repeat(volatility, np.diff(book.first)))
    assert found.listed.volatility.values.size == 0
    assert book.listed.volatility.values.size > 0
    np.testing.assert_array_equal(found.listed.rate.values, book.listed.rate.values)


def test_an_empty_book_is_a_book():
    book = Book.of([])
    assert book.count == 0
    assert book.payoff().shape == book.escrow_now().shape == book.expiry.shape == (0,)
    assert list(book.by_place()) == []
