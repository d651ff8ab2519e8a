import pytest

from benchmarks.cliffs import sweep


def test_a_sweep_has_a_line_for_each_value(capsys: pytest.CaptureFixture[str]) -> None:
    sweep("rate", (0.01, 0.02), "put", 1)
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines[2:]] == ["0.01", "0.02"]
