"""Contacts read off the nodes of a collocated solution."""

from dataclasses import replace

import numpy as np
import pytest

from pricing_core.models.control.collocation import Collocation
from pricing_core.models.control.repair import separated
from pricing_core.models.control.structure import Contact, detect_structure

N = 20


def with_masses(masses: dict[int, float], slack: np.ndarray) -> tuple[Collocation, np.ndarray]:
    mass = np.zeros((N + 1, 1))
    for node, weight in masses.items():
        mass[node] = weight
    empty = np.zeros((N, 1))
    solution = Collocation(np.linspace(0.0, 2.0, N + 1), np.zeros((N + 1, 1)), empty, empty, mass, 0.0)
    return solution, slack[:, None]


def slack_without(nodes: range) -> np.ndarray:
    slack = np.ones(N + 1)
    slack[list(nodes)] = 0.0
    return slack


@pytest.mark.parametrize(
    ("nodes", "order", "expected"),
    [
        (range(5, 11), 1, (Contact(0, 0.45, 1.05),)),
        (range(5, 11), 2, (Contact(0, 0.45, 1.05),)),
        (range(7, 8), 2, (Contact(0, 0.7, 0.7),)),
        (range(7, 8), 1, (Contact(0, 0.65, 0.75),)),
        (range(15, 21), 1, (Contact(0, 1.45, 2.0),)),
        (range(20, 21), 1, (Contact(0, 2.0, 2.0),)),
        (range(6), 1, (Contact(0, 0.0, 0.55),)),
        (range(0), 1, ()),
    ],
)
def test_runs_of_nodes_become_contacts(nodes: range, order: int, expected: tuple[Contact, ...]):
    found = detect_structure(
        *with_masses(dict.fromkeys(nodes, 1.0), slack_without(nodes)), np.ones(1), (order,), (0 in nodes,)
    )
    assert len(found) == len(expected)
    for contact, wanted in zip(found, expected, strict=True):
        assert (contact.start, contact.end) == pytest.approx((wanted.start, wanted.end))


def test_masses_that_alternate_are_one_contact_of_order_two():
    nodes = range(4, 13)
    masses = {node: 1.0 for node in nodes if node % 2 == 0}
    slack = slack_without(range(0))
    slack[list(masses)] = 0.0
    (contact,) = detect_structure(*with_masses(masses, slack), np.ones(1), (2,), (False,))
    assert (contact.start, contact.end) == pytest.approx((0.35, 1.25))


def test_masses_and_slacks_of_the_size_of_rounding_are_none():
    rounding = 1e-12 * np.cos(np.arange(N + 1.0))
    always, rest = with_masses(dict.fromkeys(range(1, N + 1), 1.0), rounding)
    assert detect_structure(always, rest, np.ones(1), (2,), (True,)) == (Contact(0, 0.0, 2.0),)
    never, slack = with_masses(dict.fromkeys(range(7, 9), 1e-12), np.full(N + 1, 1e-4))
    never = replace(never, costate=np.ones((N, 1)))
    assert detect_structure(never, slack, np.ones(1), (1,), (False,)) == ()


def test_a_start_on_the_bound_that_moves_away_is_no_contact():
    start = with_masses({}, slack_without(range(1)))
    assert detect_structure(*start, np.ones(1), (2,), (False,)) == ()


def test_overlapping_contacts_meet_in_the_middle():
    before = (Contact(0, 0.0, 1.2), Contact(1, 1.0, 2.0))
    assert separated(before) == (Contact(0, 0.0, 1.1), Contact(1, 1.1, 2.0))
    nested = (Contact(0, 0.0, 2.0), Contact(1, 0.5, 1.0))
    assert separated(nested) == nested
