"""The march over one segment by the general time integration: any scheme, any solver, any mesh of times."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from pricing_core.american.book.resolution import Resolution, Scheme
from pricing_core.american.engines.method_of_lines.crank_nicolson import crank_nicolson, damped_until
from pricing_core.american.engines.method_of_lines.stage import OptionStage, OptionState
from pricing_core.american.engines.method_of_lines.time_mesh import prescribed_mesh
from pricing_core.stepping import (
    IMPLICIT_EULER,
    SDIRK2,
    DiagonallyImplicit,
    FixedStep,
    Integration,
    OneStepMethod,
    PIController,
    StepDoubling,
    integrate,
)

LOCAL_TOLERANCE = 0.02  # Local error of v per adaptive step, in strikes, times steps**3; calibrated.


def integrate_stage(
    stage: OptionStage,
    state: OptionState,
    duration: float,
    steps: int,
    resolution: Resolution,
    *,
    stop_times: Sequence[float] = (),
    interrupt: Callable[[], bool] | None = None,
) -> Integration[OptionState]:
    """Step from `state` over `duration` years by the scheme and on the mesh of times that the resolution asks for.

    Parameters
    ----------
    steps : int
        Instead of the resolution's own.
    stop_times : sequence of float
        Times from the start at which a step must end besides those of the mesh.
    """
    mesh = prescribed_mesh(resolution.time_mesh, duration, steps, stop_times)
    methods: dict[Scheme, OneStepMethod[OptionState]] = {
        "sdirk2": DiagonallyImplicit(stage, SDIRK2),
        "implicit-euler": DiagonallyImplicit(stage, IMPLICIT_EULER),
        "crank-nicolson": crank_nicolson(stage, damped_until(mesh.tolist())),
    }
    method = methods[resolution.scheme or "sdirk2"]
    adaptive = resolution.time_mesh == "adaptive"
    local = LOCAL_TOLERANCE / steps ** (method.order + 1)
    return integrate(
        StepDoubling(method) if adaptive else method,
        state,
        (0.0, duration),
        controller=PIController(0.0, local, start=1.0 / steps**2) if adaptive else FixedStep(),
        stop_times=[*stop_times] if adaptive else mesh[1:].tolist(),
        interrupt=interrupt,
    )
