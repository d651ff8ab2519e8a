import pytest
from pydantic import ValidationError

from app.settings import Settings


def test_settings_come_from_the_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PRICING_WORKERS", "3")
    monkeypatch.setenv("PRICING_DEADLINE_SECONDS", "2.5")
    settings = Settings()
    assert (settings.workers, settings.deadline_seconds) == (3, 2.5)


@pytest.mark.parametrize(("name", "value"), [("WORKERS", "0"), ("QUEUE", "many"), ("LOG_LEVEL", "LOUD")])
def test_a_setting_out_of_range_is_refused(monkeypatch: pytest.MonkeyPatch, name: str, value: str) -> None:
    monkeypatch.setenv(f"PRICING_{name}", value)
    with pytest.raises(ValidationError):
        Settings()
