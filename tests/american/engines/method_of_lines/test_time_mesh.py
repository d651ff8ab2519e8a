import pytest

from pricing_core.american.engines.method_of_lines.time_mesh import graded_mesh


def test_time_meshes():
    assert graded_mesh("square-root", 2.0, 4) == pytest.approx([0.0, 0.125, 0.5, 1.125, 2.0])
    assert graded_mesh("cube-root", 2.0, 4) == pytest.approx([0.0, 0.03125, 0.25, 0.84375, 2.0])
    assert graded_mesh("uniform", 2.0, 4) == pytest.approx([0.0, 0.5, 1.0, 1.5, 2.0])
