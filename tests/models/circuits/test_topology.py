"""What cannot be a circuit is refused in one sentence that names the element or the node."""

import math

import numpy as np
import pytest

from pricing_core.errors import InfeasibleError, InvalidInputError
from pricing_core.lcs import piecewise_linear
from pricing_core.models import DiodeCircuit, PiecewiseConstant, Sine
from pricing_core.models.circuits.unlimited import unlimited


def grounded() -> DiodeCircuit:
    return DiodeCircuit().resistor("R0", "a", "0", 1).capacitor("C0", "a", "0", 1)


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda c: DiodeCircuit().resistor("R1", "a", "b", 1), r"connected to the ground, which is the node"),
        (lambda c: DiodeCircuit(), r"circuit = without elements: must be made of at least one element"),
        (lambda c: c.resistor("R1", "x", "y", 1), r"node = 'x': must be joined to the node \"0\".*floats"),
        (lambda c: c.transformer("X1", "a", "0", "x", "y", 2), r"node = 'x': must be joined"),
        (
            lambda c: c.voltage_source("V1", "a", "0", 1).voltage_source("V2", "a", "0", 2),
            r"voltage source = 'V2': must be in no loop.*resistor in series",
        ),
        (
            lambda c: c.current_source("I1", "x", "0", 1),
            r"node = 'x'.*more than current sources.*resistor beside",
        ),
        (
            lambda c: c.voltage_source("V1", "a", "0", 1).vcvs("E1", "a", "0", "a", "0", 2),
            r"sources = 'V1': must be free to take any value",
        ),
        (
            lambda c: (
                c.inductor("L1", "a", "0", 1).inductor("L2", "a", "0", 1).coupling("K1", "L1", "L3", 0.5)
            ),
            r"inductors of K1 = 'L3': must be an inductor",
        ),
        (lambda c: c.vcvs("E1", "x", "0", "y", "0", 2), r"control of E1 = 'y': must be a node"),
        (lambda c: c.cccs("F1", "a", "0", "V9", 2), r"control of F1 = 'V9': must be an element"),
    ],
)
def test_what_cannot_be_solved_is_refused(build, message):
    with pytest.raises(InvalidInputError, match=message):
        build(grounded()).to_lcs()


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda c: c.resistor("R1", "a", "0", 0), r"ohms of R1 = 0: must be a positive number"),
        (lambda c: c.resistor("R1", "a", "0", True), r"ohms of R1 = True: must be a finite number"),
        (lambda c: c.capacitor("C1", "a", "0", -1), r"farads of C1 = -1: must be a positive number"),
        (lambda c: c.capacitor("C1", "a", "0", 1, math.nan), r"initial_voltage of C1 = nan"),
        (lambda c: c.inductor("L1", "a", "0", -1e-3), r"henries of L1 = -0.001: must be a positive number"),
        (
            lambda c: c.resistor("R1", "a", "0", 10**400),
            r"ohms of R1 = 1000.*: must be a finite number of a size",
        ),
        (
            lambda c: c.resistor("R1", "a", "0", 10**5000),
            r"ohms of R1 = a value of type int: must be a finite",
        ),
        (lambda c: c.resistor("R1", "a", "0", 1e-320), r"ohms of R1 = 1e-320: must be a positive number"),
        (
            lambda c: c.resistor("R1", "a", "0", np.bool_(True)),
            r"ohms of R1 = np.True_: must be a finite number",
        ),
        (lambda c: c.transformer("X1", "a", "0", "b", "0", 1e-320), r"ratio of X1 = 1e-320"),
        (lambda c: c.resistor(10**5000, "a", "0", 1), r"name = a value of type int: must be a string"),
        (lambda c: c.add(5), r"name = 5: must be a string"),
        (lambda c: c.diode("D1", "a", "a"), r"nodes of D1 = 'a': must be two different nodes"),
        (lambda c: c.diode("D1", "a", 0), r"nodes of D1 = 0: must be a string; the ground"),
        (lambda c: c.transformer("X1", "a", "0", "b", "0", 0), r"ratio of X1 = 0"),
        (lambda c: c.coupling("K1", "L1", "L2", 1), r"coefficient of K1 = 1.*ideal transformer"),
        (lambda c: c.coupling("K1", "L1", "L1", 0.5), r"inductors of K1 = 'L1': must be two different"),
        (lambda c: c.voltage_source("V1", "a", "0", "5"), r"value of V1 = '5': must be a finite number"),
        (
            lambda c: c.voltage_source("V1", "a", "0", PiecewiseConstant([0.0], [[1.0, 2.0]])),
            r"value of V1 = '2 components': must be one component",
        ),
        (lambda c: c.voltage_source("V1", "a", "0", Sine(1.0, 0.0)), r"frequency = 0.0: must be a positive"),
        (lambda c: c.voltage_source("V1", "a", "0", Sine(math.inf, 1.0)), r"amplitude = inf"),
    ],
)
def test_an_element_that_cannot_be_is_refused_at_once(build, message):
    with pytest.raises(InvalidInputError, match=message):
        build(DiodeCircuit())


def test_couplings_that_would_store_negative_energy_are_refused():
    circuit = DiodeCircuit()
    for i in range(3):
        circuit.inductor(f"L{i}", f"n{i}", "0", 1).resistor(f"R{i}", f"n{i}", "0", 1)
        circuit.coupling(f"K{i}", f"L{i}", f"L{(i + 1) % 3}", -0.6)
    with pytest.raises(InvalidInputError, match=r"couplings = 'K0, K1, K2': must be weak enough"):
        circuit.to_lcs()


def test_a_winding_has_a_name_of_its_own():
    allowed = r"name = 'X1.primary': must be used by one element only, and X1"
    with pytest.raises(InvalidInputError, match=allowed):
        grounded().transformer("X1", "a", "0", "b", "0", 2).resistor("X1.primary", "a", "0", 1)
    with pytest.raises(InvalidInputError, match=allowed):
        grounded().resistor("X1.primary", "a", "0", 1).transformer("X1", "a", "0", "b", "0", 2)


@pytest.mark.parametrize(
    ("build", "names"),
    [
        (lambda c: c.voltage_source("V1", "a", "0", 5).diode("D1", "a", "0"), "V1, D1 are a loop"),
        (
            lambda c: (
                c.voltage_source("V1", "b", "0", 1)
                .vcvs("E1", "a", "0", "b", "0", 2)
                .diode("D1", "a", "c")
                .diode("D2", "c", "0")
            ),
            "E1, D1, D2 are a loop",
        ),
        (
            lambda c: c.current_source("I1", "0", "x", 5).diode("D1", "0", "x"),
            "I1, D1 are a cut-set of current sources",
        ),
    ],
)
def test_sources_that_diodes_short_or_cut_off_are_named(build, names):
    with pytest.raises(InfeasibleError, match=names):
        build(grounded()).simulate((0.0, 1.0))


def test_a_circuit_without_continuation_for_another_reason_is_not_explained_so():
    circuit = grounded().voltage_source("V1", "b", "0", 5).diode("D1", "b", "a")
    assert unlimited(circuit.elements) is None


def test_intervals_without_end_are_refused():
    circuit = grounded().voltage_source("V1", "b", "0", Sine(1.0, 50.0)).diode("D1", "b", "a")
    with pytest.raises(
        InvalidInputError, match=r"t_span = .*: must be no longer than 2000 s: 100000 periods of V1"
    ):
        circuit.simulate((0.0, 1e300))


def test_sources_of_too_many_pieces_are_refused():
    signal = piecewise_linear(np.arange(30_000.0), np.zeros(30_000))
    with pytest.raises(InvalidInputError, match=r"sources = 30000 knots: must be of fewer than 20000 knots"):
        grounded().voltage_source("V1", "b", "0", signal).resistor("R1", "b", "a", 1).to_lcs()
