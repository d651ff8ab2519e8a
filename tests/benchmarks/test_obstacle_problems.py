"""The study of obstacle problems: every family is tried, and errors lie within their estimates."""

import numpy as np
import pytest

from benchmarks.obstacle_problems import FAMILIES, Family, study


def share_within(found: list[Family]) -> float:
    return sum(one.within_estimate * one.problems for one in found) / sum(one.problems for one in found)


def test_a_few_problems_of_every_family_lie_within_their_estimates() -> None:
    found = study(10)
    assert [one.family for one in found] == [*FAMILIES]
    assert share_within(found) > 0.95
    assert all(one.met_tolerance == 1.0 for one in found)


@pytest.mark.nightly
def test_nearly_all_of_two_thousand_do() -> None:
    found = study(2_000)
    assert share_within(found) >= 0.99
    assert all(one.within_estimate >= 0.98 for one in found)
    medians = np.repeat([one.median_estimate_in_errors for one in found], [one.problems for one in found])
    assert np.nanmedian(medians) <= 30.0
