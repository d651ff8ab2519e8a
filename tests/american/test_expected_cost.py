import numpy as np

from pricing_core.american import CashDividend, Market, Option, PiecewiseConstant, price
from pricing_core.american.book.book import Book
from pricing_core.american.expected_cost import expected_seconds, first_engine
from pricing_core.american.price_together import price_together
from tests.problems.needs_kernel import needs_kernel

YEAR = Option("put", 100.0, 1.0)


def random_contracts(count):
    rng = np.random.default_rng(11)
    contracts = []
    for _ in range(count):
        times = np.sort(rng.uniform(0.05, 0.9, int(rng.integers(0, 3)))).tolist()
        market = Market(
            rng.uniform(60.0, 150.0),
            rng.uniform(-0.02, 0.1),
            rng.uniform(0.05, 0.6),
            rng.uniform(-0.03, 0.1),
            cash_dividends=[CashDividend(time, 1.0) for time in times],
        )
        contracts.append((Option(str(rng.choice(["put", "call"])), 100.0, 1.0), market))
    return contracts


@needs_kernel
def test_what_is_priced_together_is_priced_as_alone_or_left_to_the_march():
    contracts = random_contracts(60)
    together = price_together(contracts, Book.of(contracts), [1e-5] * 60, "standard")
    assert sum(found is not None for found in together) > 50
    for (option, market), found in zip(contracts, together, strict=True):
        alone = price(option, market, tolerance=1e-5)
        if found is None:
            assert alone.method == "obstacle-march"
        else:
            assert (found.price, found.vega, found.status) == (alone.price, alone.vega, "ok")


@needs_kernel
def test_an_interrupt_leaves_nothing_half_done():
    contracts = random_contracts(5)
    found = price_together(contracts, Book.of(contracts), [1e-8] * 5, "standard", lambda: True)
    assert found == [None] * 5


@needs_kernel
def test_the_expected_cost_grows_with_what_makes_a_price_expensive():
    dividends = [CashDividend(k / 51, 0.1) for k in range(1, 51)]
    flat, many = Market(100.0, 0.05, 0.2), Market(100.0, 0.05, 0.2, cash_dividends=dividends)
    certain_first = Market(100.0, 0.05, PiecewiseConstant([0.5, 1.0], [0.0, 0.2]))
    books = [Book.of([(YEAR, market)]) for market in (flat, many, certain_first)]
    engines = ["premium march", "compiled march", "hardly diffusing"]
    assert [first_engine(book) for book in books] == engines
    costs = [expected_seconds(book, 1e-6, "standard") for book in books]
    assert costs == sorted(costs)
    assert costs[0] < 2e-3 < costs[1]
    assert expected_seconds(books[0], 1e-8, "extended") > 2.0 * costs[0]
