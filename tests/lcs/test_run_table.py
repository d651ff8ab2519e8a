"""Runs as tables of Arrow."""

import numpy as np
import pytest

from pricing_core.errors import InvalidInputError
from pricing_core.lcs import LCS, TimeStepping, simulate
from pricing_core.models import (
    DiodeCircuit,
    HamiltonianSystem,
    MechanicalSystem,
    RelaySystem,
    friction_directions,
)


def decay():
    return simulate(LCS([[-1.0]], [[1.0]], [[1.0]]), [1.0], (0.0, 1.0), t_eval=[0.0, 0.5, 1.0])


def test_a_run_has_a_column_for_every_component():
    table = decay().to_table()
    assert table.column_names == ["t", "x1", "u1", "y1"]
    assert table["x1"].to_numpy() == pytest.approx(np.exp([-0.0, -0.5, -1.0]))
    named = decay().to_table(states=["charge"], multipliers=["i"], slacks=["v"])
    assert named.column_names == ["t", "charge", "i", "v"]


@pytest.mark.parametrize(
    ("names", "sentence"),
    [
        ({"states": ["a", "b"]}, "states = 2 names: must be 1 names, one for each column"),
        ({"states": "a"}, "states = 'a': must be a list"),
        ({"slacks": ["x1"]}, "slacks = 'x1': must be different"),
        ({"multipliers": ["t"]}, "multipliers = 't': must be different"),
    ],
)
def test_names_are_one_for_each_column_and_different(names, sentence):
    with pytest.raises(InvalidInputError, match=sentence):
        decay().to_table(**names)


def test_missing_numbers_are_null():
    run = decay()
    run.u[:, 0] = np.nan
    assert run.to_table()["u1"].null_count == 3


def test_models_have_tables_in_their_own_words():
    relay = RelaySystem([[0.0]], [[1.0]], [[1.0]]).simulate([1.0], (0.0, 2.0))
    assert relay.to_table(outputs=["level"]).column_names == ["t", "x1", "u1", "level"]
    circuit = DiodeCircuit().voltage_source("V1", "in", "0", 1.0).resistor("R1", "in", "0", 2.0)
    circuit.capacitor("C1", "in", "out", 1e-6).diode("D1", "out", "0").resistor("R2", "out", "0", 10.0)
    table = circuit.simulate((0.0, 1e-3)).to_table()
    assert table.column_names == ["t", "v(in)", "v(out)", "i(V1)", "i(R1)", "i(C1)", "i(D1)", "i(R2)"]
    assert table["i(R1)"].to_numpy() == pytest.approx(0.5)


def test_friction_has_its_columns():
    nothing = np.zeros((3, 3))
    for tangents, count in (([[1.0, 0.0, 0.0]], 1), ([friction_directions([1, 0, 0], [0, 1, 0], 4)], 4)):
        system = MechanicalSystem(
            np.eye(3),
            nothing,
            nothing,
            [[0.0, 0.0, 1.0]],
            [0.0, 0.0, -10.0],
            tangents=tangents,
            friction=[0.1],
        )
        run = system.simulate([0.0] * 3, [1.0, 0.0, 0.0], (0.0, 0.1), method=TimeStepping(step=0.01))
        table = run.to_table(states=["x", "y", "z", "x'", "y'", "z'"])
        friction = [f"friction{i + 1}" for i in range(count)]
        slip = [f"slip{i + 1}" for i in range(count)]
        assert table.column_names[7:] == ["u1", "y1", *friction, *slip]
        total = np.array([table[name].to_numpy() for name in friction])
        assert np.abs(total).sum(axis=0)[1:] == pytest.approx(1.0)


def test_a_hamiltonian_run_has_its_energy_in_a_column():
    fall = HamiltonianSystem(
        energy=lambda q, p: 0.5 * p @ p + 10.0 * q[0],
        gradient=lambda q, p: (np.array([10.0]), p),
        constraints=lambda q: q,
        constraint_jacobian=lambda q: np.eye(1),
    ).simulate([1.0], [0.0], (0.0, 0.4), steps=4)
    table = fall.to_table(coordinates=["height"])
    assert table.column_names == ["t", "height", "p1", "impulse1", "gap1", "energy"]
    assert table["energy"].to_numpy() == pytest.approx(10.0)
