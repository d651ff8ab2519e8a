"""What the documentation says of the chapter's road beside the averaged march."""

import pytest

from benchmarks.nodal_methods import cheapest


@pytest.mark.nightly
def test_an_error_costs_what_the_documentation_says() -> None:
    march, crank_nicolson, sdirk = map(cheapest, ("averaged march", "Crank-Nicolson", "SDIRK2"))
    assert (march.at_1e_5, march.at_1e_6) == (1_536, 6_144)
    assert (crank_nicolson.at_1e_5, crank_nicolson.at_1e_6) == (16_384, 524_288)
    assert sdirk.at_1e_5 == 65_536
