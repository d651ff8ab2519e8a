"""The README's question to the service is answered as it is printed there."""

import json
import re
from pathlib import Path

from fastapi.testclient import TestClient

from app.main import create_app

README = (Path(__file__).parents[2] / "README.md").read_text()
SECTION = README.split("\n## Service\n")[1].split("\n## ")[0]
NUMBER = re.compile(r'"(\w+)": (-?\d+\.(\d+))\.\.\.')


def check_numbers(printed: str, answer: dict[str, float]) -> None:
    """Accept what is printed up to its last digit, which is cut."""
    shown = NUMBER.findall(printed)
    assert shown
    for name, number, digits in shown:
        assert abs(answer[name] - float(number)) <= 10.0 ** -len(digits)


def test_the_questions_are_answered_as_printed() -> None:
    question = json.loads(SECTION.split("-d '")[1].split("'")[0])
    with TestClient(create_app()) as client:
        answer = client.post("/v1/price", json=question)
        assert answer.status_code == 200
        check_numbers(SECTION.split("}'\n")[1].split("\n\n")[0], answer.json())
        priced = {name: value for name, value in question.items() if name != "volatility"}
        answer = client.post("/v1/implied-volatility", json=priced | {"option_price": 6.09})
        check_numbers(SECTION.split("for 6.09 answers")[1].split("`")[1], answer.json())
