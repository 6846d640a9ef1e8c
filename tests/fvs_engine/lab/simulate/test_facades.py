"""Courtyards that look alike where they should, and only there."""

import numpy as np
import pytest
from numpy.typing import NDArray

from fvs_engine.choices import LookAlike
from fvs_engine.errors import InvalidInputError
from fvs_engine.geometry import DistortedCamera, RigidTransform, look_at
from fvs_engine.lab.simulate import SimulatedCamera, look_around, lookalike_courtyard
from fvs_engine.lab.simulate.tracing import PackedWorld

CAMERA = SimulatedCamera(
    DistortedCamera("SIMPLE_RADIAL", 96, 72, (60.0, 48.0, 36.0, 0.0)),
    vignetting=0.0,
    full_well=None,
    read_noise=0.0,
)
WALL, GROUND = slice(20, 50), slice(66, 72)
"""Rows in which a level camera 3 m from a wall, 1.3 m above the ground, sees it, and the ground before it."""


def seen(alike: LookAlike, turned_deg: float, along_m: float = 0.0) -> NDArray[np.int64]:
    """What a camera 1 m from the middle sees of the wall at −y, turned about the middle."""
    c, s = np.cos(np.radians(turned_deg)), np.sin(np.radians(turned_deg))
    turn = RigidTransform(np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]), np.zeros(3))
    pose = look_at([along_m, -1.0, 1.3], [along_m, -2.0, 1.3], [0.0, 0.0, 1.0])
    return CAMERA.photograph(PackedWorld(lookalike_courtyard(alike)), turn @ pose, 0).astype(int)


def differ(first: NDArray[np.int64], second: NDArray[np.int64], rows: slice) -> float:
    """The mean difference of two photographs in some rows."""
    return float(np.abs(first[rows] - second[rows]).mean())


@pytest.mark.parametrize(("alike", "same_deg"), [("four", {90.0, 180.0, 270.0}), ("two", {180.0})])
def test_turned_about_the_middle_the_walls_look_the_same_and_the_ground_does_not(
    alike: LookAlike, same_deg: set[float]
) -> None:
    first = seen(alike, 0.0)
    for turned_deg in (90.0, 180.0, 270.0):
        other = seen(alike, turned_deg)
        assert (differ(first, other, WALL) < 1) == (turned_deg in same_deg)
        assert differ(first, other, GROUND) > 10


def test_windows_repeat_along_a_wall_and_the_plaster_between_them_does_not() -> None:
    first, other = seen("windows", 0.0, -0.8), seen("windows", 0.0, 0.8)
    same = np.abs(first - other).max(axis=(0, 2)) < 3
    assert not same.all()
    window = first[WALL].std(axis=(0, 2)) > first[WALL].std()
    assert 0.1 < window.mean() < 0.9
    assert differ(first[:, window], other[:, window], slice(30, 40)) < 3
    assert differ(first[:, ~window], other[:, ~window], slice(30, 40)) > 3


def test_a_look_around_stays_at_its_radius_and_looks_outwards() -> None:
    poses = look_around(8, radius_m=1.5)
    centres = np.array([pose.translation for pose in poses])
    assert np.allclose(np.hypot(*centres[:, :2].T), 1.5)
    assert len({round(z, 3) for z in centres[:, 2]}) > 1
    for pose in poses:
        assert np.allclose(pose.rotation[:, 2] * 1.5, [*pose.translation[:2], 0.0])
    with pytest.raises(InvalidInputError):
        look_around(0)
