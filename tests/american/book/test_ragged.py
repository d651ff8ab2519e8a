import numpy as np
import pytest

from pricing_core.american.book.ragged import Ragged, gather, join_starts, starts

ROWS = [(1.0, 2.0), (), (3.0,), (4.0, 5.0, 6.0), ()]
COLUMN = Ragged.of(ROWS)


def lists(column):
    return [column.row(row) for row in range(column.first.size - 1)]


def test_lists_come_back_as_they_were():
    assert lists(COLUMN) == ROWS
    assert COLUMN.counts().tolist() == [2, 0, 1, 3, 0]
    assert COLUMN.owner().tolist() == [0, 0, 2, 3, 3, 3]
    assert lists(Ragged.empty(3)) == [(), (), ()]
    assert Ragged.of([]).first.tolist() == [0]


@pytest.mark.parametrize("rows", [[], [1], [3, 0, 3, 4], [4, 3, 2, 1, 0], [1, 4]])
def test_taking_rows_takes_their_lists(rows):
    taken = COLUMN.take(np.array(rows, dtype=np.intp))
    assert lists(taken) == [ROWS[row] for row in rows]
    nothing = Ragged.empty(5).take(np.array(rows, dtype=np.intp))
    assert lists(nothing) == [()] * len(rows)


def test_concatenation_puts_one_behind_the_other():
    some = COLUMN.take(np.array([3, 1]))
    assert lists(Ragged.concatenated([COLUMN, some])) == [*ROWS, ROWS[3], ()]
    assert lists(Ragged.concatenated([Ragged.empty(2), Ragged.of([(7.0,)]), some])) == [
        (),
        (),
        (7.0,),
        ROWS[3],
        (),
    ]


def test_replacing_rows_takes_their_lists_in_order():
    found = COLUMN.replaced(np.array([3, 1]), Ragged.of([(8.0,), (9.0, 10.0)]))
    assert lists(found) == [(1.0, 2.0), (9.0, 10.0), (3.0,), (8.0,), ()]
    assert lists(COLUMN) == ROWS
    assert lists(COLUMN.replaced(np.array([0]), Ragged.empty(1))) == [(), *ROWS[1:]]
    nothing = Ragged.empty(4)
    assert nothing.replaced(np.array([2]), Ragged.empty(1)) is nothing


def test_starts_of_parts():
    first = starts(np.array([2, 0, 3]))
    assert first.tolist() == [0, 2, 2, 5]
    together, chosen = gather(first, np.array([2, 0, 1]))
    assert together.tolist() == [0, 3, 5, 5]
    assert chosen.tolist() == [2, 3, 4, 0, 1]
    assert join_starts([first, together]).tolist() == [0, 2, 2, 5, 8, 10, 10]
