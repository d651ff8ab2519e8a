import pytest

from benchmarks.method_of_lines.accuracy import OUTPUTS, Error
from benchmarks.method_of_lines.order_study import (
    Level,
    Refinement,
    StepCounts,
    order_row,
    refine_cells,
    refine_steps,
)
from benchmarks.problems.classic_sets import classic_problems

# What theory says of the price: Forsyth and Vetzal (2002) for the order that equal steps lose.
EXPECTED = {
    "implicit Euler, uniform steps": (0.9, 1.1),
    "implicit Euler, square-root steps": (0.9, 1.1),
    "SDIRK2, square-root steps": (1.8, 2.3),
    "Crank-Nicolson, square-root steps": (1.8, 2.3),
    "SDIRK2, uniform steps": (1.0, 1.9),
    "Crank-Nicolson, uniform steps": (1.1, 1.8),
    "Crank-Nicolson, uniform steps, explicit projection": (0.8, 1.3),
    "implicit Euler, uniform steps, explicit projection": (0.8, 1.2),
}


def made_up(order: float) -> Refinement:
    levels = tuple(
        Level(work, {output: Error(3.0 * work**-order, 0.0) for output in OUTPUTS})
        for work in (5.0, 10.0, 20.0)
    )
    return Refinement("made up", levels)


@pytest.mark.parametrize("order", [1.0, 1.5, 2.0])
def test_the_order_is_the_slope_of_log_error_against_log_work(order: float) -> None:
    assert made_up(order).order("delta") == pytest.approx(order)
    assert order_row(made_up(order)) == pytest.approx(
        ("made up", 20.0, *(cell for _ in OUTPUTS for cell in (3.0 * 20.0**-order, order)))
    )


def test_the_price_converges_in_time_with_the_orders_of_theory() -> None:
    counts = StepCounts(256, prescribed=(32, 64, 128), adaptive=(8, 12), reference=1024)
    found = {one.method: one.order("price") for one in refine_steps(classic_problems(("A", "ALO")), counts)}
    for method, (least, most) in EXPECTED.items():
        assert least < found[method] < most, method


def test_the_price_converges_in_space_with_second_order_and_errs_less_with_the_boundary_in_its_cell() -> None:
    at_node, in_cell = refine_cells(classic_problems(("A", "ALO")), (64, 128, 256), 512)
    assert 1.8 < at_node.order("price") < 2.2
    assert 1.8 < in_cell.order("price") < 2.2
    last_at_node, last_in_cell = (refinement.levels[-1].errors for refinement in (at_node, in_cell))
    assert last_in_cell["price"].rmse < last_at_node["price"].rmse
    assert last_in_cell["boundary"].rmse < 0.3 * last_at_node["boundary"].rmse
