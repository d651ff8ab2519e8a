"""Circuits of model files: as a netlist or by elements, and what is refused with its key."""

from fractions import Fraction
from typing import Any

import pytest

from app.commands.model_keys import read_object
from app.commands.models.circuit import CIRCUIT, circuit_of
from pricing_core.errors import InvalidInputError
from pricing_core.lcs import piecewise_linear
from pricing_core.models import DiodeCircuit, PiecewiseConstant, Sine


def read(content: dict[str, Any]) -> DiodeCircuit:
    return circuit_of(read_object("", content, CIRCUIT))


def two_ended(kind: str, name: str, plus: str, minus: str, **more: Any) -> dict[str, Any]:
    return {"kind": kind, "name": name, "plus": plus, "minus": minus, **more}


SINE = {"sine": {"amplitude": 3, "frequency": "2", "phase": "1/2", "offset": 1}}
RAMP = {
    "exosystem": {
        "generator": [[0, 1], [0, 0]],
        "output": [[1, 0]],
        "states": [[0, 2], [2, 0]],
        "times": [0, 1],
    }
}
CONTROL = {"control_plus": "e", "control_minus": "0"}
ALL_KINDS = [
    two_ended("voltage_source", "V1", "a", "0", value=SINE),
    two_ended("current_source", "I1", "0", "b", value=RAMP),
    two_ended(
        "voltage_source",
        "V2",
        "s",
        "0",
        value={"piecewise_constant": {"times": ["1/2", 1], "values": [1, 3]}},
    ),
    two_ended(
        "voltage_source", "V3", "r", "0", value={"piecewise_linear": {"times": [0, 1], "values": [0, "2"]}}
    ),
    two_ended("resistor", "RS", "s", "a", ohms=1),
    two_ended("resistor", "RR", "r", "a", ohms="1k"),
    two_ended("resistor", "R1", "b", "0", ohms="1/3"),
    two_ended("inductor", "L1", "a", "c", henries=0.25, initial_current=1),
    {"kind": "diode", "name": "D1", "anode": "c", "cathode": "d"},
    two_ended("inductor", "L2", "d", "0", henries=1),
    {"kind": "coupling", "name": "K1", "first": "L1", "second": "L2", "coefficient": 0.5},
    two_ended("capacitor", "C1", "d", "0", farads="100m", initial_voltage="2"),
    {
        **{"kind": "transformer", "name": "X1", "primary_plus": "d", "primary_minus": "0"},
        **{"secondary_plus": "e", "secondary_minus": "0", "ratio": 2},
    },
    two_ended("resistor", "R2", "e", "0", ohms=1),
    two_ended("vcvs", "E1", "f", "0", gain=2, **CONTROL),
    two_ended("vccs", "G1", "0", "g", gain="2", control_plus="f", control_minus="0"),
    two_ended("resistor", "R3", "g", "0", ohms=1),
    two_ended("ccvs", "H1", "h", "0", control="R3", gain=2),
    two_ended("cccs", "F1", "0", "i", control="R3", gain=2),
    two_ended("resistor", "R4", "i", "0", ohms=1),
]


def all_kinds() -> DiodeCircuit:
    ramp, step = piecewise_linear([0.0, 1.0], [0.0, 2.0]), PiecewiseConstant([0.5, 1.0], [1.0, 3.0])
    circuit = DiodeCircuit().voltage_source("V1", "a", "0", Sine(3.0, 2.0, 0.5, 1.0))
    circuit.current_source("I1", "0", "b", ramp).voltage_source("V2", "s", "0", step)
    circuit.voltage_source("V3", "r", "0", ramp).resistor("RS", "s", "a", 1).resistor("RR", "r", "a", 1000)
    circuit.resistor("R1", "b", "0", Fraction(1, 3)).inductor("L1", "a", "c", 0.25, 1).diode("D1", "c", "d")
    circuit.inductor("L2", "d", "0", 1).coupling("K1", "L1", "L2", 0.5)
    circuit.capacitor("C1", "d", "0", Fraction(1, 10), 2)
    circuit.transformer("X1", "d", "0", "e", "0", 2).resistor("R2", "e", "0", 1)
    circuit.vcvs("E1", "f", "0", "e", "0", 2).vccs("G1", "0", "g", "f", "0", 2).resistor("R3", "g", "0", 1)
    return circuit.ccvs("H1", "h", "0", "R3", 2).cccs("F1", "0", "i", "R3", 2).resistor("R4", "i", "0", 1)


def test_elements_of_every_kind_make_the_same_circuit_as_the_methods_of_their_names() -> None:
    stated, built = read({"elements": ALL_KINDS}), all_kinds()
    sources = ("V1", "I1", "V2", "V3")  # which are equal to themselves only
    first, second = ([e for e in c.elements if e.name not in sources] for c in (stated, built))
    assert first == second
    one, other = (c.simulate((0.0, 1.5), t_eval=[0.45, 1.5]) for c in (stated, built))
    assert one.trajectory.x == pytest.approx(other.trajectory.x, rel=1e-12)
    for node, voltage in one.voltages.items():
        assert other.voltage(node) == pytest.approx(voltage, rel=1e-12)


def test_a_netlist_may_stand_in_the_place_of_elements() -> None:
    circuit = read({"netlist": "R1 a 0 1k\nC1 a 0 1u IC=1"})
    assert pytest.approx(-1000.0) == circuit.to_lcs().system.A


def resistor(**more: Any) -> dict[str, Any]:
    return {"elements": [two_ended("resistor", "R1", "a", "0") | more]}


def source(value: Any) -> dict[str, Any]:
    return {"elements": [two_ended("voltage_source", "V1", "a", "0", value=value)]}


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ({}, 'circuit is missing: give "netlist" or "elements"'),
        ({"netlist": "", "elements": []}, 'circuit = given twice: must be given either as "netlist" or as "elements"'),
        ({"netlist": 5}, "netlist = 5: must be a text"),
        ({"elements": {}}, "elements = {}: must be a list of elements"),
        ({"elements": [], "wires": 1}, "there is no key 'wires': choose from netlist"),
        ({"elements": [5]}, 'elements[0] = 5: must be an object with "kind", which is one of resistor, '),
        ({"elements": [{}]}, "elements[0].kind is missing: give one of resistor, "),
        ({"elements": [{"kind": "tube"}]}, "elements[0].kind = 'tube': must be one of \"resistor\", "),
        ({"elements": [{"kind": []}]}, "elements[0].kind = []: must be one of \"resistor\", "),
        (resistor(volts=5), "elements[0] has no key 'volts': choose from kind, name, plus, minus"),
        (resistor(), "elements[0].ohms is missing: a positive number, or a text such as \"4.7k\""),
        (resistor(ohms="1/0"), "elements[0].ohms = '1/0': must be a number"),
        (resistor(ohms="x"), "elements[0].ohms = 'x': must be a number such as 4.7k, 100n or 1e-3"),
        (resistor(ohms=True), "elements[0].ohms = True: must be a number"),
        (resistor(ohms=-1), "ohms of R1 = -1: must be a positive number"),
        (resistor(name=["R"], ohms=1), "elements[0].name = ['R']: must be a text"),
        (resistor(plus=3, ohms=1), "elements[0].plus = 3: must be a text"),
        (source({"square": {}}), "elements[0].value = {'square': {}}: must be a number, or an object with one of "),
        (source({"sine": {"hertz": 50}}), "elements[0].value.sine has no key 'hertz': choose from amplitude"),
        (source({"sine": 5}), "elements[0].value.sine = 5: must be an object with the keys amplitude, "),
        (source({"sine": {"amplitude": "a", "frequency": 1}}), "elements[0].value.sine.amplitude = 'a': must be"),
        (source({"sine": {"amplitude": 1, "frequency": -1}}), "elements[0].value.sine.frequency = -1"),
        (source([1]), "elements[0].value = [1]: must be a number"),
    ],
)  # fmt: skip
def test_what_is_no_circuit_is_refused(content: dict[str, Any], message: str) -> None:
    with pytest.raises(InvalidInputError) as caught:
        read(content)
    assert str(caught.value).startswith(message)
