"""The benchmark of frictional contact: its closed forms are met, and a line says by how much."""

import pytest

from benchmarks.friction import OURS, by_us, line
from benchmarks.lcs.contact_problems import problems


@pytest.mark.parametrize("problem", problems(), ids=lambda problem: problem.name)
def test_both_schemes_come_near_the_closed_form(problem):
    for scheme in OURS:
        found = by_us(problem, 1e-2, scheme)
        assert (found is None) == (scheme == "stewart-trinkle" and problem.system.restitution > 0.0)
        if found is not None:
            words = line(problem, 1e-2, scheme, found).removeprefix(problem.name).split()
            assert words[1] == scheme
            assert float(words[2]) <= 0.06
            assert float(words[4]) <= 1e-12
