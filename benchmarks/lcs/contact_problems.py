"""Problems of frictional contact in the plane with closed forms."""

import math
from typing import NamedTuple

import numpy as np

from pricing_core.arrays import Vector
from pricing_core.models import MechanicalSystem, box_stack

GRAVITY = 9.81


class Problem(NamedTuple):
    """A system with its start, and where the closed form says that its coordinates are at the end."""

    name: str
    system: MechanicalSystem
    q0: Vector
    v0: Vector
    end: float
    q_end: Vector
    size: float


def problems() -> list[Problem]:
    """Return the problems with closed forms."""
    return [_block(), _slope(), _rolling(), _bouncing(), _rocking(), _stack(), _sliding_stack()]


def _block() -> Problem:
    # It stops at v^2/(2 mu g).
    way = 4.0 / (2.0 * 0.3 * GRAVITY)
    return Problem(
        "sliding block", _boxes(1, 0.3), np.zeros(3), _moving(1, 2.0), 1.0, np.array([way, 0, 0]), way
    )


def _slope() -> Problem:
    # It slides down with g (sin a - mu cos a).
    way = 0.5 * GRAVITY * (math.sin(0.5) - 0.3 * math.cos(0.5))
    return Problem(
        "box on a slope",
        _boxes(1, 0.3, slope=0.5),
        np.zeros(3),
        np.zeros(3),
        1.0,
        np.array([way, 0, 0]),
        way,
    )


def _ball(friction: float, restitution: float) -> MechanicalSystem:
    nothing = np.zeros((3, 3))
    return MechanicalSystem(
        np.diag([1.0, 1.0, 0.4 * 0.09]),
        nothing,
        nothing,
        [[0.0, 1.0, 0.0]],
        [0.0, -GRAVITY, 0.0],
        restitution=restitution,
        tangents=[[1.0, 0.0, 0.3]],
        friction=[friction],
    )


def _rolling() -> Problem:
    # It rolls once it has lost 2/7 of its speed.
    rolls = 2.0 / 7.0 * 2.0 / (0.2 * GRAVITY)
    way = rolls * 6.0 / 7.0 * 2.0 + (1.0 - rolls) * 5.0 / 7.0 * 2.0
    turned = -(0.5 * rolls + 1.0 - rolls) * 5.0 / 7.0 * 2.0 / 0.3
    return Problem(
        "ball: slides, then rolls",
        _ball(0.2, 0.0),
        np.zeros(3),
        _moving(1, 2.0),
        1.0,
        np.array([way, 0.0, turned]),
        way,
    )


def _bouncing() -> Problem:
    # It rebounds with half of its speed, and its point of contact is braked by mu times the normal impulse.
    down, spin, height, friction = 3.0, 20.0, 0.5, 0.2
    lands = (math.sqrt(down**2 + 2.0 * GRAVITY * height) - down) / GRAVITY
    speed = down + GRAVITY * lands
    braked = friction * 1.5 * speed
    end = lands + 0.2
    q = [
        lands * 1.0 + 0.2 * (1.0 - braked),
        0.2 * 0.5 * speed - 0.5 * GRAVITY * 0.04,
        end * spin - 0.2 * braked * 0.3 / (0.4 * 0.09),
    ]
    return Problem(
        "ball with spin: one bounce",
        _ball(friction, 0.5),
        np.array([0.0, height, 0.0]),
        np.array([1.0, -down, spin]),
        end,
        np.array(q),
        1.0,
    )


def _rocking() -> Problem:
    # Housner's block, to the middle of its second arc.
    width, height = 0.4, 2.0
    alpha, inertia = width / height, (width**2 + height**2) / 3.0
    tilt, rate = 0.3 * alpha, math.sqrt(GRAVITY * height / (2.0 * inertia))
    lands = math.acosh(alpha / (alpha - tilt)) / rate
    ratio, speed = 1.0 - 0.5 * width**2 / inertia, -rate * (alpha - tilt) * math.sinh(rate * lands)
    late = 0.5 * lands
    phi = -alpha + alpha * math.cosh(rate * late) + ratio * speed / rate * math.sinh(rate * late)
    start = np.array([-0.5 * height * tilt, 0.5 * width * tilt, tilt])
    end = np.array([-0.5 * height * phi, -0.5 * width * phi, phi])
    system = box_stack([1.0], [width], [height], [2.0])
    return Problem("rocking block: an arc and a half", system, start, np.zeros(3), lands + late, end, tilt)


def _stack() -> Problem:
    # The highest slides to its stop.
    way = 1.0 / (2.0 * 0.4 * GRAVITY)
    q = np.zeros(30)
    q[27] = way
    return Problem("ten boxes: the top slides", _boxes(10, 0.4), np.zeros(30), _moving(10, 1.0), 0.4, q, way)


def _sliding_stack() -> Problem:
    # They slide down a slope together.
    way = 0.5 * GRAVITY * (math.sin(0.35) - 0.2 * math.cos(0.35)) * 0.25
    frictions = np.array([0.2] + [0.6] * 9)
    system = box_stack(np.ones(10), np.full(10, 6.0), np.full(10, 0.5), frictions, slope=0.35)
    return Problem(
        "ten boxes: all slide",
        system,
        np.zeros(30),
        np.zeros(30),
        0.5,
        np.tile([way, 0.0, 0.0], 10),
        way,
    )


def _boxes(count: int, friction: float, slope: float = 0.0) -> MechanicalSystem:
    return box_stack(
        np.ones(count), np.ones(count), np.full(count, 0.5), np.full(count, friction), slope=slope
    )


def _moving(bodies: int, speed: float) -> Vector:
    v = np.zeros(3 * bodies)
    v[-3] = speed
    return v
