import json
import os
from pathlib import Path

import numpy as np
import pycolmap
import pytest
from PIL import Image

from fvs_engine.errors import InvalidInputError
from fvs_engine.images.masks import read_mask
from fvs_engine.scene.dataset import Dataset, link_masks, read_dataset
from fvs_engine.scene.photographs import Photographs
from fvs_engine.sfm.colmap.model import to_pycolmap
from fvs_engine.views import View
from fvs_schema.findings import FindingCode

NAMES = ("b.png", "a.png", "c.png")


def write_photographs(folder: Path, names: tuple[str, ...] = NAMES, size: tuple[int, int] = (48, 40)) -> Path:
    folder.mkdir()
    for name in names:
        Image.new("RGB", size, (90, 120, 150)).save(folder / name)
    return folder


def model(ball: Dataset) -> pycolmap.Reconstruction:
    """Three views; points seen by b and a, by a alone (twice), and by all."""
    views = [
        View(name, view.camera, view.camera_from_model) for name, view in zip(NAMES, ball.views, strict=False)
    ]
    made = to_pycolmap(views)
    for image in made.images.values():
        image.points2D = [pycolmap.Point2D(np.array([1.0 + i, 2.0])) for i in range(4)]
    element = pycolmap.TrackElement
    for xyz, elements in (
        ([1.0, 0.0, 0.0], [element(1, 0), element(2, 0)]),
        ([2.0, 0.0, 0.0], [element(2, 1), element(2, 2)]),
        ([3.0, 0.0, 0.0], [element(1, 3), element(2, 3), element(3, 3)]),
    ):
        made.add_point3D(np.array(xyz), pycolmap.Track(elements), np.array([1, 2, 3], np.uint8))
    return made


@pytest.fixture
def colmap(tmp_path: Path, ball: Dataset) -> Path:
    folder = tmp_path / "model" / "sparse" / "0"
    folder.mkdir(parents=True)
    model(ball).write_binary(folder)
    return tmp_path / "model"


def write_transforms(file: Path, **frames: object) -> Path:
    matrices = {name: np.eye(4).tolist() for name in ("images/a.png", "images/b.png", "images/gone.png")}
    listed = [{"file_path": name, "transform_matrix": m} for name, m in {**matrices, **frames}.items()]
    file.write_text(json.dumps({"fl_x": 50.0, "w": 48, "h": 40, "frames": listed}))
    return file


def test_a_colmap_model_with_its_photographs(tmp_path: Path, colmap: Path, ball: Dataset) -> None:
    dataset = read_dataset(write_photographs(tmp_path / "images"), colmap=colmap)
    assert dataset.names == ("a.png", "b.png", "c.png")
    assert dataset.by_name["b.png"].camera == ball.views[0].camera
    assert np.allclose(dataset.centres()["a.png"], ball.views[1].centre)
    assert dataset.warnings == ()
    assert dataset.points is not None
    assert dataset.points.seen_by(["a.png", "b.png"]).xyz[:, 0].tolist() == [1.0, 3.0]
    assert dataset.points.seen_by(["a.png", "c.png"]).xyz[:, 0].tolist() == [3.0]
    assert len(dataset.points.seen_by(["a.png"])) == 0
    assert dataset.points.seen_by(dataset.names).colors.tolist() == [[1, 2, 3]] * 2


def test_photographs_and_poses_that_miss_each_other_are_named(tmp_path: Path, colmap: Path) -> None:
    dataset = read_dataset(write_photographs(tmp_path / "images", ("a.png", "c.png", "x.jpg")), colmap=colmap)
    assert dataset.names == ("a.png", "c.png")
    missing, unposed = dataset.warnings
    assert (missing.code, missing.images) == (FindingCode.VIEWS_WITHOUT_PHOTOGRAPH, ("b.png",))
    assert missing.numbers == {"of": 3}
    assert (unposed.code, unposed.images) == (FindingCode.PHOTOGRAPHS_WITHOUT_POSE, ("x.jpg",))
    assert dataset.points is not None
    assert dataset.points.view_names == ("a.png", "c.png")
    assert dataset.points.seen_by(["a.png", "c.png"]).xyz[:, 0].tolist() == [3.0]


def test_photographs_of_another_size_take_their_cameras_along(tmp_path: Path, colmap: Path) -> None:
    dataset = read_dataset(write_photographs(tmp_path / "images", size=(96, 80)), colmap=colmap)
    camera = dataset.views[0].camera
    assert (camera.width, camera.height, camera.fx) == (96, 80, 100.0)
    with pytest.raises(InvalidInputError, match="40×48"):
        read_dataset(write_photographs(tmp_path / "tall", size=(40, 48)), colmap=colmap)


def test_a_model_without_points_leaves_them_to_be_triangulated(tmp_path: Path, ball: Dataset) -> None:
    folder = tmp_path / "model"
    folder.mkdir()
    views = [View(n, v.camera, v.camera_from_model) for n, v in zip(NAMES, ball.views, strict=False)]
    to_pycolmap(views).write_binary(folder)
    assert read_dataset(write_photographs(tmp_path / "images"), colmap=folder).points is None


def test_listed_photographs_that_are_not_there_are_left_out(tmp_path: Path) -> None:
    images = write_photographs(tmp_path / "images")
    dataset = read_dataset(images, transforms=write_transforms(tmp_path / "transforms.json"))
    assert dataset.names == ("a.png", "b.png")
    assert dataset.points is None
    assert [warning.images for warning in dataset.warnings] == [("images/gone.png",), ("c.png",)]


def test_the_fox_lists_more_than_there_is(data_dir: Path) -> None:
    dataset = read_dataset(data_dir / "fox" / "images", transforms=data_dir / "fox" / "transforms.json")
    assert len(dataset.views) == 50
    assert (len(dataset.warnings[0].images), dataset.warnings[0].numbers) == (17, {"of": 67})


def test_poses_that_are_not_numbers_name_their_view(tmp_path: Path, ball: Dataset) -> None:
    images = write_photographs(tmp_path / "images")
    broken = np.eye(4)
    broken[0, 3] = np.nan
    file = write_transforms(tmp_path / "transforms.json", **{"images/b.png": broken.tolist()})
    with pytest.raises(InvalidInputError, match=r"images/b\.png .*not finite"):
        read_dataset(images, transforms=file)

    folder = tmp_path / "model"
    folder.mkdir()
    damaged = model(ball)
    frame = damaged.images[2].frame
    assert frame is not None
    frame.rig_from_world = pycolmap.Rigid3d(pycolmap.Rotation3d(np.eye(3)), np.array([0.0, np.nan, 0.0]))
    damaged.write_binary(folder)
    with pytest.raises(InvalidInputError, match=r"a\.png .*not finite"):
        read_dataset(images, colmap=folder)


def test_cameras_belong_to_stored_pixels_whatever_exif_says(tmp_path: Path, colmap: Path) -> None:
    images = write_photographs(tmp_path / "images")
    exif = Image.Exif()
    exif[0x0112] = 6
    Image.new("RGB", (48, 40)).save(images / "a.png", exif=exif)
    dataset = read_dataset(images, colmap=colmap)
    camera = dataset.by_name["a.png"].camera
    assert (camera.width, camera.height) == (48, 40)
    loaded = Photographs(images, 48).load("a.png", camera, dataset.by_name["a.png"].camera_from_model)
    assert loaded.image.shape == (40, 48, 3)
    Image.new("RGB", (40, 48)).save(images / "a.png", exif=exif)
    with pytest.raises(InvalidInputError, match="40×48 px, its camera 48×40") as caught:
        read_dataset(images, colmap=colmap)
    assert "remove the orientation" in caught.value.hint


def test_a_model_far_from_zero_is_moved_to_the_middle(tmp_path: Path, ball: Dataset) -> None:
    folder = tmp_path / "model"
    folder.mkdir()
    near, far, shift = model(ball), model(ball), np.array([448_000.0, 5_411_000.0, 300.0])
    far.transform(pycolmap.Sim3d(1.0, pycolmap.Rotation3d(), shift))
    far.write_binary(folder)
    dataset = read_dataset(write_photographs(tmp_path / "images"), colmap=folder)
    offset = np.array(dataset.origin) - shift
    assert np.linalg.norm(offset) < 10
    for image in near.images.values():
        np.testing.assert_allclose(
            dataset.centres()[image.name] + offset, image.projection_center(), atol=1e-6
        )
    assert dataset.points is not None
    points = np.stack([near.points3D[number].xyz for number in sorted(near.points3D)])
    np.testing.assert_allclose(dataset.points.cloud.xyz + offset, points, atol=1e-6)


def test_photographs_of_another_spelling_are_taken_and_named(tmp_path: Path, colmap: Path) -> None:
    dataset = read_dataset(write_photographs(tmp_path / "images", ("A.PNG", "b.png", "c.jpg")), colmap=colmap)
    assert dataset.names == ("A.PNG", "b.png", "c.jpg")
    (note,) = dataset.warnings
    assert (note.code, set(note.images)) == (FindingCode.NAMES_RESPELLED, {"A.PNG", "c.jpg"})


def test_a_photograph_whose_name_no_text_can_hold_is_left_out(tmp_path: Path) -> None:
    images = write_photographs(tmp_path / "images", ("a.png", "b.png", os.fsdecode(b"\xe4.png")))
    file = write_transforms(tmp_path / "transforms.json", **{"ä.png": np.eye(4).tolist()})
    dataset = read_dataset(images, transforms=file)
    assert dataset.names == ("a.png", "b.png")
    _, missing, unposed = dataset.warnings
    assert (missing.images, unposed.images) == (("images/gone.png", "ä.png"), ("%E4.png",))


def test_datasets_that_are_none(tmp_path: Path, colmap: Path) -> None:
    images = write_photographs(tmp_path / "images")
    with pytest.raises(InvalidInputError, match="needs its poses"):
        read_dataset(images)
    with pytest.raises(InvalidInputError, match="needs its poses"):
        read_dataset(images, colmap=colmap, transforms=tmp_path / "transforms.json")
    with pytest.raises(InvalidInputError, match="does not exist"):
        read_dataset(tmp_path / "absent", colmap=colmap)
    with pytest.raises(InvalidInputError, match="no COLMAP model"):
        read_dataset(images, colmap=images)
    with pytest.raises(InvalidInputError, match="1 of the 3 views"):
        read_dataset(write_photographs(tmp_path / "few", ("a.png", "y.png")), colmap=colmap)
    (images / "c.png").write_text("no image")
    with pytest.raises(InvalidInputError, match=r"c\.png cannot be read"):
        read_dataset(images, colmap=colmap)


def test_two_views_cannot_share_a_photograph(tmp_path: Path) -> None:
    images = write_photographs(tmp_path / "images")
    file = write_transforms(tmp_path / "transforms.json", **{"left/a.png": np.eye(4).tolist()})
    with pytest.raises(InvalidInputError, match=r"images/a\.png may mean a\.png, and so may left/a\.png"):
        read_dataset(images, transforms=file)


def test_masks_are_no_photographs(tmp_path: Path) -> None:
    images = write_photographs(tmp_path / "photographs")
    write_photographs(images / "masks", (*NAMES, "x.png"))
    file = write_transforms(
        tmp_path / "transforms.json"
    )  # of images/a.png: the name of a mask and a photograph
    dataset = read_dataset(images, transforms=file)
    assert dataset.names == ("a.png", "b.png")
    assert [warning.images for warning in dataset.warnings] == [("images/gone.png",), ("c.png",)]


def test_the_masks_of_a_transforms_json_are_those_of_the_folder(tmp_path: Path) -> None:
    images = write_photographs(tmp_path / "images")
    masks = {}
    for number, name in enumerate(
        ("given/a.png", "given/b.png", "masks/b.png", "images/masks/c.png"), start=4
    ):
        masks[name] = np.arange(48 * 40).reshape(40, 48) % number > 0
        (tmp_path / name).parent.mkdir(exist_ok=True)
        Image.fromarray(masks[name]).save(tmp_path / name)
    (images / "a.png").rename(images / "d.png")
    (tmp_path / "given" / "a.png").rename(images / "d_mask.png")
    frames = [
        {"file_path": f"images/{name}.png", "transform_matrix": np.eye(4).tolist(), "mask_path": mask}
        for name, mask in (("d", "images/d_mask.png"), ("b", "given/b.png"), ("c", None))
    ]
    file = tmp_path / "transforms.json"
    file.write_text(json.dumps({"fl_x": 50.0, "w": 48, "h": 40, "frames": frames}))
    dataset = read_dataset(images, transforms=file)
    assert dataset.warnings == ()
    (tmp_path / "out").mkdir()
    for _ in range(2):
        linked = link_masks(dataset, tmp_path / "out")
    found = {name: read_mask(linked.image_dir, name) for name in linked.names}
    expected = {"b.png": "masks/b.png", "c.png": "images/masks/c.png", "d.png": "given/a.png"}
    for name, mask in expected.items():
        np.testing.assert_array_equal(found[name], masks[mask])
    view = linked.by_name["d.png"]
    loaded = Photographs(linked.image_dir, 48).load("d.png", view.camera, view.camera_from_model)
    np.testing.assert_array_equal(loaded.mask, masks["given/a.png"])
    assert link_masks(linked, tmp_path / "other") is linked
