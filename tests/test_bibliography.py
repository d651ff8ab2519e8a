"""Every source that a docstring or a page names by author and year stands in the bibliography."""

import calendar
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "bibliography.md"
ENTRIES = re.split(r"^\* ", PAGE.read_text(encoding="utf-8"), flags=re.MULTILINE)[1:]
NAME = r"(?:(?:van |der |den |De )*[A-Z][\w'-]*[a-z])"
CITED = re.compile(rf"({NAME})(?:(?:,|,? and)\s+{NAME})*(?:'s)?\s+\(?((?:18|19|20)\d\d)\b(?! [A-Z])")
MONTHS = (*calendar.month_name, *calendar.month_abbr)
TEXTS = [
    *(path for folder in ("pricing_core", "app") for path in (ROOT / folder).rglob("*.py")),
    *(ROOT / "kernels" / "src").rglob("*.rs"),
    *(path for path in (ROOT / "docs").rglob("*.md") if path != PAGE),
]


def cited() -> set[tuple[str, str]]:
    """Return the last name before each year, and the year."""
    found = set()
    for path in TEXTS:
        for match in CITED.finditer(path.read_text(encoding="utf-8")):
            if match[1] not in MONTHS:
                found.add((match[1].removesuffix("'s"), match[2]))
    return found


@pytest.mark.parametrize(("name", "year"), sorted(cited()))
def test_the_bibliography_has_it(name: str, year: str) -> None:
    assert any(name in entry and year in entry for entry in ENTRIES)
