"""What the NumPy twins of the kernel are spared in tests."""

import pytest

from pricing_core import kernel_name

# The twins are compared with the kernel, problem by problem, in tests of their own.
slow_on_the_twin = pytest.mark.skipif(
    kernel_name() != "rust", reason="takes minutes without the compiled kernel"
)
