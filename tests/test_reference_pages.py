"""The tables of names in the documentation, and the order of its reference."""

import re
import runpy
from pathlib import Path

import pricing_core.american
from pricing_core.american.contracts.result_fields import PRICE_FIELDS

TABLES = runpy.run_path(str(Path(__file__).parents[1] / "docs/extension/vocabulary.py"))["TABLES"]


def test_the_table_of_outputs_names_every_choice_once() -> None:
    _, rows = TABLES["outputs"]()
    meanings = {name: meaning for name, *_, meaning in rows}
    choices = {field.name: field.choices for field in PRICE_FIELDS if field.choices}
    assert "status" in choices
    for name, words in choices.items():
        for word in words:
            assert len(re.findall(rf"\b{word}\b", meanings[name])) == 1, (name, word)


def test_the_reference_of_options_begins_with_price() -> None:
    assert pricing_core.american.__all__[:4] == ["price", "Option", "Market", "Valuation"]
