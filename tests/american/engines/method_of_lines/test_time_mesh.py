import pytest

from pricing_core.american.engines.method_of_lines.time_mesh import square_root_mesh, uniform_mesh


def test_time_meshes():
    assert square_root_mesh(2.0, 4) == pytest.approx([0.0, 0.125, 0.5, 1.125, 2.0])
    assert uniform_mesh(2.0, 4) == pytest.approx([0.0, 0.5, 1.0, 1.5, 2.0])
