"""Circuits with diodes and switches (11.2.1): built or read, simulated, and brought to their steady state."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from pathlib import Path
from typing import Self

from numpy.typing import ArrayLike

from pricing_core.arrays import as_number, as_vector, check_callable
from pricing_core.errors import (
    InfeasibleError,
    InvalidInputError,
    MissingInputError,
    NotFoundError,
    NumericalError,
)
from pricing_core.lcs.simulate import simulate_without_energy
from pricing_core.lcs.simulation_method import EventDriven, SimulationMethod, as_method
from pricing_core.lcs.simulation_times import checked_span, checked_times
from pricing_core.models.circuits.assembly import assemble, initial_states
from pricing_core.models.circuits.builder import CircuitBuilder
from pricing_core.models.circuits.circuit_lcs import CircuitLCS
from pricing_core.models.circuits.elements import Element
from pricing_core.models.circuits.netlist.reader import Netlist, read_netlist
from pricing_core.models.circuits.run import CircuitRun, read_run
from pricing_core.models.circuits.signals import MOST_PULSES, check_count, check_periods
from pricing_core.models.circuits.sources import CurrentSource, VoltageSource
from pricing_core.models.circuits.steady_state import SteadyState, find_steady_state
from pricing_core.models.circuits.switched_circuit import SwitchedCircuit
from pricing_core.models.circuits.switches import Pulse, Switch
from pricing_core.models.circuits.unlimited import unlimited


class DiodeCircuit(CircuitBuilder):
    """A circuit of resistors, capacitors, inductors, sources, transformers, diodes and switches.

    Every method that adds an element returns the circuit itself. Nodes are named by strings, "0" is the ground. A
    current counts from the first node through the element to the second one, also for sources. Values are numbers
    (`Fraction` is exact), in ohms, farads, henries, volts and amperes.

    Examples
    --------
    A source of 5 V charges a capacitor through a diode and a resistor:

    >>> circuit = DiodeCircuit().voltage_source("V1", "in", "0", 5).diode("D1", "in", "a")
    >>> circuit = circuit.resistor("R1", "a", "out", 1000).capacitor("C1", "out", "0", 1e-6)
    >>> run = circuit.simulate((0.0, 1e-3), t_eval=[1e-3])
    >>> run.voltage("out").round(6)  # 5 (1 - 1/e)
    array([3.160603])
    """

    def __init__(self) -> None:
        super().__init__()
        self.notes: tuple[str, ...] = ()  # what of a netlist was read otherwise than SPICE does, or left out
        self.t_span: tuple[float, float] | None = None  # from a netlist's .tran, in seconds

    @classmethod
    def from_netlist(cls, text: str) -> Self:
        """Read the circuit from a netlist in a subset of SPICE's language.

        One element a line, its kind by the first letter of its name: R, C, L (with IC=), D, V, I (a number, DC number,
        SIN, PULSE, EXP or PWL), E, G, F, H (controlled by two nodes or by the current of any element), K (coupled
        inductors), S and W (switches, with ON or OFF), and X for an instance of a subcircuit, or for an ideal
        transformer with four nodes and the ratio. Numbers such as 4.7k, 4k7, 100n, 2MEG, 5mil; names of parameters;
        expressions in braces or quotes, which are evaluated as such and never run as programs. Lines that begin with *
        and what follows ; are comments, + continues a line, .end ends. Case does not matter.

        In SPICE line 1 is always the title. Here the first line of a text is the title only where it cannot be read as
        part of the circuit; `Diode bridge rectifier` can, as a diode from `bridge` to `rectifier`. Begin a title with
        `*`, and `notes` says how a first line without it was taken. In `from_netlist_file` line 1 is always the title.

        .param NAME=expression; .subckt and .ends; .ic for the voltages of capacitors and the currents of inductors;
        .tran for t_span; .model of type D, SW (VT, VH, RON, ROFF), VSWITCH (VON, VOFF) and CSW (IT, IH). A diode's
        model without parameters is ideal; with some it is a drop of N 25.85 mV ln(1 + I/IS) at I = 10 mA, or at
        .options diode_current=I, in series with RS. Without ROFF an open switch carries no current. `notes` says what
        was read so and what was left out.

        Parameters
        ----------
        text : str
            The netlist, with its lines.

        Raises
        ------
        InvalidInputError
            A line that is none of these; the message names it and says why. A file is included by
            `from_netlist_file` alone.

        Examples
        --------
        >>> circuit = DiodeCircuit.from_netlist('''* peak detector
        ... V1 in 0 SIN(0 10 50)
        ... D1 in out
        ... C1 out gnd 100u
        ... .end''')
        >>> circuit.simulate((0.0, 0.1)).voltage("out")[-1:].round(9)
        array([10.])
        """
        return cls()._read(read_netlist(text))

    @classmethod
    def from_netlist_file(cls, path: str | Path) -> Self:
        """Read the circuit from a netlist in a file, whose line 1 is the title; see `from_netlist`.

        The file may include others of its folder.

        Parameters
        ----------
        path : path-like

        Raises
        ------
        InvalidInputError
            The file cannot be read, a line is not one of a netlist, or a line includes a file outside the folder.
        """
        if not isinstance(path, str | Path):
            raise InvalidInputError("path", path, "the name of a file")
        file = Path(path)
        try:
            text = file.read_text(encoding="utf-8")
        except (OSError, ValueError) as error:
            raise InvalidInputError("netlist", str(path), f"a file that can be read: {error}") from None
        return cls()._read(read_netlist(text, file.parent))

    def _read(self, netlist: Netlist) -> Self:
        for element in netlist.elements:
            self.add(element)
        self.notes, self.t_span = tuple(netlist.notes), netlist.t_span
        return self

    def to_lcs(self, closed: Collection[str] | None = None) -> CircuitLCS:
        """Return the linear complementarity system of the circuit, with rational entries.

        Capacitor loops and inductor cut-sets are reduced to independent states. Each diode has its current as the
        multiplier and its reverse voltage as the slack, or the other way round, such that the system exists (11.5).

        Parameters
        ----------
        closed : collection of str, optional
            The switches that are closed; needed where there are switches.

        Raises
        ------
        InvalidInputError
            No ground, a floating node, sources that contradict each other, a reference to an element that is not
            there, or a network that controlled sources leave without a solution.

        Notes
        -----
        Cost: eliminations of about as many columns as there are nodes and elements, in exact arithmetic; 30 ms for 20
        elements.

        Examples
        --------
        >>> circuit = DiodeCircuit().capacitor("C1", "a", "0", 2).diode("D1", "a", "b").resistor("R1", "b", "0", 5)
        >>> model = circuit.to_lcs()
        >>> model.state_names, model.multiplier_names, model.stored_energy, model.is_passive
        (('v(C1)',), ('i(D1)',), array([[2.]]), True)
        >>> model.system.A, model.system.B, model.system.C, model.system.D
        (array([[0.]]), array([[-0.5]]), array([[-1.]]), array([[5.]]))
        """
        switched = SwitchedCircuit(self.elements)
        names = [switch.name for switch in switched.switches]
        if names and closed is None:
            raise MissingInputError(
                "closed", f"give those of the switches {', '.join(names)} that are closed, or ()"
            )
        if closed is not None and not isinstance(closed, list | tuple | set | frozenset):
            raise InvalidInputError("closed", closed, "a list of names of switches")
        for name in closed or ():
            if name not in names:
                raise InvalidInputError("closed", name, f"a switch: {', '.join(names) or 'there is none'}")
        return assemble(switched.placed(tuple(name in (closed or ()) for name in names)))

    def simulate(
        self,
        t_span: tuple[float, float] | None = None,
        x0: ArrayLike | None = None,
        *,
        method: SimulationMethod = "event-driven",
        t_eval: ArrayLike | None = None,
        interrupt: Callable[[], bool] | None = None,
    ) -> CircuitRun:
        """Simulate the circuit over t_span, in seconds.

        Parameters
        ----------
        t_span : (float, float), optional
            Beginning and end, in seconds; those of the netlist's .tran if missing.
        x0 : array_like, shape (n,), optional
            In the order of `CircuitLCS.state_names`; from the elements' initial voltages and currents if missing.
        method, t_eval, interrupt
            See `pricing_core.lcs.simulate`.

        Raises
        ------
        InvalidInputError
            See `to_lcs`; or t_span is so long that there is no end to the periods of a source.
        InfeasibleError, NotFoundError
            Diodes close a loop of voltage sources or open a cut-set of current sources; the message names them.
        NumericalError
            See `pricing_core.lcs.simulate`.

        Examples
        --------
        Charge is shared through a diode, and a third of the energy of 9 J is lost:

        >>> circuit = DiodeCircuit().capacitor("C1", "a", "0", 2, initial_voltage=3).diode("D1", "a", "b")
        >>> run = circuit.capacitor("C2", "b", "0", 1).simulate((0.0, 1.0))
        >>> run.voltage("b")[-1:].round(12), run.events[0].energy_lost
        (array([2.]), 3.0)
        """
        if t_span is None and self.t_span is None:
            raise MissingInputError("t_span", "give it, or .tran in the netlist")
        span = checked_span(self.t_span if t_span is None else t_span)  # type: ignore[arg-type]
        for element in self.elements:
            if isinstance(element, VoltageSource | CurrentSource):
                check_periods(element.name, element.value, span)
            if isinstance(element, Switch) and isinstance(element.control, Pulse):
                check_count(element.name, element.control.period, span, MOST_PULSES)
        switched = SwitchedCircuit(self.elements)
        if switched.switches:
            return self._switched_run(switched, span, x0, method, t_eval, interrupt)
        circuit = self.to_lcs()
        try:
            trajectory = simulate_without_energy(
                circuit.system,
                circuit.x0 if x0 is None else x0,
                span,
                method=method,
                t_eval=t_eval,
                interrupt=interrupt,
            )
        except (InfeasibleError, NotFoundError) as error:
            raise _advised(error, self.elements) from error
        return read_run(circuit, trajectory, span[0], ends_of(self.elements), from_elements=x0 is None)

    def steady_state(
        self,
        period: float | None = None,
        x0: ArrayLike | None = None,
        *,
        method: EventDriven | None = None,
        tolerance: float = 1e-11,
    ) -> SteadyState:
        """Find a periodic solution, by Newton's method on the map over one period.

        Its derivative is exact, events included, whichever modes a period goes through. An oscillation without a clock
        has no given period, and is not found.

        Parameters
        ----------
        period : float, optional
            Seconds; the longest of all sources and controls if missing.
        x0 : array_like, shape (m,), optional
            A state near the solution: voltages of all capacitors and currents of all inductors, in the order in which
            they were added. The elements' initial values if missing.
        method : EventDriven, optional
        tolerance : float
            Largest change over a period, as a share of the largest voltage or current.

        Raises
        ------
        InvalidInputError
            See `to_lcs`; or a period after which a source or control does not begin anew.
        NotFoundError
            No periodic solution was found, which proves nothing.
        NumericalError
            See `pricing_core.lcs.simulate`.

        Examples
        --------
        A buck converter halves its voltage:

        >>> from pricing_core.models import Pulse
        >>> circuit = DiodeCircuit().voltage_source("V1", "in", "0", 12).diode("D1", "0", "x")
        >>> circuit = circuit.switch("S1", "in", "x", Pulse(period=10e-6, width=5e-6))
        >>> circuit = circuit.inductor("L1", "x", "out", 1e-4).capacitor("C1", "out", "0", 1e-4)
        >>> steady = circuit.resistor("R1", "out", "0", 2).steady_state()
        >>> round(steady.run.mean("v(out)"), 9), round(steady.efficiency(["R1"], ["V1"]), 9), steady.is_stable
        (6.0, 1.0, True)
        """
        circuit = SwitchedCircuit(self.elements)
        chosen = EventDriven() if method is None else method
        if not isinstance(chosen, EventDriven) or chosen.rebound is not None:
            raise InvalidInputError("method", method, "an EventDriven without another law of rebound")
        count = initial_states(self.elements).size
        start = None if x0 is None else as_vector("x0", x0, count)
        allowed = as_number("tolerance", tolerance)
        if allowed <= 0.0:
            raise InvalidInputError("tolerance", tolerance, "a number > 0")
        return find_steady_state(circuit, ends_of(self.elements), period, start, chosen, allowed)

    def _switched_run(
        self,
        switched: SwitchedCircuit,
        span: tuple[float, float],
        x0: ArrayLike | None,
        method: SimulationMethod,
        t_eval: ArrayLike | None,
        interrupt: Callable[[], bool] | None,
    ) -> CircuitRun:
        chosen = as_method(method)
        if not isinstance(chosen, EventDriven) or chosen.rebound is not None:
            raise InvalidInputError("method", method, '"event-driven" for a circuit with switches')
        given = initial_states(self.elements)
        start = given if x0 is None else as_vector("x0", x0, given.size)
        reported = None if t_eval is None else checked_times(t_eval, span)
        if interrupt is not None:
            check_callable("interrupt", interrupt, "nothing")
        trajectory, record = switched.simulate(span, start, chosen, reported, interrupt)
        return read_run(record, trajectory, span[0], ends_of(self.elements), from_elements=x0 is None)


def ends_of(elements: Sequence[Element]) -> dict[str, tuple[str, str]]:
    """Return the nodes of every branch."""
    return {branch.name: (branch.plus, branch.minus) for element in elements for branch in element.branches}


def _advised(error: NumericalError, elements: Sequence[Element]) -> NumericalError:
    """Return the error with what may be wrong with the circuit."""
    advice = unlimited(elements)
    return error if advice is None else type(error)(f"{advice}: {error}")
