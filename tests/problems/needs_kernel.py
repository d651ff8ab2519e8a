"""The marker of tests that need the compiled engines."""

import pytest

from pricing_core import kernel_name

# Without the kernel there is no premium march and no collocation, and the march in NumPy takes minutes for both.
needs_kernel = pytest.mark.skipif(kernel_name() != "rust", reason="needs the compiled engines")
