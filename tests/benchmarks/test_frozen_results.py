import json
from pathlib import Path
from typing import Any

import pytest

from benchmarks.frozen_answers.answers import chosen, plain
from benchmarks.frozen_answers.comparison import read_frozen
from benchmarks.frozen_answers.contracts import EVERY, all_contracts
from benchmarks.frozen_results import main
from pricing_core.american import contract_from
from pricing_core.errors import InvalidInputError

CONTRACTS = 22  # none of these takes long


@pytest.fixture(scope="module")
def frozen(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("frozen") / "old.jsonl"
    assert main(["make", str(file), "--contracts", str(CONTRACTS)]) == 0
    return file


class Pair:
    """The frozen answers, in which the first price is of a method of its own, and the same with that price changed."""

    def __init__(self, frozen: Path, folder: Path) -> None:
        self.frozen, self.old, self.new = frozen, folder / "old.jsonl", folder / "new.jsonl"
        self.write(self.old, {})

    def compare(self, change: dict[str, Any], *more: str) -> int:
        self.write(self.new, change)
        return main(["compare", str(self.old), str(self.new), *more])

    def write(self, file: Path, change: dict[str, Any]) -> None:
        records = [json.loads(line) for line in self.frozen.read_text().splitlines()]
        answer = next(record["answer"] for record in records if record.get("kind") == "price")
        answer |= {"method": "another", "error_estimate": 1e-5}
        answer |= {name: new(answer[name]) if callable(new) else new for name, new in change.items()}
        file.write_text("".join(json.dumps(record) + "\n" for record in records))


@pytest.fixture
def pair(frozen: Path, tmp_path: Path) -> Pair:
    return Pair(frozen, tmp_path)


def test_the_contracts_are_those_of_every_run_and_nearly_all_are_sound():
    contracts = all_contracts()
    assert contracts == all_contracts()
    assert [contract.id for contract in contracts] == list(range(EVERY))
    assert EVERY == 3000
    refused = set()
    for contract in contracts:
        try:
            contract_from(contract.terms)
        except InvalidInputError:
            refused.add(contract.family)
    assert refused == {"refused"}


def test_few_contracts_are_asked_few_questions_of_every_kind():
    few = all_contracts()[::150]
    assert [contract.id for contract in chosen("price", few)] == [contract.id for contract in few]
    assert 0 < len(chosen("lcs", few)) < len(chosen("boundary", few)) < len(few)


def test_missing_and_infinite_numbers_are_held_as_json_has_them():
    assert plain((1.0, float("nan"), [float("-inf"), None], "ok")) == [1.0, None, ["-inf", None], "ok"]


def test_two_runs_give_one_file_and_no_difference(frozen, tmp_path, capsys):
    again = tmp_path / "new.jsonl"
    main(["make", str(again), "--contracts", str(CONTRACTS)])
    assert again.read_bytes() == frozen.read_bytes()
    assert read_frozen(again).checksum in capsys.readouterr().out
    assert main(["compare", str(frozen), str(again)]) == 0
    assert capsys.readouterr().out.endswith("\nNo difference.\n")


def test_every_answer_is_an_answer(frozen):
    answers = read_frozen(frozen).answers
    assert not [key for key, answer in answers.items() if "raised" in answer]
    assert {kind for kind, _ in answers} > {"price", "greeks", "boundary", "implied", "lcs", "surface"}


def test_a_changed_number_is_reported_with_the_nearer_side(pair, tmp_path, capsys):
    report = tmp_path / "report.md"
    assert pair.compare({"price": lambda price: price + 1.0}, "--report", str(report), "--fine") == 1
    assert capsys.readouterr().out.startswith("There are differences.")
    text = report.read_text()
    assert "1 beyond both error estimates. Nearer: old 1.\n" in text
    assert "| price | another |  |  |  |  | 1 |  |" in text
    assert "| price | another | price | 1 | 1 | 1 | 1 |" in text


def test_a_number_changed_within_the_errors_is_no_contradiction(pair, capsys):
    assert pair.compare({"price": lambda price: price + 1.5e-5}) == 1
    text = capsys.readouterr().out
    assert "0 beyond both error estimates.\n\nNone.\n" in text
    assert "| price | another |  |  |  | 1 |  |  |" in text


def test_the_last_digits_may_differ(pair, capsys):
    assert pair.compare({"intrinsic_value": lambda value: value + 1e-12}) == 0  # at a strike of 100
    assert capsys.readouterr().out.endswith("\nNo difference.\n")


def test_a_compiled_engine_owes_the_same_digits(pair, capsys):
    change = {"price": lambda price: price + 1e-6, "method": "premium-march"}
    pair.write(pair.old, {"method": "premium-march"})
    assert pair.compare(change) == 1
    assert "1 of the same compiled engine, another value" in capsys.readouterr().out


def test_a_changed_word_and_a_number_that_went_are_counted(pair, capsys):
    assert pair.compare({"status": "deadline", "price": None}) == 1
    text = capsys.readouterr().out
    assert "| price | price | a number | none | 1 | 1 | 0 |" in text
    assert "| price | status | ok | deadline | 1 | 1 | 0 |" in text


def test_answers_for_other_contracts_are_not_compared(frozen, tmp_path):
    other = tmp_path / "other.jsonl"
    main(["make", str(other), "--contracts", "1"])
    with pytest.raises(ValueError, match="other contracts"):
        main(["compare", str(frozen), str(other)])
