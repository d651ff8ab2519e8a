"""Problems in the files of others: read, solved as those who made them solve them, and written."""

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.sparse import csr_array

from pricing_core.errors import InfeasibleError, InvalidInputError
from pricing_core.lcp import (
    LCP,
    MixedLCP,
    enumerate_solutions,
    read_problem,
    scaled_residual,
    solve,
    write_problem,
)
from pricing_core.lcp.siconos_files import read_siconos_lcp, read_siconos_mlcp, read_siconos_relay
from pricing_core.linalg import Tridiagonal

DATA = Path(__file__).parents[1] / "data" / "siconos"
EXPECTED = json.loads((DATA / "expected.json").read_text())


@pytest.mark.parametrize("name", EXPECTED)
def test_the_test_problems_of_siconos_have_the_answers_that_are_expected(name):
    expected = EXPECTED[name]
    problem = read_problem(DATA / name, expected["format"])
    if expected["answer"] == "none":
        with pytest.raises(InfeasibleError):
            solve(problem)
        return
    found = solve(problem)
    assert scaled_residual(problem, found.z) <= 1e-12
    if expected["answer"] == "one" and expected["z"] is not None:
        np.testing.assert_allclose(found.z, expected["z"], rtol=1e-8, atol=1e-8 * np.abs(found.z).max())


@pytest.mark.parametrize("name", [name for name in EXPECTED if name.startswith("lcp")])
def test_enumeration_counts_as_many_solutions_as_are_expected(name):
    problem = read_problem(DATA / name, "siconos-lcp")
    if problem.size > 9:
        pytest.skip("too many complementary cones")
    found = enumerate_solutions(problem)
    words = {0: "none", 1: "one"}
    count = len(found.isolated) + 2 * len(found.faces)
    assert words.get(count, "several") == EXPECTED[name]["answer"]


def test_blocks_and_the_whole_matrix_are_the_same_problem():
    for name in ("deudeu", "ortiz", "trivial"):
        blocks, whole = (read_problem(DATA / f"lcp_{name}{end}.dat", "siconos-lcp") for end in ("_block", ""))
        np.testing.assert_array_equal(blocks.dense(), whole.dense())
        np.testing.assert_array_equal(blocks.q, whole.q)


def test_blocks_stand_where_their_own_numbers_say():
    # Two rows of one block each, [[1, 0], [0, 2]]: the second block comes first in the file.
    text = "2 1 2 2  2  2 2  1 2  1 2  3 2  0 1 2  0 1  1  2.0  0  1.0  -1 -1"
    np.testing.assert_array_equal(read_siconos_lcp(text, "a.dat").dense(), [[1.0, 0.0], [0.0, 2.0]])
    # A full block of two rows and one column beside one of two by one, column by column.
    text = "3 1 3 3  4  2 2  2 3  2 3  3 4  0 2 4  0 1 0 1  0  1 2 3 4  1  5 6  2  7 8  3  9  0 0 0"
    M = [[1.0, 3.0, 5.0], [2.0, 4.0, 6.0], [7.0, 8.0, 9.0]]
    np.testing.assert_array_equal(read_siconos_lcp(text, "a.dat").dense(), M)


def test_four_matrices_are_read_by_rows_where_the_whole_one_is_missing():
    # u + 2 v_1 - 1 = 0, w = (v_1 + 4/3 v_2 + 1, v_2 - 3): the problem m2n1 of the data.
    text = "0 1 1 2  1   1 1.3333 0 1   2 0   0 0   -1   1 -3"
    found = read_siconos_mlcp(text, "a.dat")
    expected = read_problem(DATA / "m2n1_mlcp.dat", "siconos-mlcp")
    np.testing.assert_array_equal(found.dense(), expected.dense())
    np.testing.assert_array_equal(found.q, expected.q)
    assert found.lower.tolist() == [-np.inf, 0.0, 0.0]


def test_a_step_of_relays_with_the_unit_matrix_is_a_projection():
    for name in ("step_1x1", "step_2x2", "step_4x4"):
        problem = read_problem(DATA / f"{name}.dat", "siconos-relay")
        np.testing.assert_array_equal(solve(problem).z, np.clip(-problem.q, problem.lower, problem.upper))


@pytest.mark.parametrize("end", ["", "-again"])
@pytest.mark.parametrize(
    ("problem", "format_"),
    [
        (LCP([[1 / 3, 2.0], [-1e-300, 4.0]], [0.1, -7e22]), "siconos-lcp"),
        (
            MixedLCP(np.arange(9.0).reshape(3, 3), [1 / 3, 2, 3], [0.0, -np.inf, 0.0], np.inf),
            "siconos-mlcp",
        ),
        (MixedLCP(np.arange(9.0).reshape(3, 3), [1 / 3, 2, 3], -np.inf, np.inf), "siconos-mlcp"),
        (MixedLCP([[0.1, 2.0], [3.0, 4.0]], [1.0, 2.0], [-1.0, 0.1], [np.inf, 0.7]), "siconos-relay"),
        (LCP([[1 / 3, 2.0], [-1e-300, 4.0]], [0.1, -7e22]), "matrix-market"),
        (LCP(csr_array([[1 / 3, 0.0], [0.0, 4.0]]), [0.1, -7e22]), "matrix-market"),
        (LCP(Tridiagonal([-1.0], [2.0, 1 / 3], [-1.0]), [0.1, 0.0]), "matrix-market"),
        (
            MixedLCP(csr_array([[0.1, 2.0], [2.0, 4.0]]), [1.0, 2.0], [-np.inf, 0.1], [np.inf, 0.7]),
            "matrix-market",
        ),
    ],
)
def test_what_is_written_is_read_without_loss(tmp_path, problem, format_, end):
    path = tmp_path / f"problem{end}.mtx"
    write_problem(problem, path, format_)
    write_problem(problem, path, format_)  # what is there is replaced
    found = read_problem(path, format_)
    assert isinstance(found.M, csr_array) == (
        format_ == "matrix-market" and not isinstance(problem.M, np.ndarray)
    )
    np.testing.assert_array_equal(found.dense(), problem.dense())
    for name in ("q", "lower", "upper"):
        np.testing.assert_array_equal(getattr(found, name), getattr(problem, name))
    assert isinstance(found, type(problem))


@pytest.mark.parametrize(
    ("reader", "text", "message"),
    [
        (read_siconos_lcp, "", "ends after 0"),
        (read_siconos_lcp, "2 0 2 2 2 2 1 2 3 4 5", "2 numbers for q: it ends after 1"),
        (read_siconos_lcp, "2 0 2 2 2 2 1 x 3 4 5 6", "numbers alone for M"),
        (read_siconos_lcp, "2 0 2 3 2 3", "square M of order 2: it is 2 by 3"),
        (read_siconos_lcp, "2 7 2 2", "its storage is 7"),
        (read_siconos_lcp, "2.5 0", "whole number"),
        (read_siconos_lcp, "-1 0", "whole number"),
        (read_siconos_lcp, "1 0 1 1 1 2", "one size of M"),
        (read_siconos_lcp, "1 1 1 1 1 1 1 1 1 2 1 0 1 0 5 1.0 1.0", "each block once"),
        (read_siconos_lcp, "1 1 1 1 1 1 1 9 1 2 1 0 1 0 0 1.0 1.0", "blocks that fill"),
        (read_siconos_relay, "1 0 1 1 1 1 2 3 0", "upper bounds"),
        (read_siconos_mlcp, "0 0 1 1", "no matrix"),
        (read_siconos_mlcp, "1 0 2 0 0 1 2 0 1 0 2 2 2 2 1 0 0 1 1 1", "2 equations: it marks 1"),
    ],
)
def test_a_file_that_is_something_else_is_refused_with_the_place(reader, text, message):
    with pytest.raises(InvalidInputError, match=message) as caught:
        reader(text, "a.dat")
    assert caught.value.field == "path"


def test_a_rectangular_problem_and_formats_that_do_not_fit_are_refused(tmp_path):
    with pytest.raises(InvalidInputError, match="3 by 2"):
        read_problem(DATA / "Rectangular_mlcp.dat", "siconos-mlcp")
    with pytest.raises(InvalidInputError, match="format"):
        read_problem(tmp_path, "csv")  # type: ignore[arg-type]
    box = MixedLCP([[1.0]], [1.0], 0.0, 1.0)
    for format_ in ("siconos-lcp", "siconos-mlcp"):
        with pytest.raises(InvalidInputError, match="problem"):
            write_problem(box, tmp_path / "a.dat", format_)
    (tmp_path / "a.mtx").write_text("no matrix\n")
    with pytest.raises(InvalidInputError, match="MatrixMarket"):
        read_problem(tmp_path / "a.mtx", "matrix-market")
    with pytest.raises(OSError, match="absent"):
        read_problem(tmp_path / "absent.dat", "siconos-lcp")
