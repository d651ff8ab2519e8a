import json
import time
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.csv as pa_csv
import pytest
from fastapi.testclient import TestClient

from app.main import create_app
from app.service.chain.fitting import MOST_COLUMNS, MOST_QUOTES, fitted_body
from app.service.chain.question import MOST_DIVIDENDS
from app.service.decoded_size import bytes_of_csv, bytes_of_json, bytes_of_table
from app.service.work.lanes import Interruption
from app.settings import Settings
from pricing_core.chains import fit_chain, read_chain
from tests.app.service.test_hostile_inputs import CANARY, assert_problem

SAMPLES = Path(__file__).parents[3] / "data" / "chains"
CSV, JSON, ARROW = "text/csv", "application/json", "application/vnd.apache.arrow.stream"
QUERY = "?rate=0.04"


def arrow_of(path: Path) -> bytes:
    return stream_of(pa_csv.read_csv(path))


def stream_of(table: pa.Table) -> bytes:
    sink = pa.BufferOutputStream()
    with pa.ipc.new_stream(sink, table.schema) as stream:
        stream.write_table(table)
    return bytes(sink.getvalue().to_pybytes())


def ask(client: TestClient, content: bytes, form: str, query: str = QUERY) -> Any:
    return client.post(f"/v1/chain{query}", content=content, headers={"Content-Type": form})


def test_the_answer_is_the_fit_of_the_library_in_every_form(client: TestClient) -> None:
    path = SAMPLES / "generic.csv"
    answers = [
        ask(client, path.read_bytes(), CSV),
        ask(client, arrow_of(path), ARROW),
        ask(client, (SAMPLES / "openbb.json").read_bytes(), JSON),
    ]
    assert [answer.status_code for answer in answers] == [200] * 3, answers[0].text
    first, second, third = (answer.json() for answer in answers)
    fit = fit_chain(read_chain(path), 0.04)
    assert first["flags"] == dict(fit.flags)
    for table in ("carry", "pairs"):
        names = fit.carry.schema.names if table == "carry" else fit.pairs.schema.names
        for name in names:
            wanted = getattr(fit, table)[name].to_pylist()
            if name == "expiration":
                wanted = [day.isoformat() for day in wanted]
            assert first[table][name] == second[table][name] == third[table][name] == wanted, name
    for name in ("mid_volatility", "european_price", "model_price", "status", "flags"):
        assert first["quotes"][name] == fit.quotes[name].to_pylist()
    assert fit.local_volatility is not None
    assert np.array_equal(first["local_volatility"]["values"], fit.local_volatility.values)
    assert first["share_within_after"] == fit.share_within_after


def test_parameters_stand_in_the_query(client: TestClient) -> None:
    content = (SAMPLES / "yfinance.csv").read_bytes()
    query = (
        "?rate=%7B%22times%22%3A%5B1%5D%2C%22values%22%3A%5B0.04%5D%7D&format=yfinance&valuation_date=2026-03-02"
        "&underlying_price=100&tolerance=1e-5&cash_dividends=%5B%7B%22ex_date%22%3A%222026-06-01%22%2C%22amount%22%3A0.5%7D%5D"
    )
    answer = ask(client, content, CSV, query)
    assert answer.status_code == 200, answer.text
    assert answer.json()["carry"]["status"] == ["ok", "ok"]


def test_a_row_that_cannot_be_read_has_a_status_and_is_not_repeated(client: TestClient) -> None:
    text = (SAMPLES / "generic.csv").read_text().replace("100.0,C,3.7", f"{CANARY},C,3.7", 1)
    answer = ask(client, text.encode(), CSV)
    assert answer.status_code == 200, answer.text
    found = answer.json()
    assert found["flags"]["unreadable"] == 1
    assert CANARY not in str(found["quotes"]["message"])


@pytest.mark.parametrize(
    ("query", "field"),
    [
        ("", "rate"),
        ("?rate=x", "rate"),
        ("?rate=%7B%7D", "rate"),
        ("?rate=0.04&rates=1", "parameter of the query"),
        ("?rate=0.04&rate=0.05", "query"),
        ("?rate=0.04&format=bloomberg", "format"),
        ("?rate=0.04&underlying_price=-1", "underlying_price"),
        ("?rate=0.04&valuation_date=yesterday", "valuation_date"),
        ("?rate=0.04&tolerance=2", "tolerance"),
        ("?rate=0.04&cash_dividends=3", "cash_dividends"),
        ("?rate=0.04&cash_dividends=%5B%7B%22amount%22%3A1%7D%5D", "cash_dividends[0].time"),
    ],
)
def test_a_wrong_parameter_is_named(client: TestClient, query: str, field: str) -> None:
    answer = ask(client, (SAMPLES / "generic.csv").read_bytes(), CSV, query)
    problem = assert_problem(answer, 422, "invalid-input")
    assert problem["errors"][0]["field"] == field


@pytest.mark.parametrize(
    ("content", "form", "status", "kind"),
    [
        (b"a,b\n1,2\n", CSV, 422, "invalid-input"),
        (b"", CSV, 422, "invalid-input"),
        (b"\xff\xfe", CSV, 422, "invalid-input"),
        (b'a,"b\n1,2\n', CSV, 422, "invalid-input"),
        (b"[1]", JSON, 422, "invalid-json"),
        (b'{"a": NaN}', JSON, 422, "invalid-json"),
        (b'{"results": [1, 2]}', JSON, 422, "invalid-input"),
        (b'{"strike": [1], "bid": [1, 2]}', JSON, 422, "invalid-input"),
        (b"no stream", ARROW, 422, "invalid-arrow"),
        (b"a\n" + b"1\n" * 20_001, CSV, 413, "body-too-large"),
        (b'{"strike": [' + b"1," * 20_000 + b"1]}", JSON, 413, "body-too-large"),
        (b" " * (1 << 21) + b"{}", JSON, 413, "body-too-large"),
        (b"strike", "text/plain", 415, "unsupported-media-type"),
    ],
)
def test_a_body_that_is_no_chain_is_a_problem(
    client: TestClient, content: bytes, form: str, status: int, kind: str
) -> None:
    assert_problem(ask(client, content, form), status, kind)


def test_other_answers_than_json_are_not_acceptable(client: TestClient) -> None:
    headers = {"Content-Type": CSV, "Accept": "text/html"}
    answer = client.post(f"/v1/chain{QUERY}", content=(SAMPLES / "generic.csv").read_bytes(), headers=headers)
    assert_problem(answer, 406, "not-acceptable")


def test_a_fit_that_takes_too_long_is_told_by_the_deadline(
    client: TestClient, monkeypatch: pytest.MonkeyPatch, waited_for: None
) -> None:
    def late(body: Any, form: str, question: Any, memory: Any, interrupt: Interruption) -> bytes:
        """Fit once the deadline has passed."""
        interrupt.end_by(time.monotonic() - 1.0)
        return fitted_body(body, form, question, memory, interrupt)

    monkeypatch.setattr("app.service.routes.chain.fitted_body", late)
    answer = ask(client, (SAMPLES / "generic.csv").read_bytes(), CSV)
    assert "fewer quotes" in assert_problem(answer, 503, "deadline")["detail"]
    assert answer.headers["Retry-After"]


@pytest.mark.parametrize("form", [JSON, CSV, ARROW])
def test_what_quotes_take_is_counted_before_they_are_made(form: str, monkeypatch: pytest.MonkeyPatch) -> None:
    made = []
    for name in ("of_json", "of_csv", "of_arrow"):
        monkeypatch.setattr(f"app.service.chain.fitting.{name}", made.append)
    content = {
        JSON: b'{"strike": [' + b"1," * 20_000 + b"1]}",
        CSV: b"a" + b"\n1" * 10_000,
        ARROW: arrow_of(SAMPLES / "generic.csv"),
    }[form]
    with TestClient(create_app(Settings(slots=2, max_batch_bytes=len(content) + 100))) as client:
        assert_problem(ask(client, content, form), 413, "body-too-large")
        assert client.app.state.memory.held == 0  # type: ignore[attr-defined]
    assert not made


def test_lines_and_columns_of_csv_are_counted(client: TestClient, monkeypatch: pytest.MonkeyPatch) -> None:
    wide = ",".join(f"c{k}" for k in range(MOST_COLUMNS + 1)).encode() + b"\n"
    problem = assert_problem(ask(client, wide + b"1," * MOST_COLUMNS + b"1\n", CSV), 422, "invalid-input")
    assert problem["detail"].endswith(f"must be at most {MOST_COLUMNS}")
    made: list[str] = []
    monkeypatch.setattr("app.service.chain.fitting.of_csv", made.append)
    assert_problem(ask(client, b"a\n" + b"1\n" * (MOST_QUOTES + 1), CSV), 413, "body-too-large")
    assert not made


@pytest.mark.parametrize("form", [CSV, ARROW])
def test_a_wide_table_is_refused_before_it_is_made(
    client: TestClient, monkeypatch: pytest.MonkeyPatch, form: str
) -> None:
    for made in ("of_csv", "of_arrow"):
        monkeypatch.setattr(f"app.service.chain.fitting.{made}", pytest.fail)
    names = [f"c{k}" for k in range(MOST_COLUMNS + 1)]
    body = ",".join(names).encode() + b"\n"
    if form == ARROW:
        body = stream_of(pa.table({name: pa.nulls(0) for name in names}))
    assert_problem(ask(client, body, form), 422, "invalid-input")


def test_records_with_no_name_in_common_make_no_table(
    client: TestClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It would have as many places as the square of their number."""
    monkeypatch.setattr("pricing_core.chains.raw_files.RawTable", pytest.fail)
    records = json.dumps({"data": [{f"k{k}": 1} for k in range(MOST_COLUMNS + 1)]}).encode()
    problem = assert_problem(ask(client, records, JSON), 422, "invalid-input")
    assert problem["errors"][0]["field"] == "columns"
    many = b'{"data": [' + b"{}," * MOST_QUOTES + b"{}]}"
    assert_problem(ask(client, many, JSON), 413, "body-too-large")


def test_the_places_of_a_sparse_table_are_counted_before_it_is_made(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("pricing_core.chains.raw_files.RawTable", pytest.fail)
    content = json.dumps({"data": [{f"k{k % MOST_COLUMNS}": 1} for k in range(5_000)]}).encode()
    enough = len(content) + bytes_of_json(content) + 1_000_000  # of the 16,000,000 that the places take
    with TestClient(create_app(Settings(slots=2, max_batch_bytes=enough))) as client:
        assert_problem(ask(client, content, JSON), 413, "body-too-large")


@pytest.mark.parametrize("form", [JSON, CSV, ARROW])
def test_the_answer_is_counted_before_the_work(form: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """It holds every cell, and JSON writes a control character as six."""
    monkeypatch.setattr("app.service.chain.fitting.fit_chain", pytest.fail)
    cells = {"note": ["\x01" * 1_000] * 100, "strike": [1.0] * 100}
    table = pa.table(cells)
    content = {
        JSON: json.dumps(cells).encode(),
        CSV: b"note,strike\n" + (b"\x01" * 1_000 + b",1\n") * 100,
        ARROW: stream_of(table),
    }[form]
    counted = {JSON: bytes_of_json(content), CSV: bytes_of_csv(content), ARROW: bytes_of_table(table)}[form]
    enough = len(content) + counted + 100_000  # of the 1,200,000 that the answer takes
    with TestClient(create_app(Settings(slots=2, max_batch_bytes=enough))) as client:
        assert_problem(ask(client, content, form), 413, "body-too-large")
        assert client.app.state.memory.held == 0  # type: ignore[attr-defined]


def test_a_chain_in_arrow_has_plain_columns(client: TestClient) -> None:
    body = stream_of(pa.table({"strike": [1.0], "note": [{"a": 1}]}))
    problem = assert_problem(ask(client, body, ARROW), 422, "invalid-input")
    assert problem["detail"].endswith("must be a column of numbers, text or dates")


def test_a_chain_that_finds_no_place_is_refused_before_its_body_is_read(
    client: TestClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    read = []
    monkeypatch.setattr("app.service.routes.chain.IncomingBody", lambda *told: read.append(told))
    for _ in range(Settings().client_queue):
        client.app.state.expensive_lane.enter("testclient")  # type: ignore[attr-defined]
    assert_problem(ask(client, b"strike", CSV), 429, "client-limit")
    assert not read


def test_dividends_of_a_query_are_few(client: TestClient) -> None:
    some = "%7B%22ex_date%22:%222026-01-01%22%7D"
    query = f"{QUERY}&cash_dividends=[{','.join([some] * (MOST_DIVIDENDS + 1))}]"
    problem = assert_problem(ask(client, b"strike", CSV, query), 422, "invalid-input")
    assert f"at most {MOST_DIVIDENDS}" in problem["detail"]
