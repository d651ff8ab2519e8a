import numpy as np
import pytest

from benchmarks.events import DIVIDENDS, Point, measure, metered, random_book, report, time_at_error
from benchmarks.quantlib.cash_dividends import AVAILABLE, options_with_dividends, prices
from pricing_core.american import price_many


@pytest.mark.parametrize("option_type", ["put", "call"])
def test_dividends_are_paid_in_order_within_the_life_of_each_option(option_type: str) -> None:
    book = random_book(option_type, 500)
    days = np.column_stack([np.zeros(500), book.dividends.days, book.contracts.days])
    assert np.all(np.diff(days) > 0)
    share = book.dividends.amounts / book.contracts.spot[:, None]
    assert share.shape == (500, DIVIDENDS)
    assert np.all((share >= 0.002) & (share <= 0.02))


def test_the_kernel_is_counted_where_it_is_called() -> None:
    with metered() as meter:
        price_many(random_book("call", 3).columns(), tolerance=1e-4, greeks="none")
    assert meter.solves >= 3 * 2  # the American and the European value
    assert meter.seconds > 0.0


def test_a_measurement_at_the_tolerance_of_its_reference_has_no_error() -> None:
    book = random_book("call", 3)
    exact = price_many(book.columns(), tolerance=1e-4, greeks="none")
    rate = measure(book, exact["price"], 1e-4, greeks="none", seconds=0.0)
    assert (rate.error, rate.within) == (0.0, 1.0)
    assert rate.per_second > 0.0
    assert 0.0 < rate.kernel <= 1.0


def test_the_report_has_a_line_for_each_tolerance(capsys: pytest.CaptureFixture[str]) -> None:
    report("call", rows=2, seconds=0.0)
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[:2] for line in lines[5:11]] == [
        [tolerance, greeks] for greeks in ("without", "with") for tolerance in ("1e-04", "1e-05", "1e-06")
    ]


def test_the_time_at_another_error_follows_the_power_law_of_the_points() -> None:
    points = [Point(8.0 * error**-0.5, error) for error in (1e-3, 1e-4, 1e-6)]
    assert time_at_error(points, 1e-5) == pytest.approx(8.0 * 1e-5**-0.5)


@pytest.mark.skipif(not AVAILABLE, reason="QuantLib is not installed")
@pytest.mark.parametrize("option_type", ["put", "call"])
def test_quantlib_prices_the_same_contracts(option_type: str) -> None:
    book = random_book(option_type, 10)
    ours = price_many(book.columns(), tolerance=1e-5, greeks="none")["price"]
    peers = prices(options_with_dividends(book.contracts, *book.dividends, 400, 400))
    assert peers == pytest.approx(ours, abs=2e-2)
