"""The inner loops: the compiled crate where it was built, else its NumPy twin with the same arguments."""

# A kernel that is there but does not load raises: only a missing one is replaced.
try:
    from pricing_core._kernels import (
        brennan_schwartz,
        march_boundaries,
        policy_iteration,
        projected_sor,
        solve_puts,
        solve_schedules,
    )

    _NAME = "rust"
except ModuleNotFoundError:
    from pricing_core.collocation_twin import solve_schedules
    from pricing_core.kernel_twin import brennan_schwartz, policy_iteration, projected_sor
    from pricing_core.premium_twin import march_boundaries, solve_puts

    _NAME = "numpy"

__all__ = [
    "brennan_schwartz",
    "kernel_name",
    "march_boundaries",
    "policy_iteration",
    "projected_sor",
    "solve_puts",
    "solve_schedules",
]


def kernel_name() -> str:
    """Return "rust" where the compiled kernel is in use, else "numpy"."""
    return _NAME
