import subprocess

import numpy as np
import pytest

from benchmarks import complementarity_classes
from benchmarks.complementarity_classes import Verdict, by_siconos, by_us, main, summary, verdict_on
from benchmarks.lcs.lcp_classes import CLASSES, Posed, members
from pricing_core.errors import InfeasibleError, NumericalError


def test_answers_and_refusals_have_verdicts() -> None:
    posed = Posed(np.eye(2), np.array([-1.0, -2.0]), True)

    def refuse(_: object) -> np.ndarray:
        raise InfeasibleError("none")

    def give_up(_: object) -> np.ndarray:
        raise NumericalError("not found")

    assert verdict_on(posed, lambda _: np.array([1.0, 2.0])).word == "solved"
    assert verdict_on(posed, lambda _: np.array([1.0, 1.0])).word == "wrong"
    assert verdict_on(posed, lambda _: np.array([-1.0, 2.0])).word == "wrong"
    assert verdict_on(posed, refuse).word == "wrong"
    assert verdict_on(posed._replace(is_solvable=None), refuse).word == "refused"
    assert verdict_on(posed, give_up).word == "not found"


def test_members_are_the_same_in_every_run_and_solved() -> None:
    for name, (_, sizes) in CLASSES.items():
        first, second = (list(members(name, sizes[0], 3)) for _ in range(2))
        for one, other in zip(first, second, strict=True):
            np.testing.assert_array_equal(one.M, other.M)
            np.testing.assert_array_equal(one.q, other.q)
        assert {verdict.word for verdict in by_us(first)} <= {"solved", "refused"}


def test_a_line_for_each_class_is_printed(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.delenv("PRICING_SICONOS_PYTHON", raising=False)
    monkeypatch.setattr("sys.argv", ["complementarity_classes", "--count", "1", "--only", "opposite"])
    main()
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 2
    assert "1 solved" in lines[1]
    assert lines[1].endswith("-")


def test_the_peer_is_asked_in_its_own_python(monkeypatch: pytest.MonkeyPatch) -> None:
    posed = [Posed(np.eye(1), np.array([-1.0]), True), Posed(-np.eye(1), np.array([-1.0]), None)]

    def answer(command: list[str], **_: object) -> None:
        np.savez(command[3], z0=np.ones(1), info0=0, seconds0=1e-3, z1=np.ones(1), info1=1, seconds1=1e-3)

    monkeypatch.setenv("PRICING_SICONOS_PYTHON", "python-of-siconos")
    monkeypatch.setattr(subprocess, "run", answer)
    assert by_siconos(posed) == [Verdict("solved", 1e-3), Verdict("not found", 1e-3)]
    assert summary(by_siconos(posed)) == "1 solved, 1 not found; 1 ms"
    assert complementarity_classes.PEER.exists()
