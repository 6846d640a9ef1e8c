import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fvs_engine.geometry import RigidTransform, SimilarityTransform, angle_between
from fvs_engine.geometry.alignment.world import georeference

WORLD_FROM_MODEL = SimilarityTransform(
    3.0, Rotation.from_euler("xyz", [20, -30, 70], degrees=True).as_matrix(), np.array([10.0, -5.0, 2.0])
)


def _cameras(centres: np.ndarray) -> list[RigidTransform]:
    turns = Rotation.random(len(centres), random_state=np.random.default_rng(1)).as_matrix()
    return [RigidTransform(turn, centre) for turn, centre in zip(turns, centres, strict=True)]


def test_cameras_land_where_they_were_despite_wrong_positions() -> None:
    centres = np.random.default_rng(0).normal(size=(20, 3))
    positions = WORLD_FROM_MODEL.apply(centres)
    positions[::4] += 50.0
    found = georeference(_cameras(centres), positions)
    assert found is not None
    assert (found.inliers, found.ill_conditioned) == (15, False)
    assert found.rms == pytest.approx(0.0, abs=1e-9)
    np.testing.assert_allclose(
        found.world_from_model.apply(centres), WORLD_FROM_MODEL.apply(centres), atol=1e-8
    )


def _line() -> np.ndarray:
    return np.linspace(-2.0, 2.0, 9)[:, None] * np.array([1.0, 0.5, -0.2])


def test_cameras_on_a_line_are_ill_conditioned() -> None:
    found = georeference(_cameras(_line()), WORLD_FROM_MODEL.apply(_line()))
    assert found is not None
    assert found.ill_conditioned


@pytest.mark.parametrize("noise_deg", [0.0, 2.0])
def test_attitudes_fix_the_turn_about_the_line(noise_deg: float) -> None:
    cameras = _cameras(_line())
    noise = np.random.default_rng(3).normal(size=(9, 3)) * np.deg2rad(noise_deg)
    attitudes = [
        Rotation.from_rotvec(off).as_matrix() @ WORLD_FROM_MODEL.move_camera(camera).rotation
        for camera, off in zip(cameras, noise, strict=True)
    ]
    found = georeference(cameras, WORLD_FROM_MODEL.apply(_line()), [None, None, *attitudes[2:]])
    assert found is not None
    assert not found.ill_conditioned
    off_deg = np.rad2deg(angle_between(found.world_from_model.rotation, WORLD_FROM_MODEL.rotation))
    assert off_deg < max(1e-5, noise_deg)
    np.testing.assert_allclose(
        found.world_from_model.apply(_line()), WORLD_FROM_MODEL.apply(_line()), atol=1e-8
    )


def test_attitudes_that_contradict_each_other_fix_nothing() -> None:
    cameras = _cameras(_line())
    attitudes = list(Rotation.random(9, random_state=np.random.default_rng(8)).as_matrix())
    found = georeference(cameras, WORLD_FROM_MODEL.apply(_line()), attitudes)
    assert found is not None
    assert found.ill_conditioned


def test_too_few_or_coinciding_positions_place_nothing() -> None:
    centres = np.random.default_rng(0).normal(size=(5, 3))
    assert georeference(_cameras(centres[:2]), centres[:2]) is None
    assert georeference(_cameras(centres), np.ones((5, 3))) is None
