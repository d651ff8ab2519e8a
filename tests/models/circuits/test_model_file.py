"""Circuits survive the way into JSON and back."""

import json
from fractions import Fraction

import pytest

from pricing_core.errors import InvalidInputError
from pricing_core.lcs import piecewise_linear
from pricing_core.models import (
    DiodeCircuit,
    PiecewiseConstant,
    Sine,
    circuit_from_json,
    circuit_to_json,
)
from tests.problems import circuits


def all_kinds() -> DiodeCircuit:
    ramp, step = piecewise_linear([0.0, 1.0], [0.0, 2.0]), PiecewiseConstant([0.5, 1.0], [1.0, 3.0])
    circuit = DiodeCircuit().voltage_source("V1", "a", "0", Sine(3.0, 2.0, 0.5, 1.0))
    circuit.current_source("I1", "0", "b", ramp).voltage_source("V2", "s", "0", step).resistor(
        "RS", "s", "a", 1
    )
    circuit.resistor("R1", "b", "0", Fraction(1, 3)).inductor("L1", "a", "c", 0.25, 1).diode("D1", "c", "d")
    circuit.inductor("L2", "d", "0", 1).coupling("K1", "L1", "L2", 0.5).capacitor("C1", "d", "0", 0.1, 2)
    circuit.transformer("X1", "d", "0", "e", "0", 2).resistor("R2", "e", "0", 1)
    circuit.vcvs("E1", "f", "0", "e", "0", 2).vccs("G1", "0", "g", "f", "0", 2).resistor("R3", "g", "0", 1)
    return circuit.ccvs("H1", "h", "0", "R3", 2).cccs("F1", "0", "i", "R3", 2).resistor("R4", "i", "0", 1)


@pytest.mark.parametrize(
    ("build", "end"), [(all_kinds, 1.5), (circuits.filtered_bridge, 1e-3), (circuits.resonant_converter, 9.0)]
)
def test_a_circuit_comes_back_the_same(build, end):
    circuit = build()
    stated = circuit_to_json(circuit)
    back = circuit_from_json(json.loads(json.dumps(stated)))
    assert circuit_to_json(back) == stated
    one, other = (c.simulate((0.0, end), t_eval=[0.3 * end, end]) for c in (circuit, back))
    assert one.trajectory.x == pytest.approx(other.trajectory.x, rel=1e-12)
    for node, voltage in one.voltages.items():
        assert other.voltage(node) == pytest.approx(voltage, rel=1e-12)


def test_a_netlist_may_stand_in_the_place_of_elements():
    circuit = circuit_from_json(
        {"model": "circuit", "netlist": "R1 a 0 1k\nC1 a 0 1u IC=1", "t_span": [0, 1]}
    )
    assert pytest.approx(-1000.0) == circuit.to_lcs().system.A


def with_element(**stated):
    return {"model": "circuit", "elements": [stated]}


@pytest.mark.parametrize(
    ("parsed", "message"),
    [
        ({"model": "lcs"}, r"model = 'lcs': must be \"circuit\""),
        ({"model": "circuit"}, r"either as \"netlist\" or as \"elements\""),
        ({"model": "circuit", "netlist": "", "elements": []}, r"either as"),
        ({"model": "circuit", "netlist": 5}, r"netlist = 5: must be a text"),
        ({"model": "circuit", "elements": {}}, r"elements = {}: must be a list"),
        ({"model": "circuit", "elements": [], "wires": 1}, r"\['wires'\]: must be without keys"),
        (with_element(kind="tube"), r"kind of an element = 'tube': must be one of resistor"),
        ({"model": "circuit", "elements": [5]}, r"kind of an element = None"),
        (with_element(kind="resistor", name="R1", volts=5), r"resistor R1 = 'volts': must be given by name"),
        (
            with_element(kind="resistor", name="R1", plus="a", minus="0"),
            r"must be given by all of name, plus",
        ),
        (
            with_element(kind="resistor", name="R1", plus="a", minus="0", ohms="1/0"),
            r"ohms of resistor R1 = '1/0': must be a number",
        ),
        (
            with_element(kind="resistor", name=["R"], plus="a", minus="0", ohms=1),
            r"name = \['R'\]: must be a string",
        ),
        (
            with_element(kind="voltage_source", name="V1", plus="a", minus="0", value={"square": {}}),
            r"value of voltage_source V1 = \['square'\]: must be one of sine",
        ),
        (
            with_element(
                kind="voltage_source", name="V1", plus="a", minus="0", value={"sine": {"hertz": 50}}
            ),
            r"must be the arguments of sine",
        ),
        (
            with_element(kind="voltage_source", name="V1", plus="a", minus="0", value={"sine": 5}),
            r"must be the arguments of sine",
        ),
        (
            with_element(
                kind="voltage_source",
                name="V1",
                plus="a",
                minus="0",
                value={"sine": {"amplitude": "a", "frequency": 1}},
            ),
            r"amplitude = 'a': must be a finite number",
        ),
    ],
)
def test_what_is_no_circuit_is_refused(parsed, message):
    with pytest.raises(InvalidInputError, match=message):
        circuit_from_json(parsed)
