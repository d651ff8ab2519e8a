"""What a price waits for: modules that the option engine and its command do without."""

import subprocess
import sys

import pytest

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


def imported_by(code: str) -> set[str]:
    """Return the names of all modules that a new interpreter has loaded after the code."""
    report = "import sys; print(*sys.modules, sep='\\n', file=sys.stderr)"
    found = subprocess.run(
        [sys.executable, "-c", f"{code}\n{report}"], capture_output=True, text=True, check=True, timeout=60
    )
    return set(found.stderr.split())


@pytest.mark.parametrize(
    "code",
    [
        IMPORT,
        PRICE.format(more=""),
        PRICE.format(more="method='lcs', lcp_method='policy'"),
        PRICE.format(more="method='crank-nicolson'"),
    ],
    ids=["import", "price", "policy", "crank-nicolson"],
)
def test_the_option_engine_does_without_optimisers_tables_and_plots(code: str) -> None:
    assert imported_by(code).isdisjoint(ENGINE_NEEDS_NONE)


def test_the_price_command_does_without_tables_plots_and_the_service() -> None:
    assert imported_by(COMMAND).isdisjoint(COMMAND_NEEDS_NONE)


def test_a_method_of_the_library_is_imported_when_it_is_asked_for() -> None:
    code = PRICE.format(more="tolerance=1e-2, method='lcs', lcp_method='psor'")
    assert "pricing_core.lcp.psor" in imported_by(code)
