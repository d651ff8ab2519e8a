import pytest

from benchmarks.greeks import GREEKS, report


def test_every_greek_has_a_line(capsys: pytest.CaptureFixture[str]) -> None:
    report("premium-march", 6)
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines[3 : 3 + len(GREEKS)]] == [greek.name for greek in GREEKS]
