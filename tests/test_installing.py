"""What installing decides and says: the extras, the kernel, the files of the distribution."""

import re
import runpy
import subprocess
import sys
import tomllib
from collections.abc import Iterable
from pathlib import Path

import pytest
import setuptools

from pricing_core.errors import MissingExtraError, PricingCoreError
from pricing_core.extras import EXTRAS, explained, needs_extra

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]


def distribution(requirement: str) -> str:
    return requirement.split(">=", maxsplit=1)[0].replace("-", "_").lower()


def test_the_extras_are_those_of_the_distribution():
    declared = PROJECT["optional-dependencies"]
    for extra, modules in EXTRAS.items():
        installed = {distribution(requirement) for requirement in declared[extra]}
        assert installed <= set(modules), extra  # fastapi brings starlette
    assert declared["all"] == [f"pricing-core[{','.join(sorted(EXTRAS, key=list(declared).index))}]"]


def test_the_library_alone_needs_five_packages():
    assert {distribution(one) for one in PROJECT["dependencies"]} == {
        "numpy",
        "scipy",
        "pyamg",
        "python_flint",
        "clarabel",
    }


@pytest.mark.parametrize("extra", EXTRAS)
def test_an_import_says_which_extra_it_lacks(extra):
    (module, *_) = EXTRAS[extra]
    lacking = ModuleNotFoundError(f"No module named {module!r}", name=f"{module}.part")
    message = f'{module} is not installed: pip install "pricing-core[{extra}]"'
    with pytest.raises(MissingExtraError, match=re.escape(message)), needs_extra(extra):
        raise lacking
    assert isinstance(explained(lacking, extra), PricingCoreError)


def test_a_fault_of_our_own_stays_what_it_is():
    fault = ModuleNotFoundError("No module named 'pricing_core.gone'", name="pricing_core.gone")
    with pytest.raises(ModuleNotFoundError) as raised, needs_extra("batch"):
        raise fault
    assert raised.value is fault


# What each import lacks where no extra is installed: a finder in front of the others that knows nothing of them.
BLOCKED = """
import sys
class Nothing:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in {modules}:
            raise ModuleNotFoundError(f"No module named {{name!r}}", name=name)
sys.meta_path.insert(0, Nothing())
"""
ALL_MODULES = sorted({module for modules in EXTRAS.values() for module in modules})


def alone(code: str, lacking: Iterable[str] = ALL_MODULES) -> "subprocess.CompletedProcess[str]":
    """Run code where none of these modules can be imported, by default none of any extra."""
    whole = BLOCKED.format(modules=sorted(lacking)) + code
    return subprocess.run(
        [sys.executable, "-c", whole], capture_output=True, text=True, check=False, timeout=120
    )


def test_the_library_works_alone():
    done = alone(
        "import pricing_core.lcp, pricing_core.lcs, pricing_core.models, pricing_core.max_plus\n"
        "from pricing_core.american import Market, Option, price\n"
        "print(round(price(Option('put', 100.0, 1.0), Market(100.0, rate=0.05, volatility=0.2), tolerance=1e-3).price))"
    )
    assert (done.stdout, done.returncode) == ("6\n", 0), done.stderr


@pytest.mark.parametrize(
    ("module", "extra"),
    [
        ("pricing_core.batch", "batch"),
        ("app.client", "client"),
        ("app.main", "service"),
        ("app.service.server", "service"),
        ("app.commands.boundary_plot", "plot"),
        ("app.commands.simulation_plots", "plot"),
    ],
)
def test_a_module_that_lacks_its_extra_says_which(module, extra):
    done = alone(f"import {module}")
    assert done.stderr.strip().endswith(f'pip install "pricing-core[{extra}]"')
    assert "MissingExtraError" in done.stderr


@pytest.mark.parametrize("extra", EXTRAS)
def test_each_extra_that_is_missing_alone_is_named(extra):
    """All others are installed; only modules that no other extra brings are missing."""
    entries = {
        "batch": "import pricing_core.batch",
        "client": "import app.client",
        "cluster": "import pricing_core.batch.cluster",
        "cli": "from app.__main__ import main; main()",
        "plot": "import app.commands.boundary_plot",
        "service": "import app.main",
    }
    lacking = set(EXTRAS[extra]) - {"pyarrow"} if extra != "batch" else {"pyarrow"}
    done = alone(entries[extra], lacking)
    assert done.returncode != 0
    assert f'is not installed: pip install "pricing-core[{extra}]"' in done.stderr.splitlines()[-1]


def test_the_command_that_lacks_its_extra_says_so_in_one_line():
    done = alone("import sys; sys.argv = ['pricing', '--help']; from app.__main__ import main; main()")
    assert done.returncode == 2
    assert done.stdout == ""
    assert done.stderr.count("\n") == 1
    assert 'is not installed: pip install "pricing-core[cli]"' in done.stderr


@pytest.fixture
def built(monkeypatch, tmp_path, capsys):
    """Return what `setup.py` builds with a compiler that tells this version: options of `setup`, and what it prints."""

    def build(version=None, *, cargo=True, wanted=None):
        asked = {}
        monkeypatch.setattr(setuptools, "setup", lambda **options: asked.update(options))
        for name in ("cargo", "rustc"):
            program = tmp_path / name
            if (cargo and name == "cargo") or (version and name == "rustc"):
                program.write_text(f"#!/bin/sh\necho rustc {version} '(0000000 2025-01-01)'\n")
                program.chmod(0o755)
        monkeypatch.setenv("PATH", str(tmp_path) + ":/bin")
        for name in ("CARGO", "RUSTC", "PRICING_CORE_KERNEL"):
            monkeypatch.delenv(name, raising=False)
        if wanted is not None:
            monkeypatch.setenv("PRICING_CORE_KERNEL", wanted)
        runpy.run_path(str(ROOT / "setup.py"))
        return asked, capsys.readouterr().err

    return build


@pytest.mark.parametrize("version", ["1.89.0", "1.95.0-nightly", "2.0.0"])
def test_the_kernel_is_compiled_for_the_stable_interface(built, version):
    asked, told = built(version)
    (kernel,) = asked["rust_extensions"]
    assert kernel.name == "pricing_core._kernels"
    assert not kernel.optional
    assert asked["options"] == {"bdist_wheel": {"py_limited_api": "cp311"}}
    assert told == ""


@pytest.mark.parametrize(
    ("version", "options", "reason"),
    [
        ("1.85.0", {}, "rustc 1.85.0 (0000000 2025-01-01) is older than 1.89"),
        ("0.9.0", {}, "is older than 1.89"),
        (None, {}, "rustc does not run"),
        (None, {"cargo": False}, "cargo is not on PATH"),
        ("1.95.0", {"wanted": "none"}, "PRICING_CORE_KERNEL is none"),
    ],
)
def test_without_a_kernel_the_package_is_pure(built, version, options, reason):
    asked, told = built(version, **options)
    assert set(asked) == {"cmdclass"}
    assert told.count("\n") == 1
    assert told.startswith("pricing-core: the kernel is not compiled, since ")
    assert reason in told


def test_a_wish_that_is_none_of_those_allowed_ends_the_build(built):
    with pytest.raises(SystemExit, match='PRICING_CORE_KERNEL = \'yes\': must be "auto" or "none"'):
        built("1.95.0", wanted="yes")
