"""The inner loops: the compiled crate where it was built, else its NumPy twin with the same arguments."""

# A kernel that is there but does not load raises: only a missing one is replaced.
try:
    from pricing_core._kernels import (
        brennan_schwartz,
        policy_iteration,
        premium_march,
        premium_values,
        profile_values,
        projected_sor,
    )

    _NAME = "rust"
except ModuleNotFoundError:
    from pricing_core.kernel_twin import brennan_schwartz, policy_iteration, projected_sor
    from pricing_core.premium_twin import premium_march, premium_values, profile_values

    _NAME = "numpy"

__all__ = [
    "brennan_schwartz",
    "kernel_name",
    "policy_iteration",
    "premium_march",
    "premium_values",
    "profile_values",
    "projected_sor",
]


def kernel_name() -> str:
    """Return "rust" where the compiled kernel is in use, else "numpy"."""
    return _NAME
