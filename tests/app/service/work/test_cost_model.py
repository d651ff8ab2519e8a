"""What questions are expected to cost."""

from app.service.work.cost_model import seconds_of_surface
from pricing_core.american import CashDividend, Market, Option
from tests.problems.needs_kernel import needs_kernel

OPTION = Option("put", 100.0, 1.0)
FLAT = Market(100.0, 0.05, 0.2)
PAYING = Market(100.0, 0.05, 0.2, cash_dividends=[CashDividend(0.5, 2.0)])


def cost(market, times, spots):
    return seconds_of_surface(OPTION, market, 1e-5, "standard", (times, spots))


def test_a_surface_costs_by_its_times():
    assert cost(FLAT, 6, 60) == 6.0 * cost(FLAT, 1, 1)
    assert cost(PAYING, 6, 60) == 6.0 * cost(PAYING, 1, 60)


@needs_kernel
def test_spots_share_marches_of_a_contract_with_events():
    assert cost(PAYING, 1, 1) < cost(PAYING, 1, 60) == cost(PAYING, 1, 600)
    assert cost(PAYING, 1, 600) < 10.0 * cost(PAYING, 1, 1)
