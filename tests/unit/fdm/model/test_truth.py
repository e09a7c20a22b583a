from math import pi, sqrt

import pytest

from fdm.model.truth import quaternion_from_euler

HALF = sqrt(0.5)


@pytest.mark.parametrize(
    ("euler", "wxyz"),
    [
        ((0, 0, 0), (1, 0, 0, 0)),
        ((pi / 2, 0, 0), (HALF, HALF, 0, 0)),
        ((0, pi / 2, 0), (HALF, 0, HALF, 0)),
        ((0, 0, pi / 2), (HALF, 0, 0, HALF)),
        ((pi / 2, 0, pi / 2), (0.5, 0.5, 0.5, 0.5)),
    ],
)
def test_quaternion_of_euler_angles(euler, wxyz):
    assert quaternion_from_euler(*euler) == pytest.approx(wxyz)
