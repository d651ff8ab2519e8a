"""Time stepping with error control; knows nothing of complementarity."""

from __future__ import annotations

from pricing_core.stepping.controller import (
    Decision,
    FixedStep,
    IController,
    PIController,
    StepSizeController,
)
from pricing_core.stepping.implicit import DiagonallyImplicit, ImplicitStage, RannacherStart
from pricing_core.stepping.integrate import Integration, integrate
from pricing_core.stepping.method import OneStepMethod, Step, StepDoubling
from pricing_core.stepping.tableaux import (
    ESDIRK3,
    IMPLICIT_EULER,
    SDIRK2,
    SDIRK3,
    Tableau,
    theta_method,
)

__all__ = [
    "ESDIRK3",
    "IMPLICIT_EULER",
    "SDIRK2",
    "SDIRK3",
    "Decision",
    "DiagonallyImplicit",
    "FixedStep",
    "IController",
    "ImplicitStage",
    "Integration",
    "OneStepMethod",
    "PIController",
    "RannacherStart",
    "Step",
    "StepDoubling",
    "StepSizeController",
    "Tableau",
    "integrate",
    "theta_method",
]
