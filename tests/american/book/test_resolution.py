import pytest

from pricing_core.american import Resolution
from pricing_core.errors import InvalidInputError


@pytest.mark.parametrize(
    ("field", "bad"),
    [
        ("intervals", 3),
        ("intervals", 10.0),
        ("intervals", 10**6),
        ("steps", 1),
        ("time_mesh", "random"),
        ("scheme", "euler"),
        ("stretching", -1.0),
        ("stretching", 11.0),
    ],
)
def test_bad_resolutions_are_refused(field, bad):
    with pytest.raises(InvalidInputError, match=field):
        Resolution(**{field: bad})


def test_refining_doubles_and_coarsening_halves_where_enough_is_left():
    resolution = Resolution(48, 20, scheme="implicit-euler", stretching=1.0)
    assert resolution.refined() == Resolution(96, 40, scheme="implicit-euler", stretching=1.0)
    assert resolution.refined().coarsened() == resolution
    assert Resolution(15, 100).coarsened() is None
    assert Resolution(100, 7).coarsened() is None
