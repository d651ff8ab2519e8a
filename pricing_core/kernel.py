"""The inner loops: the compiled crate where it was built, else NumPy's for the solvers of complementarity problems.

The two fast engines exist only compiled; they are None otherwise.
"""

from __future__ import annotations

import warnings
from functools import cache
from types import ModuleType

from pricing_core import dense_twin, kernel_twin, mode_twin, sparse_twin
from pricing_core.errors import KernelMissingWarning

# A kernel that is there but does not load raises: only a missing one is replaced.
try:
    from pricing_core import _kernels as _compiled
except ImportError as _error:
    if "_kernels" not in str(_error):
        raise
    _compiled = None  # type: ignore[assignment]

_small: ModuleType = kernel_twin if _compiled is None else _compiled
_dense: ModuleType = dense_twin if _compiled is None else _compiled
_sparse: ModuleType = sparse_twin if _compiled is None else _compiled
_mode: ModuleType = mode_twin if _compiled is None else _compiled

brennan_schwartz = _small.brennan_schwartz
enter_mode = _mode.enter_mode
equilibrate = _dense.equilibrate
growing_basic_set = _small.growing_basic_set
initial_signs = _mode.initial_signs
leading_signs = _mode.leading_signs
lemke = _dense.lemke
march_strikes = _small.march_strikes
policy_iteration = _small.policy_iteration
projected_sor = _small.projected_sor
sparse_sweeps = _sparse.sparse_sweeps
taylor_step = _mode.taylor_step
price_options = None if _compiled is None else _compiled.price_options
solve_puts = None if _compiled is None else _compiled.solve_puts
march_boundaries = None if _compiled is None else _compiled.march_boundaries
MarchSettings = None if _compiled is None else _compiled.MarchSettings
SegmentTable = None if _compiled is None else _compiled.SegmentTable
VolatilitySurface = None if _compiled is None else _compiled.VolatilitySurface
march_segments = None if _compiled is None else _compiled.march_segments


def kernel_name() -> str:
    """Return "rust" where the compiled kernel is in use, else "numpy"."""
    return "numpy" if _compiled is None else "rust"


def instruction_set() -> str:
    """Return the instructions that the compiled kernel uses here; answers differ between them by rounding."""
    return "numpy" if _compiled is None else str(_compiled.instruction_set())


@cache
def warn_where_missing() -> None:
    """Warn, once, where the compiled kernel was not built."""
    if _compiled is None:
        text = (
            "the compiled kernel is missing, so that options are priced in NumPy, 100 times slower and more: "
            "install Rust 1.89 or later and install pricing-core again"
        )
        warnings.warn(text, KernelMissingWarning, stacklevel=2)
