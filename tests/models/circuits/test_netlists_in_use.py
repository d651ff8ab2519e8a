"""Netlists as people have them: parameters, subcircuits, models, files, waveforms; closed forms and ngspice."""

import math
import shutil
import subprocess
from contextlib import suppress
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pricing_core.errors import InvalidInputError
from pricing_core.models import DiodeCircuit, Pulse, Sine
from pricing_core.models.circuits.netlist.expressions import evaluate
from pricing_core.models.circuits.quantity import quantity
from pricing_core.models.circuits.switched_circuit import SwitchedCircuit

BUCK = """Buck converter with a gate drive
.param Vin=12 fsw=100k D=0.4
.param T={1/fsw} ; later parameters may be named before
V1 in 0 {Vin}
VG g 0 PULSE(0 5 0 1n 1n {D*T-1n} {T})
S1 in x g 0 MOS
D1 0 x DX
L1 x out 100u
C1 out 0 22µ
R1 out 0 4R7
.model MOS SW(VT=2.5 VH=0.1 RON=20m)
.model DX D(IS=1e-12 N=1.2 RS=10m CJO=1p)
.options reltol=1e-4
.tran 10n 500u
.end
"""


def test_a_converter_as_it_is_posted_runs_and_says_what_was_read_otherwise():
    circuit = DiodeCircuit.from_netlist(BUCK)
    assert circuit.t_span == (0.0, 5e-4)
    title, diode, options, *transient = circuit.notes
    assert title == "line 1 of the netlist is taken for the title: Buck converter with a gate drive"
    assert "line 12 of the netlist: DX is an ideal diode with 0.7143 V, its drop at 0.01 A" in diode
    assert diode.endswith("in series with 0.01 ohms; CJO left out")
    assert options == "line 13 of the netlist is left out: .options reltol=1e-4"
    assert len(transient) == 2
    elements = {element.name: element for element in circuit.elements}
    drop = 1.2 * 25.85e-3 * math.log(1 + 0.01 / 1e-12)
    assert float(elements["D1"].forward_voltage) == pytest.approx(drop, rel=1e-11)
    assert elements["D1"].resistance == Fraction(1, 100)
    assert elements["C1"].farads == Fraction(22, 10**6)
    # The gate is ahead of its ramp's end: 2.6 V after 0.52 ns, 2.4 V 0.52 ns after the fall begins.
    (switch,) = SwitchedCircuit(circuit.elements).switches
    assert isinstance(switch.control, Pulse)
    assert switch.control.delay == pytest.approx(0.52e-9, rel=1e-9)
    assert switch.control.width == pytest.approx(4e-6, rel=1e-9)
    steady = circuit.steady_state()
    assert circuit.simulate().t[-1] == 5e-4
    # Means: 0.4 (12 - Ron i) - 0.6 (drop + Rs i) = v, and i = v/R.
    law = (0.4 * 12 - 0.6 * drop) / (1 + (0.4 * 0.02 + 0.6 * 0.01) / 4.7)
    assert steady.run.mean("v(out)") == pytest.approx(law, rel=1e-5)


def test_a_model_without_parameters_is_ideal_and_the_current_of_the_drop_may_be_chosen():
    text = ".model A D\n.model B D(IS=1n)\n.options diode_current=1m\nD1 a 0 A\nD2 a 0 B\nR1 a 0 1"
    one, other, _ = DiodeCircuit.from_netlist(text).elements
    assert (one.forward_voltage, one.resistance) == (0, 0)
    assert float(other.forward_voltage) == pytest.approx(25.85e-3 * math.log(1 + 1e6), rel=1e-11)


def test_subcircuits_have_parameters_nodes_and_models_of_their_own():
    text = """
    .param R=2 scale=10
    .subckt cell a b R=5 C={scale*1u}
    R1 a m {R}
    D1 m b fast
    X1 m b load RL={2*R}
    .model fast D
    .ends cell
    .subckt load p n RL=1
    R1 p mid 'RL/2'
    R2 mid n RL
    .ends
    X1 in 0 cell
    X2 in 0 CELL R={R+1} C=1n
    V1 in 0 5
    R1 in 0 R
    """
    elements = {element.name: element for element in DiodeCircuit.from_netlist(text).elements}
    assert (elements["X1.R1"].ohms, elements["X2.R1"].ohms, elements["R1"].ohms) == (5, 3, 2)
    assert (elements["X1.X1.R1"].ohms, elements["X1.X1.R2"].ohms, elements["X2.X1.R2"].ohms) == (5, 10, 6)
    assert (elements["X1.X1.R1"].plus, elements["X1.X1.R1"].minus) == ("X1.m", "X1.X1.mid")
    assert (elements["X1.D1"].anode, elements["X1.D1"].cathode) == ("X1.m", "0")
    run = DiodeCircuit.from_netlist(text).simulate((0.0, 1.0))
    assert run.current("X1.R1")[-1] == pytest.approx(1.0, rel=1e-12)  # the diode shorts the load


def test_initial_conditions_set_capacitors_and_inductors():
    text = "* title\nC1 a b 1u\nC2 a 0 1u IC=3\nL1 b 0 1m\nL2 a 0 1m\nR1 a b 5\n.ic v(A)=7 V(b)=2 i(L1)={1/4} v(q)=1"
    circuit = DiodeCircuit.from_netlist(text)
    c1, c2, l1, l2, _ = circuit.elements
    assert (c1.initial_voltage, c2.initial_voltage) == (5, 3)
    assert (l1.initial_current, l2.initial_current) == (Fraction(1, 4), 0)
    assert circuit.notes == (
        ".ic v(q) has no effect: it sets no capacitor's voltage and no inductor's current",
    )


def _damped(t: float) -> float:
    phase, late = math.radians(45), t - 4e-3
    if late < 0:
        return math.sin(phase)
    return math.exp(-30 * late) * math.sin(100 * math.pi * late + phase)


def _exp(t: float) -> float:
    up = 4 * (1 - math.exp(-(t - 2e-3) / 1e-3)) if t > 2e-3 else 0.0
    return 1 + up - (4 * (1 - math.exp(-(t - 9e-3) / 3e-3)) if t > 9e-3 else 0.0)


def _folded(t: float) -> float:
    """Return the milliseconds into the pulse, beyond its end before the first one."""
    return math.fmod(1e3 * t - 2.0 + 1e-12, 10.0) if t >= 2e-3 - 1e-12 else 9.0


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("SIN(1 2 50 4m 30 45)", lambda t: 1 + 2 * _damped(t)),
        ("EXP(1 5 2m 1m 9m 3m)", _exp),
        (
            "PULSE(1 3 2m 1m 2m 3m 10m)",
            lambda t: float(np.interp(_folded(t), [0, 1, 4, 6, 10], [1, 3, 3, 1, 1])),
        ),
        ("DC 4 PWL(0 1 10m 3)", lambda t: float(np.interp(t, [0, 0.01], [1, 3]))),
    ],
)
def test_waveforms_are_those_of_their_formulas(text, value):
    t = np.linspace(0.0, 0.035, 36)
    run = DiodeCircuit.from_netlist(f"V1 a 0 {text}\nR1 a 0 2").simulate((0.0, 0.035), t_eval=t)
    assert run.voltage("a") == pytest.approx([value(at) for at in t.tolist()], abs=1e-9)


def test_a_switch_that_a_current_controls():
    text = """
    V1 a 0 PWL(0 0 1 10)
    R1 a 0 2
    V2 b 0 1
    R2 b c 1
    W1 c 0 R1 relay
    .model relay CSW(IT=2 IH=0.5 RON=0)
    """
    run = DiodeCircuit.from_netlist(text).simulate((0.0, 1.0))
    assert [event.time for event in run.events] == pytest.approx([0.5], rel=1e-12)  # 2.5 A at 5 V
    assert run.current("R2")[[0, -1]] == pytest.approx([0.0, 1.0])


def test_files_include_others_of_their_folder_only(tmp_path):
    inner = tmp_path / "circuit" / "models"
    inner.mkdir(parents=True)
    (tmp_path / "secret.cir").write_text("R9 a 0 1")
    (inner / "diodes.lib").write_text(".model DX D\n.include more.lib\nR2 a 0 0 ; wrong\n.end\nnothing")
    (inner / "more.lib").write_text("C1 a 0 1u\n")
    main = tmp_path / "circuit" / "main.cir"
    main.write_text('* main\nR1 a 0 5\n.include "models/diodes.lib"\nD1 a 0 DX\n')
    with pytest.raises(InvalidInputError, match=r"line 3 of models/diodes.lib: ohms of R2"):
        DiodeCircuit.from_netlist_file(main)
    (inner / "diodes.lib").write_text(".model DX D\n.include more.lib")
    assert [e.name for e in DiodeCircuit.from_netlist_file(main).elements] == ["R1", "C1", "D1"]
    (inner / "link.lib").symlink_to(tmp_path / "secret.cir")
    outside = ("../secret.cir", str(tmp_path / "secret.cir"), "models/../../secret.cir", "models/link.lib")
    for path in outside:
        main.write_text(f"* main\nR1 a 0 5\n.include {path}\n")
        with pytest.raises(InvalidInputError, match=r"line 3 .* a relative path inside the folder"):
            DiodeCircuit.from_netlist_file(main)
    main.write_text("* main\n.include main.cir\n")
    with pytest.raises(InvalidInputError, match=r"at most 10 files inside each other"):
        DiodeCircuit.from_netlist_file(main)
    with pytest.raises(InvalidInputError, match=r"netlist = .*: must be a file that can be read"):
        DiodeCircuit.from_netlist_file(tmp_path / "none.cir")


def test_instances_without_end_are_refused_before_they_are_made():
    levels = "\n".join(f".subckt s{i} a\nX1 a s{i + 1}\nX2 a s{i + 1}\n.ends" for i in range(18))
    text = f"{levels}\n.subckt s18 a\nR1 a 0 1\n.ends\nX1 a s0"
    with pytest.raises(InvalidInputError, match=r"one of at most 20000 elements, instances put in"):
        DiodeCircuit.from_netlist(text)


@given(
    st.recursive(
        st.integers(1, 99).map(str),
        lambda inner: st.builds("({} {} {})".format, inner, st.sampled_from("+-*"), inner),
    )
)
def test_expressions_have_the_values_that_arithmetic_gives_them(text):
    if len(text) <= 400 and text.count("(") < 25:
        assert evaluate("x", text, {}.get) == eval(text)


@given(st.text(alphabet="0123456789.+-*/^()eEkmu{}'\"_abs,pi √µ\n", max_size=40))
def test_no_text_makes_an_expression_fail_otherwise_than_by_its_message(text):
    with suppress(InvalidInputError):
        assert isinstance(evaluate("x", text, {}.get), Fraction)


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("4k7", 4700),
        ("4R7", 4.7),
        ("2meg2", 2.2e6),
        ("5mil", 127e-6),
        ("10µF", 1e-5),
        ("3μ3", 3.3e-6),
        ("1k", 1000),
    ],
)
def test_numbers_as_drawings_have_them(text, value):
    assert float(quantity("value", text)) == pytest.approx(value, rel=1e-15)


@pytest.mark.skipif(shutil.which("ngspice") is None, reason="ngspice is not installed")
@pytest.mark.parametrize("seed", range(2))
def test_ngspice_with_stiff_diodes_agrees(seed: int, tmp_path: Path) -> None:
    duty, ohms, drop = np.random.default_rng(seed).uniform([0.3, 2.0, 0.005], [0.7, 10.0, 0.02])
    body = f"""
V1 in 0 12
VG g 0 PULSE(0 5 0 1n 1n {duty * 1e-5 - 1e-9:.9g} 10u)
S1 in x g 0 MOS
D1 0 x DX
L1 x out 100u IC=0
C1 out 0 22u IC=0
R1 out 0 {ohms:.6g}
.model MOS SW(VT=2.5 VH=0.1 RON=1m ROFF=1e7)
.model DX D(IS=1e-12 N={drop:.3g} RS=10m)
"""
    control = ".control\nrun\nwrdata out v(out)\n.endc\n.end\n"
    (tmp_path / "x.cir").write_text(f"* buck{body}.options reltol=1e-6\n.tran 10n 300u 0 20n UIC\n{control}")
    subprocess.run(["ngspice", "-b", "x.cir"], cwd=tmp_path, check=False, capture_output=True, timeout=60)
    t, theirs = np.loadtxt(tmp_path / "out").T
    run = DiodeCircuit.from_netlist(body).simulate((0.0, 3e-4), t_eval=np.unique(t))
    assert run.voltage("out") == pytest.approx(np.interp(np.unique(t), t, theirs), abs=3e-3)


def test_a_source_without_load_costs_no_events():
    run = DiodeCircuit.from_netlist(BUCK).simulate((0.0, 1e-4))
    assert len(run.events) == 20  # two in each period, none for the gate's corners
    fine = run.refined(4000)
    assert fine.voltage("g").max() == pytest.approx(5.0)


def test_a_sine_without_delay_stays_a_sine():
    assert isinstance(DiodeCircuit.from_netlist("V1 a 0 SIN(0 1 50)\nR1 a 0 1").elements[0].value, Sine)
