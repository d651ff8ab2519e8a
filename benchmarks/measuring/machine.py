"""The machine and the versions that a figure was measured with."""

import os
import platform
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import pricing_core

CPU_INFORMATION = Path("/proc/cpuinfo")


def machine_and_versions() -> dict[str, str | int]:
    """Return what a reader needs to repeat the measurement."""
    return {
        "cpu": cpu_model(),
        "cores": os.cpu_count() or "unknown",
        "architecture": platform.machine(),
        "system": f"{platform.system()} {platform.release()}",
        "python": platform.python_version(),
        "numpy": _version_of("numpy"),
        "scipy": _version_of("scipy"),
        "pricing-core": pricing_core.__version__,
        "kernel": pricing_core.kernel_name(),
        "QuantLib": _version_of("QuantLib"),
    }


def cpu_model(information: Path = CPU_INFORMATION) -> str:
    """Return the processor's name from Linux's own description, else what the platform module knows."""
    names = _values_of("model name", information)
    return names[0] if names else platform.processor() or "unknown"


def vector_instructions(information: Path = CPU_INFORMATION) -> str:
    """Return the widest vector instructions that Linux lists: AVX-512, AVX2, or the architecture's own."""
    flags = " ".join(_values_of("flags", information)[:1]).split()
    names = {"avx512f": "AVX-512", "avx2": "AVX2"}
    return next((name for flag, name in names.items() if flag in flags), platform.machine())


def nominal_megahertz(information: Path = CPU_INFORMATION) -> float | None:
    """Return the clock that Linux states for the first core, in MHz, or None."""
    clocks = _values_of("cpu MHz", information)
    return float(clocks[0]) if clocks else None


def _values_of(key: str, information: Path) -> list[str]:
    try:
        lines = information.read_text(errors="replace").splitlines()
    except OSError:
        return []
    return [line.partition(":")[2].strip() for line in lines if line.startswith(key)]


def _version_of(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "not installed"
