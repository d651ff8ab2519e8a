"""The example of each model prints the numbers that are known, and draws its picture."""

import runpy
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).parents[2] / "examples"
HEADLINES = {
    "relay": ["theorem 11.6 holds: well-posed", "origin reached at t = 2.000000000000"],
    "friction": ["end at 3.141593, 6.283185, 9.424778", "sticks at q = 0.700000000000", "u = 0.700000000000"],
    # sqrt(2/g) to the floor, (1 + e)/(1 - e) times as long to rest, 1 - e^2 of the energy lost.
    "bouncing_ball": [
        "first impact at t = 0.451523640986, 5.003100000 of 9.810000000 lost",
        "at rest from t = 2.558633965586 on, each bounce 0.700000000 of",
        "bears u = 9.810000000000",
    ],
    "pendulum": [
        "first impact at t = 0.552: a quarter of the period is 0.5508",
        "swing 3 reaches 0.587: 0.5866",
    ],
    "oligopoly": [
        "30.000 and earns  1050.00",
        "25.000 and earns   625.00",
        "0.000 and earns     0.00",
        "price 45.000",
    ],
}


@pytest.mark.parametrize("name", HEADLINES)
def test_an_example_has_its_headline_and_its_picture(name, capsys, monkeypatch):
    monkeypatch.setenv("MPLBACKEND", "agg")
    picture = EXAMPLES / "out" / f"{name}.png"
    picture.unlink(missing_ok=True)
    runpy.run_path(str(EXAMPLES / f"{name}.py"), run_name="__main__")
    printed = capsys.readouterr().out
    for headline in HEADLINES[name]:
        assert headline in printed
    assert picture.read_bytes().startswith(b"\x89PNG")
