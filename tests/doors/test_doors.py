"""What one door takes, all take: every spelling of every field through every door."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from app.client import Client
from pricing_core.american import contract_from, price
from pricing_core.errors import InvalidInputError
from tests.app.service.server_process import running
from tests.doors.doors import DOORS, TOLERANCE, RefusedError, Tools
from tests.doors.spellings import EMPTY, REFUSED, SPELLINGS, Contract, Spelling, page
from tests.problems.needs_kernel import needs_kernel

PAGE = Path(__file__).parents[2] / "docs" / "spellings.md"
pytestmark = needs_kernel


@pytest.fixture(scope="module")
def tools(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Tools]:
    with running() as server, Client(f"http://127.0.0.1:{server.port}") as client:
        yield Tools(server, client, tmp_path_factory.mktemp("doors"))


def meant(contract: Contract) -> float:
    found = price(*contract_from(contract), tolerance=TOLERANCE, greeks="none").price
    assert found is not None
    return found


@pytest.mark.parametrize("door", DOORS)
@pytest.mark.parametrize("spelling", SPELLINGS, ids=lambda one: f"{one.field}-{one.words}")
def test_every_door_takes_every_spelling(tools: Tools, door: str, spelling: Spelling) -> None:
    assert DOORS[door].price(spelling.written, tools) == pytest.approx(meant(spelling.meant), rel=1e-9)


@pytest.mark.parametrize("door", [name for name, door in DOORS.items() if door.has_cells])
@pytest.mark.parametrize("spelling", EMPTY, ids=lambda one: one.field)
def test_an_empty_cell_stands_for_what_is_not_given(tools: Tools, door: str, spelling: Spelling) -> None:
    assert DOORS[door].price(spelling.written, tools) == pytest.approx(meant(spelling.meant), rel=1e-9)


@pytest.mark.parametrize("door", DOORS)
@pytest.mark.parametrize(("field", "contract"), [(field, contract) for field, _, contract in REFUSED])
def test_no_door_takes_what_is_none(tools: Tools, door: str, field: str, contract: Contract) -> None:
    with pytest.raises((InvalidInputError, RefusedError)) as caught:
        DOORS[door].price(contract, tools)
    told = str(caught.value)
    assert any(word in told for word in (field, field.replace("_", "-"), field.replace("_", "-")[:-1], "NaN"))


def test_the_page_of_the_documentation_is_this_table() -> None:
    told = "python -m tests.doors.spellings > docs/spellings.md"
    assert PAGE.read_text(encoding="utf-8") == page(), f"write it anew: {told}"
