from app.service.allowance import Allowance


def test_a_pause_saves_up_no_more_than_there_is_at_first() -> None:
    now = 0.0
    allowance = Allowance(rate=10.0, most=100.0, clock=lambda: now)
    now = 1e6
    assert allowance.charge(100) == 0.0
    assert allowance.charge(1) > 0.0
