import numpy as np
import pytest

from pricing_core.american.book.book import Book
from pricing_core.american.book.cuts import with_cuts
from pricing_core.american.book.ragged import Ragged
from tests.problems.random_events import random_contracts
from tests.problems.schedules import CONTRACTS, terms_of

CONTRACT = CONTRACTS["put, quarterly dividends"]


def cut_alone(contract, times):
    return with_cuts(Book.of([contract]), Ragged.of([times]))


def test_a_cut_inherits_the_segment_and_moves_its_event_to_the_last_part():
    found = cut_alone(CONTRACT, (0.2,)).segments
    assert found.end.tolist() == [0.125, 0.2, 0.375, 0.625, 0.875, 1.0]
    assert found.start.tolist() == [0.0, 0.125, 0.2, 0.375, 0.625, 0.875]
    assert found.due.tolist() == [1.0, 0.0, 1.0, 1.0, 1.0, 0.0]
    assert found.exercise_at_end.all()


def test_a_cut_of_a_segment_that_may_not_be_exercised_may_not_be_either():
    found = cut_alone(CONTRACTS["put, monthly dates"], (0.1,)).segments
    assert found.end[:3].tolist() == pytest.approx([1 / 12, 0.1, 1 / 6])
    assert found.exercise_at_end[:3].tolist() == [True, False, True]


@pytest.mark.parametrize(
    "times", [(), (0.0,), (1.0,), (1.5,), (-1.0,), (0.125,), (0.125 + 1e-14,), (1.0 - 1e-14,)]
)
def test_cuts_at_events_and_outside_of_life_change_nothing(times):
    book = Book.of([CONTRACT])
    assert with_cuts(book, Ragged.of([times])) is book


def test_every_contract_has_its_own_cuts():
    book = Book.of([CONTRACTS["put, window"], CONTRACT, CONTRACTS["call, curves"]])
    found = with_cuts(book, Ragged.of([(0.25, 0.75), (), (0.1,)]))
    assert np.diff(found.first).tolist() == [4, 5, 4]
    for row, cuts in enumerate([(0.25, 0.75), (), (0.1,)]):
        alone = with_cuts(book.take(np.array([row])), Ragged.of([cuts]))
        assert terms_of(found, row) == terms_of(alone)


def test_a_cut_contract_is_the_same_contract():
    """The same parameters at every time, the same events, the same escrow."""
    contracts = random_contracts(1, 60)
    rng = np.random.default_rng(2)
    book = Book.of(contracts)
    times = Ragged.of([tuple(rng.uniform(0.0, 1.2 * option.expiry, 4)) for option, _ in contracts])
    found = with_cuts(book, times)
    assert found.segments.end.size > book.segments.end.size
    assert found.expiry.tolist() == book.expiry.tolist()
    np.testing.assert_allclose(found.escrow_now(), book.escrow_now(), rtol=1e-13)
    for row in range(book.count):
        whole, parts = book.segments_of(row), found.segments_of(row)
        assert {s.end for s in whole} <= {s.end for s in parts}
        for part in parts:
            owner = next(s for s in whole if part.end <= s.end)
            for name in ("rate", "dividend_yield", "volatility", "exercisable"):
                assert getattr(part, name) == getattr(owner, name)
            last = part.end == owner.end
            assert (part.due, part.fraction) == ((owner.due, owner.fraction) if last else (0.0, 0.0))
            assert part.escrow == pytest.approx(owner.escrow_at(part.end), rel=1e-13)
