import inspect

import pytest

from app.cli import serve_command
from app.settings import PREFIX, Settings, settings_from_environment
from pricing_core.errors import InvalidInputError


def test_settings_come_from_the_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PRICING_SLOTS", "3")
    monkeypatch.setenv("PRICING_DEADLINE_SECONDS", "2.5")
    settings = settings_from_environment()
    assert (settings.slots, settings.deadline_seconds) == (3, 2.5)


@pytest.mark.parametrize(
    ("name", "value", "allowed"),
    [
        ("SLOTS", "0", "greater than or equal to 1"),
        ("SLOTS", "", "a valid integer"),
        ("QUEUE", "many", "a valid integer"),
        ("DEADLINE_SECONDS", "nan", "a finite number"),
        ("LOG_LEVEL", "LOUD", "'DEBUG', 'INFO', 'WARNING' or 'ERROR'"),
        ("HOST", "256.0.0.1", "an address of this machine, or a name for one"),
        ("HOST", "", "an address of this machine, or a name for one"),
        ("PORT", "70000", "less than or equal to 65535"),
        ("PORT", "http://10.0.0.1:80", "a valid integer"),
        ("WORKERS", "0", "greater than or equal to 1"),
    ],
)
def test_a_setting_out_of_range_is_refused_by_variable_value_and_what_is_allowed(
    monkeypatch: pytest.MonkeyPatch, name: str, value: str, allowed: str
) -> None:
    monkeypatch.setenv(f"PRICING_{name}", value)
    with pytest.raises(InvalidInputError) as caught:
        settings_from_environment()
    assert str(caught.value) == f"PRICING_{name} = {value!r}: must be {allowed}"


def test_a_variable_that_is_no_setting_is_refused_without_its_value(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PRICING_ZZZ", "3-secret")
    with pytest.raises(InvalidInputError, match="PRICING_ZZZ") as caught:
        settings_from_environment()
    assert all(f"PRICING_{name.upper()}" in str(caught.value) for name in Settings.model_fields)
    assert "secret" not in str(caught.value)


@pytest.mark.parametrize(
    ("name", "told"),
    [
        ("SLOT", "did you mean PRICING_SLOTS?"),
        ("WORKER_COUNT", "did you mean PRICING_WORKERS?"),
        ("ports", "did you mean PRICING_PORT?"),
        ("ZZZ", "choose from PRICING_API_KEYS_FILE, "),
    ],
)
def test_of_the_names_that_are_known_the_one_most_like_it_comes_first(
    monkeypatch: pytest.MonkeyPatch, name: str, told: str
) -> None:
    monkeypatch.setenv(f"PRICING_{name}", "1")
    with pytest.raises(InvalidInputError) as caught:
        settings_from_environment()
    assert f"there is no environment variable 'PRICING_{name}': {told}" in str(caught.value)


def test_the_variables_kubernetes_sets_for_a_service_called_pricing_are_not_settings(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    for name in ("PRICING_PORT", "PRICING_PORT_8000_TCP", "PRICING_SERVICE_HOST"):
        monkeypatch.setenv(name, "tcp://10.0.0.1:8000")
    assert settings_from_environment() == Settings()
    assert settings_from_environment().port == 8000


def test_the_variables_of_the_installation_and_of_the_benchmarks_are_not_settings(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    for name in ("PRICING_CORE_KERNEL", "PRICING_SICONOS_PYTHON", "PRICING_NOSNOC_PYTHON"):
        monkeypatch.setenv(name, "none")
    assert settings_from_environment() == Settings()


def test_an_option_wins_over_its_variable_and_is_refused_by_its_own_name(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("PRICING_PORT", "8001")
    monkeypatch.setenv("PRICING_WORKERS", "none")
    settings = settings_from_environment(host=None, port=8002, workers=3)
    assert (settings.host, settings.port, settings.workers) == ("127.0.0.1", 8002, 3)
    with pytest.raises(InvalidInputError, match=r"^--workers = 65: must be less than or equal to 64$"):
        settings_from_environment(workers=65)


def test_every_option_of_pricing_serve_names_its_variable_and_the_default_of_both() -> None:
    for name, parameter in inspect.signature(serve_command).parameters.items():
        (option,) = parameter.annotation.__metadata__
        told = f"default: {PREFIX}{name.upper()}, or {Settings.model_fields[name].default}"
        assert option.help.endswith(told)
        assert parameter.default is None
