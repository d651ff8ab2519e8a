"""Netlists are read as SPICE would, and what is no netlist is refused by line."""

import math
from fractions import Fraction

import pytest

from pricing_core.errors import InvalidInputError
from pricing_core.models import DiodeCircuit, Sine
from tests.problems import circuits

BRIDGE = """* A diode bridge that feeds a resistor from an LC oscillator
C  A B 1u IC=10
L  a b 10mH
D1 a p ideal
D2 b p ; the other half
D3 0 a
D4 GND b
R  P 0
+    1k
.model ideal D
.end
anything
"""


def test_the_bridge_as_a_netlist_is_the_bridge():
    read, built = DiodeCircuit.from_netlist(BRIDGE), circuits.diode_bridge()
    assert [element.name for element in read.elements] == ["C", "L", "D1", "D2", "D3", "D4", "R"]
    one, other = read.simulate((0.0, 1e-3), t_eval=[1e-3]), built.simulate((0.0, 1e-3), t_eval=[1e-3])
    assert one.voltage("A", "B") == pytest.approx(other.voltage("a", "b"), rel=1e-12)
    assert one.current("R") == pytest.approx(other.current("R"), rel=1e-12)


def test_every_kind_of_element_is_read():
    netlist = """
    .title all of them
    V1 1 0 DC 5
    V2 2 0 SIN(1 10 50)
    V3 3 0 SIN(0, 2, 1k, 0, 0, 90)
    I1 0 4 PWL(0 0 1m 2m 2m 0)
    R1 4 0 1MEG
    E1 5 0 1 0 2.5
    G1 0 6 1 0 1m
    R2 6 0 1
    F1 0 7 v1 3
    R3 7 0 1
    H1 8 0 R1 -2
    L1 1 9 1m IC = 2m
    L2 9 0 4m
    K1 l1 L2 0.5
    X1 1 0 10 0 10
    C1 10 0 1n
    """
    elements = {element.name: element for element in DiodeCircuit.from_netlist(netlist).elements}
    assert elements["V1"].value == 5
    assert elements["V2"].value == Sine(10.0, 50.0, 0.0, offset=1.0)
    assert elements["V3"].value.phase == pytest.approx(math.pi / 2)
    assert elements["I1"].value.after(0.5e-3) == pytest.approx([1e-3])
    assert elements["R1"].ohms == 10**6
    assert (elements["E1"].gain, elements["E1"].of_voltage) == (Fraction(5, 2), True)
    assert (elements["G1"].gain, elements["G1"].of_voltage) == (Fraction(1, 1000), False)
    assert (elements["F1"].control, elements["F1"].of_voltage) == ("V1", False)
    assert (elements["H1"].gain, elements["H1"].of_voltage) == (-2, True)
    assert elements["L1"].initial_current == Fraction(2, 1000)
    assert (elements["K1"].first, elements["K1"].coefficient) == ("L1", Fraction(1, 2))
    assert elements["X1"].ratio == 10
    assert DiodeCircuit.from_netlist(netlist).to_lcs().system.shape == (1, 0)  # C1 hangs on V1


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("R1 a 0", r"line 2 .* = 'R1 a 0': must be of the form R<name> node node ohms"),
        ("R1 a 0 5 IC=3", r"must be of the form R<name>"),
        ("R1 a 0 5x7", r"= '5x7': must be a number such as"),
        ("R1 a 0 1e999", r"must be a number"),
        ("R1 a 0 -5", r"line 2 of the netlist: ohms of R1.* must be a positive number"),
        ("R1 a 0 -1m", r"ohms of R1 = -1/1000: must be a positive number"),
        ("R1 a 0 1e-300", r"line 2 of the netlist: ohms of R1.* at least 1e-30"),
        ("R1 a a 5", r"line 2 of the netlist: nodes of R1 = 'a': must be two different nodes"),
        ("V1 a 0 SIN(0 1 1e300)", r"line 2 of the netlist: frequency = 1e\+300"),
        (
            "V1 a 0 PWL(1 0 0 1)",
            r"line 2 of the netlist: times = \[1.0, 0.0\]: must be a non-empty increasing",
        ),
        ("C1 a 0 1 IC=2 ic=3", r"line 2 .* must be with one value of ic"),
        pytest.param("R1 a 0 " + "9" * 5000, r"must be a number such as", id="5000 digits"),
        pytest.param("R1 a 0 1e" + "9" * 5000, r"must be a number such as", id="an exponent of 5000 digits"),
        (
            "Q1 a b c",
            r"line 2 .* = 'Q1 a b c': must be a switch, S<name> with a model of type SW, and a diode",
        ),
        ("T1 a b c", r"= 'T1': must be an element whose name begins with one of R C L D V.*title"),
        ("C1 a 0 1 IC=", r"must be of the form \.\.\. NAME=value"),
        ("c0 a 0 1", r"= 'c0': must be a name that no other element has"),
        ("D1 a 0 m 4", r"must be of the form D<name> anode cathode \[model\]"),
        ("V1 a 0", r"must be of the form V<name> plus minus value"),
        ("V1 a 0 DC", r"must be one value"),
        ("V1 a 0 1 2", r"must be one value"),
        ("V1 a 0 SIN(0 1)", r"must be SIN\(offset amplitude hertz"),
        ("V1 a 0 PWL(0 1 2)", r"must be PWL\(time value"),
        ("V1 a 0 PULSE(0 1)", r"line 2 .* = 'V1 a 0 PULSE\(0 1\)': must be PULSE\(low high delay rise"),
        ("V1 a 0 PULSE(0 1 0 1u 1u 9u 10u)", r"line 2 .*: period = 1e-05: must be longer than rise, width"),
        ("V1 a 0 EXP(0 1 0 0 1 1)", r"line 2 .*: time constants and delays .* positive.*EXP\(first"),
        ("V1 a 0 NOISE(0 1)", r"must be one value: a number, SIN"),
        (".tran 1u", r"line 2 .* must be of the form .tran step stop"),
        (".tran 1u 1m 2m", r"0 <= start < stop"),
        (".ac dec 10 1 1k", r"line 2 .* = '.ac dec 10 1 1k': must be one of .param"),
        (".model m D(IS=-1)", r"must be a diode with IS > 0"),
        (".model m NPN(BF=100)", r"must be a model of type D, SW, CSW or VSWITCH"),
        (".model m SW(VT=1 VH=-1)", r"must be a switch with VH >= 0"),
        (".model m SW(RON=2 ROFF=1)", r"0 <= RON < ROFF"),
        (".model m SW(GAIN=2)", r"no GAIN"),
        (".model m VSWITCH(VON=0 VOFF=1)", r"VON > VOFF"),
        (".model", r"must be .model NAME TYPE"),
        (
            "D1 a 0 none",
            r"line 2 .* = 'D1 a 0 none': must be a diode of a model that the netlist has: it has none",
        ),
        ("S1 a 0 a 0 none", r"must be a switch of a model of type SW or VSWITCH that the netlist has"),
        ("S1 a 0 a", r"must be of the form S<name> node node plus minus model"),
        (".param a", r"must be of the form .param NAME=expression"),
        (".param a=b b=a\nR1 a 0 {a}", r"line 2 .* must be free of circles: a is defined by itself"),
        (".param a=1 a=2", r"with one value of a"),
        ("R1 a 0 {2*", r"line 2 of the netlist = 'R1 a 0 \{2\*': must be with every brace and quote closed"),
        ("R1 a 0 {2*5", r"must be with every brace and quote closed"),
        ("R1 a 0 2*5}", r"must be with every brace and quote closed"),
        (".param a={2*5\nR1 a 0 {a}", r"line 2 .* must be with every brace and quote closed"),
        (".param a='2*5\nR1 a 0 {a}", r"line 2 .* must be with every brace and quote closed"),
        (
            "R1 a 0 {2*q}",
            r"line 2 of the netlist: R1 = '2\*q': must be an expression of known parameters: there is no q",
        ),
        ("R1 a 0 {1/0}", r"does not divide by zero"),
        ('.include "x.cir"', r"line 2 .* must be left out: only a netlist that is a file itself"),
        (".subckt s a", r"line 2 .* must be a subcircuit that .ends ends"),
        (".ends", r"line 2 .* must be the end of a subcircuit: none is open"),
        (".subckt s\n.ends", r"must be of the form .subckt NAME node"),
        (".subckt s a 0\n.ends", r"whose nodes differ"),
        (
            ".subckt s a\nX1 a s\n.ends\nX1 a s",
            r"line 3 .* must be an instance of no subcircuit that it is inside",
        ),
        (".subckt s a\nR1 a 0 1\n.ends\nX1 a b s", r"must be an instance of s with 1 nodes"),
        (".subckt s a\nR1 a 0 1\n.ends\nX1 a s q=1", r"which has no parameter q"),
        (".ic v(a)", r"must be of the form .ic v\(node\)=volts"),
        ("()", r"must be an element"),
    ],
)
def test_a_line_that_cannot_be_read_is_named(line, message):
    with pytest.raises(InvalidInputError, match=message):
        DiodeCircuit.from_netlist("C0 a 0 1u\n" + line.replace("\\n", "\n") + "\n")


def test_a_continuation_needs_a_beginning():
    with pytest.raises(InvalidInputError, match=r"line 1 .* must be the continuation"):
        DiodeCircuit.from_netlist("+ 5")


def test_line_1_of_a_file_is_the_title_whatever_it_reads_like(tmp_path):
    file = tmp_path / "bridge.cir"
    for title in ("Diode bridge rectifier", ".include none", "R9 in 0 5", "+ bridge", "Lab circuit number 3"):
        file.write_text(f"{title}\nV1 in 0 5\nR1 in 0 1k\n.end\n")
        circuit = DiodeCircuit.from_netlist_file(file)
        assert [element.name for element in circuit.elements] == ["V1", "R1"]
        assert circuit.notes == (f"line 1 of the netlist is the title: {title}",)
    file.write_text("* bridge\nQ1 a b c\nR1 a 0 1k\n")
    with pytest.raises(InvalidInputError, match=r"line 2 of the netlist = 'Q1 a b c': must be a switch"):
        DiodeCircuit.from_netlist_file(file)


def test_a_first_line_of_a_text_that_is_an_element_is_noted():
    body = "V1 bridge 0 5\nR1 rectifier 0 1k\n"
    read = DiodeCircuit.from_netlist("Diode bridge rectifier\n" + body)
    assert [element.name for element in read.elements] == ["Diode", "V1", "R1"]
    (note,) = read.notes
    assert note.startswith(
        "line 1 of the netlist is read as part of the circuit, where SPICE has the title: Diode"
    )
    assert DiodeCircuit.from_netlist("* Diode bridge rectifier\nD1 bridge rectifier\n" + body).notes == ()
    (note,) = DiodeCircuit.from_netlist("\n  Two sources\n" + body).notes
    assert note == "line 2 of the netlist is taken for the title: Two sources"


def test_a_line_below_a_comment_is_no_title():
    with pytest.raises(InvalidInputError, match=r"line 2 of the netlist = 'Q1 a b c': must be a switch"):
        DiodeCircuit.from_netlist("* title\nQ1 a b c\nR1 a 0 1k\n")


@pytest.mark.parametrize("text", ["", "* only a title\n", ".param a=1\n", "A title\n.end\nR1 a 0 1\n"])
def test_a_netlist_without_elements_is_refused(text, tmp_path):
    file = tmp_path / "empty.cir"
    file.write_text(text)
    for read, source in ((DiodeCircuit.from_netlist, text), (DiodeCircuit.from_netlist_file, file)):
        with pytest.raises(
            InvalidInputError, match=r"netlist = without elements: must be a title and below it"
        ):
            read(source)


@pytest.mark.parametrize("text", [5, None, b"R1 a 0 5", ["R1 a 0 5"]])
def test_what_is_no_text_is_refused(text):
    with pytest.raises(InvalidInputError, match=r"netlist = .*: must be a text"):
        DiodeCircuit.from_netlist(text)
