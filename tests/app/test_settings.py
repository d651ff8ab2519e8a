import pytest

from app.settings import Settings, settings_from_environment
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
    monkeypatch.setenv("PRICING_SLOT", "3-secret")
    with pytest.raises(InvalidInputError, match="PRICING_SLOT") as caught:
        settings_from_environment()
    assert all(f"PRICING_{name.upper()}" in str(caught.value) for name in Settings.model_fields)
    assert "secret" not in str(caught.value)


def test_the_variables_kubernetes_sets_for_a_service_called_pricing_are_not_settings(monkeypatch):
    for name in ("PRICING_PORT", "PRICING_PORT_8000_TCP", "PRICING_SERVICE_HOST"):
        monkeypatch.setenv(name, "tcp://10.0.0.1:8000")
    assert settings_from_environment() == Settings()
