"""The simulated camera is held to the projection of the geometry package, which knows nothing of it."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from fvs_engine.errors import Cancelled, InvalidInputError, OutputExistsError, StorageError
from fvs_engine.geometry import DistortedCamera, PinholeCamera, RigidTransform, look_at
from fvs_engine.lab.simulate import (
    Rectangle,
    SimulatedCamera,
    World,
    courtyard,
    orbit,
    settlement,
    survey,
    write_photographs,
)
from fvs_engine.lab.simulate.tracing import PackedWorld, pixel_corner_rays
from fvs_engine.monitor import Monitor, Progress
from fvs_engine.scene.dataset import read_dataset

CAMERA = DistortedCamera("RADIAL", 160, 120, (104.0, 80.0, 60.0, -0.06, 0.008))
IDEAL = SimulatedCamera(CAMERA, vignetting=0.0, full_well=None, read_noise=0.0)
WALL = look_at([0.0, -2.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 1.0])


def wall(y: float, color: int, spot: tuple[float, float] | None = None) -> Rectangle:
    """A wall of 4 × 3 m across the y axis, with a white spot of 4 cm at (x, z)."""
    texture = np.full((300, 400, 3), color, dtype=np.uint8)
    if spot is not None:
        column, row = round((spot[0] + 2.0) * 100), round((spot[1] + 1.5) * 100)
        texture[row - 2 : row + 2, column - 2 : column + 2] = 255
    return Rectangle(np.array([-2.0, y, -1.5]), np.array([4.0, 0, 0]), np.array([0, 0, 3.0]), texture)


@pytest.mark.parametrize("spot", [(0.0, 0.0), (1.1, 0.7), (-1.2, -0.8), (-0.9, 0.9)])
def test_a_spot_appears_where_the_camera_projects_it(spot: tuple[float, float]) -> None:
    image = IDEAL.photograph(PackedWorld(World((wall(0.0, 40, spot),))), WALL, 0).astype(float)
    weight = image.sum(axis=-1) - image.sum(axis=-1).min()
    weight[weight < 0.25 * weight.max()] = 0.0
    rows, columns = np.mgrid[:120, :160] + 0.5
    seen = np.array([(weight * columns).sum(), (weight * rows).sum()]) / weight.sum()
    expected = CAMERA.project(WALL.inverse().apply([spot[0], 0.0, spot[1]]))
    assert np.abs(seen - expected).max() < 0.25


def test_the_nearer_wall_hides_the_other() -> None:
    near, far = wall(-0.5, 200), wall(0.5, 20)
    for walls in ((near, far), (far, near)):
        image = IDEAL.photograph(PackedWorld(World(walls)), WALL, 0)
        assert (image[60, 80] == image.max()).all()
    behind = IDEAL.photograph(PackedWorld(World((wall(-2.5, 200), far))), WALL, 0)
    assert (behind[60, 80] == np.round(255 * (20 / 255) ** (1 / 2.2))).all()


def test_where_nothing_is_there_is_sky() -> None:
    turned = look_at([0.0, -2.0, 0.0], [0.0, -9.0, 0.0], [0.0, 0.0, 1.0])
    image = IDEAL.photograph(PackedWorld(World((wall(0.0, 40),), sky=(0.25, 0.5, 1.0))), turned, 0)
    assert (image == np.round(255 * np.array([0.25, 0.5, 1.0]) ** (1 / 2.2))).all()


def test_what_is_left_out_of_the_tracing_would_not_be_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    world, poses = PackedWorld(courtyard()), orbit(3)
    images = [IDEAL.photograph(world, pose, 0) for pose in poses]
    traced = [len(world.in_front(pixel_corner_rays(CAMERA), pose)) for pose in poses]
    assert max(traced) < len(world.corners)
    monkeypatch.setattr(PackedWorld, "in_front", lambda self, *_: np.arange(len(self.corners)))
    for image, pose in zip(images, poses, strict=True):
        assert np.array_equal(image, IDEAL.photograph(world, pose, 0))


def test_exposure_scales_light_and_noise_has_the_variance_of_counted_electrons() -> None:
    world = PackedWorld(World((wall(0.0, 64),)))
    plain = IDEAL.photograph(world, WALL, 0)[40:80, 60:100]
    brighter = replace(IDEAL, exposure_ev=1.0).photograph(world, WALL, 0)[40:80, 60:100]
    assert np.abs((brighter / 255.0) ** 2.2 / (plain / 255.0) ** 2.2 - 2.0).max() < 0.05
    noisy = replace(IDEAL, full_well=400.0).photograph(world, WALL, 3)[40:80, 60:100]
    light = (noisy / 255.0) ** 2.2
    assert light.var() == pytest.approx(64 / 255 / 400.0, rel=0.1)
    assert (noisy != replace(IDEAL, full_well=400.0).photograph(world, WALL, 4)[40:80, 60:100]).any()


def test_corners_lose_light() -> None:
    image = replace(IDEAL, vignetting=0.5).photograph(PackedWorld(World((wall(0.0, 64),))), WALL, 0)
    assert image[0, 0, 0] < image[60, 0, 0] < image[60, 80, 0]


def test_the_folder_is_a_dataset_whose_truth_is_what_was_asked(tmp_path: Path) -> None:
    poses = orbit(3)
    camera = SimulatedCamera(CAMERA)
    paths = write_photographs(tmp_path, courtyard(boxes=2), camera, poses, Monitor())
    assert [path.name for path in paths] == ["0000.jpg", "0001.jpg", "0002.jpg"]
    dataset = read_dataset(tmp_path / "images", transforms=tmp_path / "transforms.json")
    for view, pose in zip(dataset.views, poses, strict=True):
        assert np.allclose(view.camera_from_model.inverse().matrix, pose.matrix)
        assert view.camera.width == 160
    with Image.open(paths[0]) as photograph:
        assert photograph.getexif().get_ifd(0x8769)[0xA405] == round(36 * 104 / 160)
    again = write_photographs(tmp_path / "again", courtyard(boxes=2), camera, poses, Monitor())
    assert [path.read_bytes() for path in again] == [path.read_bytes() for path in paths]
    other = write_photographs(tmp_path / "other", courtyard(seed=1, boxes=2), camera, poses[:1], Monitor())
    assert other[0].read_bytes() != paths[0].read_bytes()


def test_it_stops_when_asked(tmp_path: Path) -> None:
    def after_one(_: Progress) -> None:
        monitor.cancel()

    monitor = Monitor(after_one)
    with pytest.raises(Cancelled):
        write_photographs(tmp_path, World((wall(0.0, 9),)), IDEAL, orbit(5), monitor)
    assert len(list((tmp_path / "images").iterdir())) == 1
    paths = write_photographs(tmp_path, World((wall(0.0, 9),)), IDEAL, orbit(5), Monitor())
    assert len(paths) == 5


@pytest.mark.parametrize("precious", ["transforms.json", "images/holiday.jpg"])
def test_what_somebody_else_keeps_in_the_folder_stays(tmp_path: Path, precious: str) -> None:
    (tmp_path / precious).parent.mkdir(exist_ok=True)
    (tmp_path / precious).write_bytes(b"\xffprecious")
    with pytest.raises(OutputExistsError, match="nothing was changed"):
        write_photographs(tmp_path, World((wall(0.0, 9),)), IDEAL, orbit(2), Monitor())
    assert [path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()] == [b"\xffprecious"]


def test_a_folder_that_cannot_be_made_is_named(tmp_path: Path) -> None:
    (tmp_path / "taken").write_text("a file")
    with pytest.raises(StorageError, match="taken cannot be used"):
        write_photographs(tmp_path / "taken", World((wall(0.0, 9),)), IDEAL, orbit(2), Monitor())


def test_a_fisheye_lens_has_no_place_in_transforms_json(tmp_path: Path) -> None:
    lens = DistortedCamera("OPENCV_FISHEYE", 16, 12, (10.0, 10.0, 8.0, 6.0, 0.01, 0.0, 0.0, 0.0))
    with pytest.raises(InvalidInputError, match="k1, k2, p1 and p2"):
        write_photographs(tmp_path, World((wall(0.0, 9),)), SimulatedCamera(lens), orbit(1), Monitor())
    pinhole = SimulatedCamera(PinholeCamera(16, 12, 10.0, 10.0, 8.0, 6.0))
    write_photographs(tmp_path, World((wall(0.0, 9),)), pinhole, orbit(1), Monitor())
    assert json.loads((tmp_path / "transforms.json").read_text())["k1"] == 0.0


def test_an_orbit_stays_at_its_radius_and_looks_inwards() -> None:
    for pose in orbit(12, radius_m=3.0):
        assert np.linalg.norm(pose.translation[:2]) == pytest.approx(3.0)
        assert PinholeCamera(64, 48, 40.0, 40.0, 32.0, 24.0).project(
            pose.inverse().apply([0.0, 0.0, 0.5])
        ) == pytest.approx([32.0, 24.0])
    with pytest.raises(InvalidInputError):
        orbit(0)


def test_a_survey_covers_its_ground_in_rows_and_looks_down() -> None:
    poses = survey(200)
    centres = np.stack([pose.translation for pose in poses])
    assert np.ptp(centres[:, :2], axis=0) == pytest.approx([7.0 * 19, 8.0 * 9])
    steps = np.linalg.norm(np.diff(centres[:, :2], axis=0), axis=1)
    assert set(np.round(steps, 6)) == {7.0, 8.0}  # to and fro
    assert all(pose.rotation[2, 2] < -np.cos(np.radians(15)) for pose in poses)
    with pytest.raises(InvalidInputError):
        survey(0)


def test_a_settlement_has_houses_that_stand_on_the_ground() -> None:
    ground, *faces = settlement(houses=4).rectangles
    assert ground.corner[2] == 0
    lids = [face for face in faces if face.side_u[2] == face.side_v[2] == 0]
    assert len(lids) == 4
    assert all(3 <= lid.corner[2] <= 9 for lid in lids)


def test_bad_rectangles_and_cameras_are_refused() -> None:
    with pytest.raises(InvalidInputError, match="right angles"):
        Rectangle(np.zeros(3), np.array([1.0, 0, 0]), np.array([1.0, 1, 0]), np.zeros((2, 2, 3), np.uint8))
    with pytest.raises(InvalidInputError):
        SimulatedCamera(CAMERA, vignetting=2.0)


def test_rays_match_between_frames() -> None:
    """A camera moved together with the world takes the same photograph."""
    turn = RigidTransform(np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]]), np.array([3.0, 1.0, -2.0]))
    still = wall(0.0, 40, (0.4, 0.3))
    moved = Rectangle(
        turn.apply(still.corner), turn.rotation @ still.side_u, turn.rotation @ still.side_v, still.texture
    )
    first = IDEAL.photograph(PackedWorld(World((still,))), WALL, 0)
    second = IDEAL.photograph(PackedWorld(World((moved,))), turn @ WALL, 0)
    assert np.abs(first.astype(int) - second).max() <= 1
