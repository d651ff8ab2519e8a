import math

import pytest

from benchmarks.option_engine.goals import Goal


@pytest.mark.parametrize(
    ("goal", "verdict"),
    [
        (Goal("ratio", ">=", 10.0, 12.0), "reached"),
        (Goal("ratio", ">=", 10.0, 10.0, least=5.0), "reached"),
        (Goal("ratio", ">=", 10.0, 8.0, least=5.0), "missed by a factor of 1.25, the least is reached"),
        (Goal("ratio", ">=", 10.0, 4.0, least=5.0), "missed by a factor of 2.5"),
        (Goal("ratio", ">=", 10.0, 0.0), "missed altogether"),
        (Goal("cost", "<=", 3.5, 3.0), "reached"),
        (Goal("cost", "<=", 3.5, 7.0), "missed by a factor of 2"),
        (Goal("cost", "<=", 3.5, None), "not measured"),
        (Goal("cost", "<=", 3.5, math.nan), "not measured"),
    ],
)
def test_the_verdict_says_by_how_much_a_goal_is_missed(goal, verdict):
    assert goal.verdict() == verdict
