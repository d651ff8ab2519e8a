"""A hybrid representation is found wherever there is one, and its absence is reported."""

import numpy as np
import pytest

from pricing_core.errors import InvalidInputError
from pricing_core.linalg.rational import rational_array
from pricing_core.models import DiodeCircuit
from pricing_core.models.circuits.ports import chosen_multipliers
from pricing_core.models.circuits.tableau import Tableau


def model(*parts: tuple[str, ...]):
    circuit = DiodeCircuit()
    for method, *arguments in parts:
        getattr(circuit, method)(*arguments)
    return circuit.to_lcs()


@pytest.mark.parametrize(
    ("parts", "multipliers"),
    [
        ([("capacitor", "S", "a", "0", 1), ("diode", "D", "a", "0")], ("i(D)",)),
        ([("inductor", "S", "a", "0", 1), ("diode", "D", "a", "0")], ("-v(D)",)),
        ([("voltage_source", "S", "a", "0", 1), ("diode", "D", "a", "0")], ("i(D)",)),
        ([("current_source", "S", "a", "0", 1), ("diode", "D", "a", "0")], ("-v(D)",)),
        (
            [("resistor", "S", "a", "0", 1), ("diode", "D", "a", "0"), ("diode", "E", "a", "0")],
            ("i(D)", "i(E)"),
        ),
        (
            [("resistor", "S", "a", "0", 1), ("diode", "D", "a", "b"), ("diode", "E", "b", "0")],
            ("i(D)", "-v(E)"),
        ),
    ],
    ids=["capacitor", "inductor", "voltage", "current", "parallel", "series"],
)
def test_the_multiplier_is_what_the_network_leaves_free(parts, multipliers):
    found = model(*parts)
    assert found.multiplier_names == multipliers
    assert found.is_passive


def test_a_voltage_that_nothing_determines_is_named():
    """E1 copies the voltage across itself."""
    with pytest.raises(InvalidInputError, match=r"'v\(a\), i\(R1\), i\(E1\)': must be determined"):
        model(("resistor", "R1", "a", "0", 1), ("vcvs", "E1", "a", "0", "a", "0", 1))


def equations_of_two_diodes(K) -> tuple[Tableau, np.ndarray]:
    """K (i1, i2, v1, v2) = 0 and nothing else."""
    unknowns = (("i", "D1"), ("i", "D2"), ("reverse", "D1"), ("reverse", "D2"))
    none = rational_array(np.zeros((0, 0)))
    rows = rational_array(np.array(K))
    return Tableau((), unknowns, (), ("D1", "D2"), none, none, none, rows, none), rows


def test_a_diode_whose_current_and_voltage_are_fixed_is_refused():
    with pytest.raises(InvalidInputError, match=r"diodes = 'D1, D2': must be free to conduct or block"):
        chosen_multipliers(*equations_of_two_diodes([[1, 0, 0, 0], [0, 0, 1, 0]]))


def test_an_earlier_choice_is_taken_back_where_it_leaves_none():
    """i2 = v2 = i1: after i1 neither is left for the second diode, after v1 both are."""
    multipliers, slacks = chosen_multipliers(*equations_of_two_diodes([[1, -1, 0, 0], [1, 0, 0, -1]]))
    assert (multipliers, slacks) == ([2, 1], [0, 3])
