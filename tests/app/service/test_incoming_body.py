import numpy as np

from app.service.incoming_body import LINES_AT_A_TIME, MOST_LINES, _end_of_lines


def test_lines_are_cut_between_lines_and_few_at_a_time_however_short_they_are() -> None:
    rng = np.random.default_rng(61)
    for longest in (1, 3, 60, 3000):
        lengths = rng.integers(0, longest, 3 * MOST_LINES)
        left = bytearray(b"".join(b"x" * length + b"\n" for length in lengths.tolist()) + b"unfinished")
        while end := _end_of_lines(left):
            assert left[end - 1 : end] == b"\n"
            assert end <= LINES_AT_A_TIME
            assert left.count(b"\n", 0, end) <= MOST_LINES
            full = left.count(b"\n", 0, end) == MOST_LINES
            assert full or b"\n" not in left[end:LINES_AT_A_TIME]
            del left[:end]
        assert left == b"unfinished"
