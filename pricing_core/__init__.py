"""American options and the linear complementarity systems beneath them."""

from __future__ import annotations

from pricing_core.kernel import kernel_name
from pricing_core.version import ENGINE_VERSION as __version__

__all__ = ["__version__", "kernel_name"]
