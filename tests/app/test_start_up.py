"""`pricing` with standard streams that are closed, and with signals that arrive before there is any work."""

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from tests.problems.nightly import nightly, nightly_rows

BOOK = Path(__file__).parents[2] / "examples" / "book.csv"
TERMS = [
    "--option-type",
    "put",
    "--spot",
    "100",
    "--strike",
    "100",
    "--expiry",
    "1",
    "--rate",
    "0.05",
    "--volatility",
    "0.2",
]
PRICE = ("price", *TERMS)
CLOSED_OUTPUT = "pricing: standard output: it is closed\n"
# Python imports this module first. The process sends itself a signal when it comes to import the module that the
# environment names; it hears Ctrl-C and a terminal that closes, also where the tests run in the background.
SENDER = """
import os, signal, sys
if "STAY_IGNORED" not in os.environ:
    signal.signal(signal.SIGINT, signal.default_int_handler)
    signal.signal(signal.SIGHUP, signal.SIG_DFL)
class Sender:
    def find_spec(self, name, path=None, target=None):
        if name == os.environ["SEND_AT"]:
            sys.meta_path.remove(self)
            os.kill(os.getpid(), int(os.environ["SEND"]))
sys.meta_path.insert(0, Sender())
"""


def ended(
    *arguments: object, closed: str = "", environment: dict[str, str] | None = None
) -> subprocess.CompletedProcess[str]:
    """Run `pricing` with some streams closed, as a shell closes them: "0<&-"."""
    return subprocess.run(
        ["sh", "-c", f'exec "$@" {closed}', "sh", sys.executable, "-m", "app", *map(str, arguments)],
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
        env=os.environ | (environment or {}),
    )


@pytest.mark.parametrize(
    "arguments",
    [
        PRICE,
        ("boundary", *PRICE[1:], "--json"),
        ("simulate", "--schema"),
        ("key", "somebody"),
        ("--help",),
        *nightly(
            [
                (*PRICE, "--json"),
                ("advice", *PRICE[1:]),
                ("implied-volatility", *PRICE[1:-2], "--option-price", "6.09"),
                ("--version",),
                ("serve", "--help"),
            ]
        ),
    ],
    ids=lambda arguments: " ".join((arguments[0], arguments[-1])),
)
def test_an_answer_that_has_no_place_to_go_is_status_2_and_one_line(arguments: tuple[str, ...]) -> None:
    found = ended(*arguments, closed="1>&-")
    assert (found.returncode, found.stderr) == (2, CLOSED_OUTPUT)


@pytest.mark.parametrize("command", ["batch", "scenarios", "explain"])
def test_a_table_that_has_no_place_to_go_is_told_before_there_is_any_work(command: str) -> None:
    inputs = (BOOK, BOOK) if command == "explain" else (BOOK,)
    shifts = ("--spot-shifts", "0.1") if command == "scenarios" else ()
    found = ended(command, *inputs, "-", "--output-format", "csv", *shifts, closed="1>&-")
    assert (found.returncode, found.stderr) == (2, CLOSED_OUTPUT)


@pytest.mark.parametrize("command", ["batch", "scenarios"])
def test_a_table_from_an_input_that_is_closed_is_status_2_and_one_line(tmp_path: Path, command: str) -> None:
    shifts = ("--spot-shifts", "0.1") if command == "scenarios" else ()
    found = ended(command, "-", tmp_path / "out.csv", "--input-format", "csv", *shifts, closed="0<&-")
    assert (found.returncode, found.stderr) == (2, "pricing: standard input: it is closed\n")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("closed", ["0<&- 1>&- 2>&-", *nightly(["0<&-", "1>&-", "2>&-"])])
def test_a_batch_between_files_needs_no_stream(tmp_path: Path, closed: str) -> None:
    found = ended("batch", BOOK, tmp_path / "out.csv", "--tolerance", "1e-3", closed=closed)
    assert (found.returncode, found.stderr) == (0, "")
    assert (tmp_path / "out.csv").read_text().count("\n") == BOOK.read_text().count("\n")


def test_an_error_that_nobody_can_be_told_is_not_printed_among_the_results() -> None:
    found = ended(*PRICE, "--tolerance", "1", closed="2>&-")
    assert (found.returncode, found.stdout, found.stderr) == (2, "", "")


@pytest.fixture
def sender(tmp_path: Path) -> dict[str, str]:
    """The environment in which a process sends itself a signal."""
    folder = tmp_path / "sender"
    folder.mkdir()
    (folder / "sitecustomize.py").write_text(SENDER)
    return {"PYTHONPATH": os.pathsep.join([str(folder), *filter(None, sys.path)])}


@pytest.mark.parametrize(
    ("where", "how"),
    [
        ("app.cli", signal.SIGINT),
        ("app.cli", signal.SIGHUP),
        ("app.commands.batch_command", signal.SIGTERM),
        *nightly_rows([("app.cli", signal.SIGTERM)]),
        *nightly_rows([("app.commands.batch_command", how) for how in (signal.SIGINT, signal.SIGHUP)]),
    ],
)
def test_a_signal_at_the_start_of_a_batch_is_status_130_and_one_line(
    tmp_path: Path, sender: dict[str, str], where: str, how: signal.Signals
) -> None:
    sending = sender | {"SEND_AT": where, "SEND": str(int(how))}
    found = ended("batch", BOOK, tmp_path / "out.csv", environment=sending)
    told = "pricing: interrupted; nothing was written\n"
    assert (found.returncode, found.stdout, found.stderr) == (130, "", told)
    assert not (tmp_path / "out.csv").exists()


def test_a_log_of_json_has_the_signal_as_a_line_of_json(tmp_path: Path, sender: dict[str, str]) -> None:
    sending = sender | {"SEND_AT": "pyarrow", "SEND": str(int(signal.SIGTERM))}
    found = ended("batch", BOOK, tmp_path / "out.csv", "--log-json", environment=sending)
    assert found.returncode == 130
    assert json.loads(found.stderr) == {"event": "error", "message": "interrupted; nothing was written"}


@pytest.mark.parametrize("how", [signal.SIGTERM, signal.SIGHUP])
def test_a_signal_to_a_single_price_is_status_130_and_one_line(
    sender: dict[str, str], how: signal.Signals
) -> None:
    sending = sender | {"SEND_AT": "app.commands.tables", "SEND": str(int(how))}
    found = ended(*PRICE, environment=sending)
    assert (found.returncode, found.stdout) == (130, "")
    assert found.stderr == "pricing: interrupted; nothing was written\n"


@pytest.mark.parametrize(
    ("where", "how"),
    [
        ("app.cli", signal.SIGINT),
        ("app.service.server", signal.SIGTERM),
        ("app.service.routes.price", signal.SIGINT),
        *nightly_rows([("app.service.server", signal.SIGINT)]),
        *nightly_rows([(where, signal.SIGTERM) for where in ("app.cli", "app.service.routes.price")]),
    ],
)
def test_a_server_that_is_told_to_end_while_it_starts_ends_with_status_0(
    sender: dict[str, str], where: str, how: signal.Signals
) -> None:
    sending = sender | {"SEND_AT": where, "SEND": str(int(how))}
    found = ended("serve", "--port", "0", environment=sending)
    assert (found.returncode, found.stdout, found.stderr) == (0, "", "")


def test_signals_that_are_ignored_stay_so(tmp_path: Path, sender: dict[str, str]) -> None:
    sending = sender | {"SEND_AT": "app.cli", "SEND": str(int(signal.SIGHUP)), "STAY_IGNORED": "yes"}
    ignoring = ["sh", "-c", 'trap "" HUP; exec "$@"', "sh", sys.executable, "-m", "app", *PRICE]
    found = subprocess.run(
        ignoring, capture_output=True, text=True, timeout=120, check=False, env=os.environ | sending
    )
    assert (found.returncode, found.stderr) == (0, "")
