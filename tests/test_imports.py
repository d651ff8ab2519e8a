"""What the library, a price and its command do without: modules that they must not import."""

import subprocess
import sys
from pathlib import Path

import pytest

import pricing_core
from tests.problems.needs_kernel import needs_kernel

IMPORT = "import pricing_core.american"
PRICE = """
from pricing_core.american import Market, Option, price
price(Option("put", 100.0, 1.0), Market(100.0, rate=0.05, volatility=0.2), {more})
"""
COMMAND = """
from app.cli import app
app("price --option-type put --spot 100 --strike 100 --expiry 1 --rate 0.05 --volatility 0.2".split(),
    standalone_mode=False)
"""
ENGINE_NEEDS_NONE = ("scipy.optimize", "scipy.sparse", "pyarrow", "matplotlib", "fastapi", "pydantic", "rich")
COMMAND_NEEDS_NONE = ("scipy.optimize", "scipy.sparse", "pyarrow", "matplotlib", "fastapi")
LIBRARY_NEEDS_NONE = ("matplotlib", "pydantic", "fastapi", "typer", "rich", "pyarrow", "app")
LIBRARY = Path(pricing_core.__file__).parent
MODELS = Path(__file__).parents[1] / "examples" / "models"


def imported_by(code: str) -> set[str]:
    """Return the names of all modules that a new interpreter has loaded after the code."""
    report = "import sys; print(*sys.modules, sep='\\n', file=sys.stderr)"
    found = subprocess.run(
        [sys.executable, "-c", f"{code}\n{report}"], capture_output=True, text=True, check=True, timeout=60
    )
    return set(found.stderr.split())


# Without the kernel a price needs the general march in NumPy, and the splines of its grids.
@pytest.mark.parametrize(
    "code", [IMPORT, pytest.param(PRICE.format(more=""), marks=needs_kernel)], ids=["import", "price"]
)
def test_the_option_engine_does_without_optimisers_tables_and_plots(code: str) -> None:
    assert imported_by(code).isdisjoint(ENGINE_NEEDS_NONE)


@needs_kernel
def test_the_price_command_does_without_tables_plots_and_the_service() -> None:
    assert imported_by(COMMAND).isdisjoint(COMMAND_NEEDS_NONE)


def test_a_method_of_the_library_is_imported_when_it_is_asked_for() -> None:
    code = PRICE.format(more="resolution=Resolution(16, 16), lcp_method='psor', greeks='none'").replace(
        "Option, price", "Option, Resolution, price", 1
    )
    assert "pricing_core.lcp.psor" in imported_by(code)


def test_the_library_but_for_its_tables_does_without_plots_the_service_and_the_command() -> None:
    paths = [path.relative_to(LIBRARY.parent).with_suffix("") for path in LIBRARY.rglob("*.py")]
    names = {
        ".".join(path.parts).removesuffix(".__init__")
        for path in paths
        if not {"batch", "arrow", "chains", "implied_frames"} & {*path.parts}
    }
    imported = imported_by("import " + ", ".join(sorted(names)))
    assert names <= imported
    assert imported.isdisjoint(LIBRARY_NEEDS_NONE)


def test_model_files_of_every_kind_are_run_without_plots() -> None:
    code = f"""
from pathlib import Path
from app.commands.model_files import simulate_file
for path in Path({str(MODELS)!r}).glob("*.json"):
    simulate_file(path)
"""
    imported = imported_by(code)
    assert "app.commands.models.max_plus" in imported
    assert "matplotlib" not in imported
