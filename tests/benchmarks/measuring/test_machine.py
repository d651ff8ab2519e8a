from pathlib import Path

import pytest

import pricing_core
from benchmarks.measuring import machine


def test_the_processor_is_named_as_linux_describes_it(tmp_path: Path) -> None:
    information = tmp_path / "cpuinfo"
    information.write_text("processor : 0\nmodel name\t: Fast One\n\nprocessor : 1\nmodel name\t: Fast One\n")
    assert machine.cpu_model(information) == "Fast One"


def test_the_clock_is_the_one_linux_states_or_unknown(tmp_path: Path) -> None:
    information = tmp_path / "cpuinfo"
    information.write_text("processor : 0\ncpu MHz\t\t: 2596.1\n")
    assert machine.nominal_megahertz(information) == 2596.1
    assert machine.nominal_megahertz(tmp_path / "missing") is None


def test_without_that_description_the_processor_still_has_a_name(tmp_path: Path) -> None:
    assert machine.cpu_model(tmp_path / "missing")


def test_versions_and_kernel_are_those_in_use(monkeypatch: pytest.MonkeyPatch) -> None:
    known = machine.machine_and_versions()
    assert known["pricing-core"] == pricing_core.__version__
    assert known["kernel"] == pricing_core.kernel_name()

    def not_there(package: str) -> str:
        raise machine.PackageNotFoundError(package)

    monkeypatch.setattr(machine, "version", not_there)
    assert machine.machine_and_versions()["QuantLib"] == "not installed"
