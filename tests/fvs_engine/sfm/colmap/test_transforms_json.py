import codecs
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from fvs_engine.errors import InvalidInputError
from fvs_engine.geometry import PinholeCamera
from fvs_engine.geometry.alignment.similarity import umeyama
from fvs_engine.geometry.cameras import DistortedCamera
from fvs_engine.sfm.colmap.transforms_json import import_transforms_json, read_transforms_masks


def frame(name: str, x: float = 0.0) -> dict[str, Any]:
    matrix = np.eye(4)
    matrix[0, 3] = x
    return {"file_path": name, "transform_matrix": matrix.tolist()}


def write(folder: Path, **content: Any) -> Path:
    file = folder / "transforms.json"
    file.write_text(json.dumps(content))
    return file


HEAD = {"w": 640, "h": 480, "fl_x": 700.0}


def test_a_view_looks_down_the_negative_z_axis_of_opengl(tmp_path: Path):
    file = write(tmp_path, **HEAD, frames=[frame("a.jpg", x=2.0)])
    (view,) = import_transforms_json(file).views
    np.testing.assert_allclose(view.centre, [2.0, 0.0, 0.0])
    # One metre ahead and half a metre up, in OpenGL's axes: ahead and, in ours, at negative y.
    np.testing.assert_allclose(view.camera_from_model.apply([2.0, 0.5, -1.0]), [0.0, -0.5, 1.0])
    assert view.camera == PinholeCamera(640, 480, 700.0, 700.0, 320.0, 240.0)


def test_intrinsics_of_a_frame_win_and_lenses_are_kept(tmp_path: Path):
    frames = [frame("a.jpg") | {"fl_x": 650.0, "k1": 0.1, "p2": 0.01}, frame("b.jpg")]
    first, second = import_transforms_json(write(tmp_path, **HEAD, fl_y=690.0, frames=frames)).views
    assert first.camera == DistortedCamera("OPENCV", 640, 480, (650, 690, 320, 240, 0.1, 0.0, 0.0, 0.01))
    assert second.camera == PinholeCamera(640, 480, 700.0, 690.0, 320.0, 240.0)


def test_blenders_files_need_no_suffix_and_no_size(tmp_path: Path):
    Image.new("RGB", (80, 60)).save(tmp_path / "r_0.png")
    file = write(tmp_path, camera_angle_x=math.pi / 2, frames=[frame("./r_0")])
    (view,) = import_transforms_json(file).views
    assert view.name == "r_0.png"
    assert (view.camera.width, view.camera.height) == (80, 60)
    assert view.camera.fx == pytest.approx(40.0)


def test_what_is_no_image_is_named(tmp_path: Path):
    (tmp_path / "r_0.png").write_text("not an image")
    file = write(tmp_path, camera_angle_x=math.pi / 2, frames=[frame("./r_0")])
    with pytest.raises(InvalidInputError, match=r"r_0\.png"):
        import_transforms_json(file)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ({**HEAD, "frames": []}, "no frames"),
        ({**HEAD, "frames": [{"file_path": "a.jpg"}]}, r"a\.jpg"),
        ({**HEAD, "frames": [{"transform_matrix": np.eye(4).tolist()}]}, "no file_path"),
        *(({**HEAD, "frames": [frame(name)]}, "not the path of a file") for name in (".", "", "/", "./")),
        ({**HEAD, "frames": [frame("a.jpg", x=math.nan)]}, r"a\.jpg.*not finite"),
        ({**HEAD, "fl_x": math.inf, "frames": [frame("a.jpg")]}, "fl_x.*not a finite"),
        ({**HEAD, "frames": [frame("a.jpg"), frame("a.jpg")]}, "more than one"),
        ({"w": 640, "h": 480, "frames": [frame("a.jpg")]}, "focal length"),
        ({"fl_x": 700.0, "frames": [frame("a.jpg")]}, "no image size"),
        (
            {**HEAD, "frames": [{"file_path": "a.jpg", "transform_matrix": (2 * np.eye(4)).tolist()}]},
            r"a\.jpg",
        ),
    ],
)
def test_bad_files_are_named(content: dict[str, Any], message: str, tmp_path: Path):
    with pytest.raises(InvalidInputError, match=message) as caught:
        import_transforms_json(write(tmp_path, **content))
    assert "transforms.json" in str(caught.value)


def test_what_is_no_json_is_refused(tmp_path: Path):
    (tmp_path / "transforms.json").write_text("{")
    with pytest.raises(InvalidInputError, match="not JSON"):
        import_transforms_json(tmp_path / "transforms.json")
    with pytest.raises(InvalidInputError, match="cannot be read"):
        import_transforms_json(tmp_path / "none.json")


def test_imported_and_computed_centres_can_be_compared(data_dir: Path):
    views = import_transforms_json(data_dir / "fox" / "transforms.json").views
    assert len(views) == 67
    centres = np.stack([view.centre for view in views])
    raw = json.loads((data_dir / "fox" / "transforms.json").read_text())["frames"]
    by_name = {entry["file_path"]: np.array(entry["transform_matrix"])[:3, 3] for entry in raw}
    expected = np.stack([by_name[view.name] for view in views])
    # The file's own rotations are orthonormal to 1e-6 only.
    np.testing.assert_allclose(umeyama(centres, expected).apply(centres), expected, atol=1e-4)


def test_a_size_that_is_not_given_is_that_of_the_stored_pixels_wherever_they_are(tmp_path: Path):
    """Blender's file is in another folder; EXIF turns the second photograph."""
    photographs = tmp_path / "photographs"
    photographs.mkdir()
    exif = Image.Exif()
    exif[0x0112] = 6
    Image.new("RGB", (80, 60)).save(photographs / "r_0.png")
    Image.new("RGB", (80, 60)).save(photographs / "r_1.JPG", exif=exif)
    file = write(tmp_path, camera_angle_x=math.pi / 2, frames=[frame("./train/r_0"), frame("./train/r_1")])
    with pytest.raises(InvalidInputError, match=r"no image size, and \./train/r_0 is not found"):
        import_transforms_json(file)
    for view in import_transforms_json(file, photographs).views:
        assert (view.camera.width, view.camera.height) == (80, 60)
        assert view.camera.fx == pytest.approx(40.0)


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "utf-32"])
def test_a_byte_order_mark_is_no_part_of_the_file(encoding: str, tmp_path: Path):
    file = tmp_path / "transforms.json"
    file.write_bytes(json.dumps({**HEAD, "frames": [frame("é.jpg")]}, ensure_ascii=False).encode(encoding))
    assert [view.name for view in import_transforms_json(file).views] == ["é.jpg"]


def test_what_is_no_text_is_refused(tmp_path: Path):
    (tmp_path / "transforms.json").write_bytes(codecs.BOM_UTF16_LE + b"{")
    with pytest.raises(InvalidInputError, match="not a text file"):
        import_transforms_json(tmp_path / "transforms.json")


@pytest.mark.parametrize(
    ("lens", "message"),
    [
        ({"camera_model": "EQUIRECTANGULAR"}, "camera_model EQUIRECTANGULAR, which is not supported"),
        ({"camera_model": "FISHEYE624"}, "FISHEYE624"),
        ({"camera_model": 3}, "camera_model 3"),
        ({"ftheta_p0": 0.1}, "ftheta_p0"),
        ({"latlong": True}, "latlong"),
        ({"distortion_params": [0.1, 0, 0, 0, 0, 0]}, "distortion_params"),
    ],
)
def test_lenses_that_are_not_supported_are_refused(lens: dict[str, Any], message: str, tmp_path: Path):
    in_frame = {**HEAD, "frames": [frame("a.jpg") | lens]}
    for content in ({**HEAD, **lens, "frames": [frame("a.jpg")]}, in_frame):
        with pytest.raises(InvalidInputError, match=message):
            import_transforms_json(write(tmp_path, **content))


@pytest.mark.parametrize(
    ("lens", "model"),
    [
        ({"is_fisheye": True}, "OPENCV_FISHEYE"),
        ({"camera_model": "SIMPLE_RADIAL_FISHEYE", "k1": 0.1}, "OPENCV_FISHEYE"),
        ({"camera_model": "opencv", "k1": 0.1}, "OPENCV"),
        ({"camera_model": "FULL_OPENCV", "k6": 0.1}, "FULL_OPENCV"),
    ],
)
def test_lenses_that_are_supported(lens: dict[str, Any], model: str, tmp_path: Path):
    (view,) = import_transforms_json(write(tmp_path, **HEAD, **lens, frames=[frame("a.jpg")])).views
    assert isinstance(view.camera, DistortedCamera)
    assert view.camera.model == model
    coefficients = {key: value for key, value in view.camera.named_params.items() if key[0] in "kp" and value}
    assert coefficients == {key: value for key, value in lens.items() if key[0] == "k"}
    flat = {"latlong": False, "distortion_params": [0, 0], "camera_model": "PINHOLE"}
    (plain,) = import_transforms_json(write(tmp_path, **HEAD, **flat, frames=[frame("a.jpg")])).views
    assert isinstance(plain.camera, PinholeCamera)


def test_cameras_far_from_zero_are_moved_to_the_middle_without_loss(tmp_path: Path):
    """In UTM, with a rotation that is orthonormal to float32 only: it would move a centre by decimetres."""
    turn = np.float32([[0.8, -0.6, 0.0], [0.6, 0.8, 0.0], [0.0, 0.0, 1.0]]).astype(np.float64)
    middle = np.array([448_000, 5_411_000, 300])
    centres = middle + np.array([[0.25, 0.5, 1], [12.75, 1.5, 3.5], [6.5, 3, 2]])
    frames = []
    for number, centre in enumerate(centres):
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = turn, centre
        frames.append({"file_path": f"{number}.jpg", "transform_matrix": matrix.tolist()})
    imported = import_transforms_json(write(tmp_path, **HEAD, frames=frames))
    assert imported.origin.tolist() == [448_006.0, 5_411_002.0, 302.0]
    found = np.stack([view.centre for view in imported.views])
    np.testing.assert_allclose(found, centres - imported.origin, atol=1e-5)
    near = write(tmp_path, **HEAD, frames=[frame("a.jpg", x=40.0), frame("b.jpg", x=41.0)])
    assert not import_transforms_json(near).origin.any()


def test_masks_are_those_of_frames_or_of_the_head(tmp_path: Path):
    masks = [tmp_path / "segments" / name for name in ("a.png", "all.png")]
    masks[0].parent.mkdir()
    for mask in masks:
        mask.touch()
    frames = [frame("a.jpg") | {"mask_path": "segments\\a.png"}, frame("b.jpg")]
    assert read_transforms_masks(write(tmp_path, frames=frames)) == {"a.jpg": masks[0], "b.jpg": None}
    file = write(tmp_path, mask_path="segments/all.png", frames=frames)
    assert read_transforms_masks(file) == {"a.jpg": masks[0], "b.jpg": masks[1]}
    assert read_transforms_masks(write(tmp_path, frames=[frame("a.jpg"), frame("b.jpg")])) == {}


@pytest.mark.parametrize(
    ("mask", "message"), [("none.png", "none.png, the mask of a.jpg"), (3, "The mask_path of a.jpg")]
)
def test_masks_that_do_not_exist_are_named(mask: object, message: str, tmp_path: Path):
    with pytest.raises(InvalidInputError, match=message):
        read_transforms_masks(write(tmp_path, frames=[frame("a.jpg") | {"mask_path": mask}]))
