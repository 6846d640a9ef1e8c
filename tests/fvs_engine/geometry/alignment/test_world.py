from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fvs_engine.geometry import RigidTransform, SimilarityTransform, angle_between
from fvs_engine.geometry.alignment.attitudes import Attitude
from fvs_engine.geometry.alignment.world import georeference
from fvs_engine.geometry.geodetic import camera_at

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


def test_positions_that_most_cameras_contradict_align_nothing() -> None:
    """As (north, east, up) for (east, north, up), or positions of other photographs."""
    angles = np.linspace(0.0, 4.0 * np.pi, 16)
    centres = np.stack([np.cos(angles), np.sin(angles), 0.2 * angles], axis=1)  # has no mirror image
    positions = 40.0 * centres + np.random.default_rng(0).normal(size=(16, 3))
    sigmas = np.full(16, 2.0)
    aligned = georeference(_cameras(centres), positions, None, sigmas)
    assert aligned is not None
    assert aligned.inliers >= 14
    assert georeference(_cameras(centres), positions[:, [1, 0, 2]], None, sigmas) is None
    shuffled = np.random.default_rng(1).permutation(positions)
    assert georeference(_cameras(centres), shuffled, None, sigmas) is None


def _attitude(world_from_camera: np.ndarray) -> Attitude:
    x, _, z = world_from_camera.T
    yaw, pitch = np.arctan2(z[0], z[1]), np.arcsin(z[2])
    level = camera_at(np.zeros(3), float(np.rad2deg(yaw)), float(np.rad2deg(pitch))).rotation
    roll = np.arctan2(level[:, 1] @ x, level[:, 0] @ x)
    return Attitude(*np.rad2deg([yaw, pitch, roll]).tolist())


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
        _attitude(Rotation.from_rotvec(off).as_matrix() @ WORLD_FROM_MODEL.move_camera(camera).rotation)
        for camera, off in zip(cameras, noise, strict=True)
    ]
    found = georeference(cameras, WORLD_FROM_MODEL.apply(_line()), [None, None, *attitudes[2:]])
    assert found is not None
    assert not found.ill_conditioned
    off_deg = np.rad2deg(angle_between(found.world_from_model.rotation, WORLD_FROM_MODEL.rotation))
    assert off_deg < max(1e-5, noise_deg)
    np.testing.assert_allclose(
        found.world_from_model.apply(_line()), WORLD_FROM_MODEL.apply(_line()), atol=1e-6 + 0.02 * noise_deg
    )


def test_attitudes_that_contradict_each_other_fix_nothing() -> None:
    cameras = _cameras(_line())
    attitudes = list(map(_attitude, Rotation.random(9, random_state=np.random.default_rng(8)).as_matrix()))
    found = georeference(cameras, WORLD_FROM_MODEL.apply(_line()), attitudes)
    assert found is not None
    assert found.ill_conditioned


def test_too_few_or_coinciding_positions_place_nothing() -> None:
    centres = np.random.default_rng(0).normal(size=(5, 3))
    assert georeference(_cameras(centres[:2]), centres[:2]) is None
    assert georeference(_cameras(centres), np.ones((5, 3))) is None


Row = tuple[list[RigidTransform], np.ndarray, list[Attitude]]


def _row(
    seed: int,
    *,
    heading_deg: float = 30.0,
    yaw_deg: float = -40.0,
    pitch_deg: float = -35.0,
    noise: float = 1.0,
) -> Row:
    """Ten photographs in a row, 10 m apart, with the errors of a drone's receiver and gimbal.

    GPS: 1.5 m level and 3 m in height. Gimbal: 0.5° of pitch and roll and 4° of yaw that all share, and 0.3°
    and 1° that each has. The flight deviates from the line by 0.3 m, and the camera from its attitude by 1°.
    """
    chance = np.random.default_rng(seed)
    along = np.array([np.sin(np.deg2rad(heading_deg)), np.cos(np.deg2rad(heading_deg)), 0.0])
    yaw_bias, tilt_bias = noise * 4.0 * chance.normal(), noise * 0.5 * chance.normal(size=2)
    cameras, positions, attitudes = [], [], []
    for number in range(10):
        centre = 10.0 * number * along + [0.0, 0.0, 60.0] + 0.3 * chance.normal(size=3)
        yaw, pitch, roll = np.array([yaw_deg, pitch_deg, 0.0]) + chance.normal(size=3) * [1.0, 1.0, 0.3]
        camera = camera_at(centre, yaw, pitch, roll)
        cameras.append(WORLD_FROM_MODEL.inverse().move_camera(camera))
        positions.append(centre + noise * chance.normal(size=3) * [1.5, 1.5, 3.0])
        yaw_noise, pitch_noise, roll_noise = noise * chance.normal(size=3) * [1.0, 0.3, 0.3]
        attitudes.append(
            Attitude(
                yaw + yaw_bias + yaw_noise,
                pitch + tilt_bias[0] + pitch_noise,
                roll + tilt_bias[1] + roll_noise,
            )
        )
    return cameras, np.array(positions), attitudes


def _off_deg(found: Any) -> float:
    return float(np.rad2deg(angle_between(found.world_from_model.rotation, WORLD_FROM_MODEL.rotation)))


def _only_gravity(attitude: Attitude, _number: int) -> Attitude:
    return Attitude(None, attitude.pitch_deg, attitude.roll_deg)


def _magnetic(attitude: Attitude, _number: int) -> Attitude:
    return Attitude((attitude.yaw_deg or 0.0) + 40.0, attitude.pitch_deg, attitude.roll_deg)


def _every_other(attitude: Attitude, number: int) -> Attitude | None:
    return attitude if number % 2 else None


def _some_wrong(attitude: Attitude, number: int) -> Attitude:
    return attitude if number % 4 else Attitude(100.0, 30.0, 5.0)


@pytest.mark.parametrize(
    "known", [lambda attitude, _number: attitude, _only_gravity, _magnetic, _every_other, _some_wrong]
)
@pytest.mark.parametrize("pitch_deg", [-35.0, -90.0])
def test_ten_photographs_in_a_row_come_out_within_three_degrees(known: Any, pitch_deg: float) -> None:
    off = []
    for seed in range(3):
        cameras, positions, attitudes = _row(seed, pitch_deg=pitch_deg)
        found = georeference(cameras, positions, list(map(known, attitudes, range(10))))
        assert found is not None
        assert not found.ill_conditioned
        off.append(_off_deg(found))
        alone = georeference(cameras, positions)
        assert alone is not None
        assert alone.ill_conditioned
    assert max(off) < 3.0
    assert np.median(off) < 2.0


def test_exact_positions_and_attitudes_of_a_row_are_met_exactly() -> None:
    found = georeference(*_row(0, noise=0.0))
    assert found is not None
    assert not found.ill_conditioned
    assert _off_deg(found) < 0.01


@pytest.mark.parametrize(
    "pitch_of", [lambda pitch: -pitch, lambda pitch: 90.0 + pitch], ids=["sign", "nadir"]
)
def test_attitudes_of_another_convention_that_the_track_contradicts_are_not_used(pitch_of: Any) -> None:
    cameras, positions, attitudes = _row(1, yaw_deg=30.0)  # looks along the track
    wrong = [Attitude(a.yaw_deg, pitch_of(a.pitch_deg), a.roll_deg) for a in attitudes]
    found = georeference(cameras, positions, wrong)
    assert found is not None
    assert found.ill_conditioned


def test_a_compass_alone_does_not_fix_cameras_that_look_aside() -> None:
    cameras, positions, attitudes = _row(2, yaw_deg=120.0)
    found = georeference(cameras, positions, [Attitude(yaw_deg=a.yaw_deg) for a in attitudes])
    assert found is not None
    assert found.ill_conditioned


def test_attitudes_do_not_change_what_the_positions_determine() -> None:
    centres = np.random.default_rng(0).normal(size=(20, 3))
    cameras, positions = _cameras(centres), WORLD_FROM_MODEL.apply(centres)
    with_attitudes = georeference(cameras, positions, [Attitude(10.0, 20.0, 30.0)] * 20)
    without = georeference(cameras, positions)
    assert with_attitudes is not None
    assert without is not None
    np.testing.assert_array_equal(with_attitudes.world_from_model.rotation, without.world_from_model.rotation)
