"""Time stepping with error control; knows nothing of complementarity."""

from __future__ import annotations

from pricing_core.stepping.controller import (
    Decision,
    FixedStep,
    IController,
    PIController,
    StepSizeController,
)
from pricing_core.stepping.implicit import ImplicitEuler, ImplicitStage, Sdirk2, ThetaMethod
from pricing_core.stepping.integrate import Integration, integrate
from pricing_core.stepping.method import OneStepMethod, Step, StepDoubling

__all__ = [
    "Decision",
    "FixedStep",
    "IController",
    "ImplicitEuler",
    "ImplicitStage",
    "Integration",
    "OneStepMethod",
    "PIController",
    "Sdirk2",
    "Step",
    "StepDoubling",
    "StepSizeController",
    "ThetaMethod",
    "integrate",
]
