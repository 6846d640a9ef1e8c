import json
import math
import shutil
import struct
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pycolmap
import pytest
from PIL import Image

from fvs_engine.errors import Cancelled, InvalidInputError, StorageError
from fvs_engine.geometry import PinholeCamera, RigidTransform
from fvs_engine.geometry.alignment.similarity import umeyama
from fvs_engine.geometry.cameras import DistortedCamera
from fvs_engine.images.masks import read_mask
from fvs_engine.monitor import Monitor
from fvs_engine.sfm.batch.reconstruct import SfmResult, reconstruct
from fvs_engine.sfm.batch.triangulate import triangulate
from fvs_engine.sfm.batch.undistort import undistort
from fvs_engine.sfm.colmap.imports import import_colmap, import_transforms_json
from fvs_engine.sfm.colmap.model import from_pycolmap, open_colmap, read_colmap, write_colmap
from fvs_engine.sfm.pose_priors import ImageSet
from fvs_engine.sfm.reconstruction import Reconstruction
from fvs_engine.sfm.settings import FeatureSettings, SfmSettings
from fvs_engine.views import AnyView, View
from fvs_schema.findings import Finding, FindingCode


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


@pytest.mark.parametrize("kind", ["binary", "text"])
def test_a_colmap_model_is_found_and_read(kind: str, kermit_sfm: SfmResult, kermit_dir: Path, tmp_path: Path):
    folder = tmp_path / "sparse" / "0"
    folder.mkdir(parents=True)
    getattr(pycolmap.Reconstruction(kermit_sfm.model_dir), f"write_{kind}")(folder)
    imported = import_colmap(tmp_path, kermit_dir)
    assert imported.centres().keys() == kermit_sfm.reconstruction.centres().keys()
    for view, expected in zip(imported.views, kermit_sfm.reconstruction.views, strict=True):
        np.testing.assert_allclose(view.centre, expected.centre, atol=1e-9)
    assert imported.points.xyz.shape == kermit_sfm.reconstruction.points.xyz.shape


def test_resized_photographs_get_scaled_cameras(kermit_sfm: SfmResult, kermit_copy: Path):
    for path in kermit_copy.iterdir():
        with Image.open(path) as image:
            small = image.convert("RGB").resize((320, 240))
        small.save(path)
    imported = import_colmap(kermit_sfm.model_dir, kermit_copy)
    for view, full in zip(imported.views, kermit_sfm.reconstruction.views, strict=True):
        assert (view.camera.width, view.camera.height) == (320, 240)
        assert view.camera.fx == pytest.approx(full.camera.fx / 2)


def test_photographs_of_another_shape_are_refused(kermit_sfm: SfmResult, kermit_copy: Path):
    name = kermit_sfm.reconstruction.views[0].name
    Image.new("RGB", (480, 640)).save(kermit_copy / name)
    with pytest.raises(InvalidInputError, match=name):
        import_colmap(kermit_sfm.model_dir, kermit_copy)


def test_a_folder_without_a_model_is_refused(kermit_dir: Path, tmp_path: Path):
    with pytest.raises(InvalidInputError, match="holds no COLMAP model"):
        import_colmap(tmp_path, kermit_dir)


@pytest.mark.parametrize("name", ["cameras.bin", "images.bin", "points3D.bin"])
@pytest.mark.parametrize(
    "spoil", [lambda data: data[:0], lambda data: data[:60], lambda data: data[:-1], lambda data: data + b"x"]
)
def test_a_model_that_was_cut_short_is_named(
    name: str, spoil: Callable[[bytes], bytes], kermit_sfm: SfmResult, kermit_dir: Path, tmp_path: Path
):
    shutil.copytree(kermit_sfm.model_dir, tmp_path / "sparse")
    file = tmp_path / "sparse" / name
    file.write_bytes(spoil(file.read_bytes()))
    with pytest.raises(StorageError, match=rf"{name} is damaged"):
        import_colmap(tmp_path, kermit_dir)


def test_a_model_survives_writing_and_reading(kermit_sfm: SfmResult, tmp_path: Path):
    write_colmap(kermit_sfm.reconstruction, tmp_path)
    again = read_colmap(tmp_path)
    assert [view.camera for view in again.views] == [view.camera for view in kermit_sfm.reconstruction.views]
    for view, expected in zip(again.views, kermit_sfm.reconstruction.views, strict=True):
        np.testing.assert_allclose(
            view.camera_from_model.matrix, expected.camera_from_model.matrix, atol=1e-12
        )
    order, expected_order = (np.lexsort(r.points.xyz.T) for r in (again, kermit_sfm.reconstruction))
    np.testing.assert_allclose(again.points.xyz[order], kermit_sfm.reconstruction.points.xyz[expected_order])
    np.testing.assert_array_equal(
        again.points.colors[order], kermit_sfm.reconstruction.points.colors[expected_order]
    )


def test_a_binary_model_is_read_as_pycolmap_reads_it(kermit_sfm: SfmResult) -> None:
    ours = read_colmap(kermit_sfm.model_dir)
    theirs = from_pycolmap(open_colmap(kermit_sfm.model_dir))
    for view, expected in zip(ours.views, theirs.views, strict=True):
        assert (view.name, view.camera) == (expected.name, expected.camera)
        np.testing.assert_array_equal(view.camera_from_model.matrix, expected.camera_from_model.matrix)
    order, expected_order = (
        np.lexsort((model.point_errors_px, *model.points.xyz.T)) for model in (ours, theirs)
    )
    for found, right in (
        (ours.points.xyz, theirs.points.xyz),
        (ours.points.colors, theirs.points.colors),
        (ours.point_errors_px, theirs.point_errors_px),
    ):
        np.testing.assert_array_equal(found[order], right[expected_order])


def test_a_binary_model_without_points_is_read(kermit_sfm: SfmResult, tmp_path: Path) -> None:
    write_colmap(Reconstruction.of_views(kermit_sfm.reconstruction.views), tmp_path)
    again = read_colmap(tmp_path)
    assert len(again.views) == len(kermit_sfm.reconstruction.views)
    assert again.points.xyz.shape == again.points.colors.shape == (0, 3)


def test_an_image_without_its_camera_is_no_model(kermit_sfm: SfmResult, tmp_path: Path) -> None:
    shutil.copytree(kermit_sfm.model_dir, tmp_path / "sparse")
    file = tmp_path / "sparse" / "images.bin"
    content = bytearray(file.read_bytes())
    struct.pack_into("<I", content, 8 + 4 + 7 * 8, 77)  # of the first image
    file.write_bytes(content)
    with pytest.raises(StorageError, match="cannot be read"):
        read_colmap(tmp_path / "sparse")


@pytest.mark.parametrize("name", ["cameras.bin", "images.bin"])
def test_two_records_of_one_id_are_no_model(tmp_path: Path, name: str) -> None:
    cameras = (PinholeCamera(64, 48, 50.0, 50.0, 32.0, 24.0), PinholeCamera(64, 48, 60.0, 60.0, 32.0, 24.0))
    views = [View(f"{i}.jpg", camera, RigidTransform.identity()) for i, camera in enumerate(cameras)]
    write_colmap(Reconstruction.of_views(views), tmp_path)
    assert len(read_colmap(tmp_path).views) == 2
    file = tmp_path / name
    content = bytearray(file.read_bytes())
    second = 8 + (len(content) - 8) // 2  # both records are of one length
    content[second : second + 4] = content[8:12]
    file.write_bytes(content)
    with pytest.raises(StorageError, match="cannot be read"):
        read_colmap(tmp_path)


@pytest.fixture
def kermit_folder(kermit_sfm: SfmResult, tmp_path: Path) -> Path:
    """A copy whose features and matches need not be computed again."""
    return Path(shutil.copytree(kermit_sfm.model_dir.parent, tmp_path / "sfm"))


@pytest.mark.usefixtures("native_here")
def test_given_cameras_get_points_and_do_not_move(
    kermit_sfm: SfmResult, kermit_dir: Path, kermit_folder: Path
):
    given = kermit_sfm.reconstruction.views
    absent = replace(given[6], name="gone.jpg")
    result = triangulate(
        Reconstruction.of_views((*given, absent)), kermit_dir, kermit_folder, SfmSettings(), Monitor()
    )
    assert result.report.verdict == "accepted"
    assert len(result.reconstruction.points) > 300
    assert result.reconstruction.points.colors.max() > 0
    for view, expected in zip(result.reconstruction.views, given, strict=True):
        assert view.camera == expected.camera
        np.testing.assert_allclose(view.centre, expected.centre, atol=1e-9)
    assert Finding.of(FindingCode.NO_IMAGE_OF_CAMERA, ["gone.jpg"]) in result.report.warnings


@pytest.mark.system
@pytest.mark.usefixtures("native_here")
def test_points_in_two_images_alone_are_kept_however_many_images_there_are(
    kermit_sfm: SfmResult, kermit_dir: Path, tmp_path: Path
):
    images = shutil.copytree(kermit_dir, tmp_path / "images")
    given = kermit_sfm.reconstruction.views
    blank = [replace(given[0], name=f"blank{index:02d}.png") for index in range(12)]
    for view in blank:
        Image.new("RGB", (view.camera.width, view.camera.height)).save(images / view.name)
    settings = SfmSettings(threads=1, exhaustive_up_to=3, features_of_many=FeatureSettings(max_features=500))
    few, many = (
        triangulate(Reconstruction.of_views(views), images, tmp_path / "sfm", settings, Monitor())
        for views in (given, (*given, *blank))
    )
    assert len(many.reconstruction.views) == 23
    assert len(many.reconstruction.points) >= len(few.reconstruction.points) > 300


@pytest.mark.usefixtures("native_here")
def test_given_cameras_follow_resized_photographs(
    kermit_sfm: SfmResult, kermit_dir: Path, kermit_folder: Path
):
    double = [
        replace(view, camera=view.camera.resized(1280, 960)) for view in kermit_sfm.reconstruction.views
    ]
    result = triangulate(
        Reconstruction.of_views(tuple(double)), kermit_dir, kermit_folder, SfmSettings(), Monitor()
    )
    assert result.report.verdict == "accepted"
    assert {(view.camera.width, view.camera.height) for view in result.reconstruction.views} == {(640, 480)}
    wide = (replace(double[0], camera=double[0].camera.resized(1280, 700)), *double[1:])
    with pytest.raises(InvalidInputError, match=double[0].name):
        triangulate(Reconstruction.of_views(wide), kermit_dir, kermit_folder, SfmSettings(), Monitor())


@pytest.mark.system
@pytest.mark.usefixtures("native_here")
def test_other_cameras_get_other_points_and_photographs_their_own_cameras_again(
    kermit_sfm: SfmResult, kermit_dir: Path, kermit_folder: Path
):
    def points(views: tuple[AnyView, ...]) -> SfmResult:
        return triangulate(
            Reconstruction.of_views(views), kermit_dir, kermit_folder, SfmSettings(), Monitor()
        )

    given = kermit_sfm.reconstruction.views
    shift = RigidTransform(np.eye(3), np.array([10.0, 0.0, 0.0]))
    moved = tuple(replace(view, camera_from_model=view.camera_from_model @ shift) for view in given)
    first, second = points(given), points(moved)
    np.testing.assert_allclose(
        np.median(first.reconstruction.points.xyz - second.reconstruction.points.xyz, axis=0),
        [10.0, 0.0, 0.0],
        atol=0.2,
    )
    names = [view.name for view in given]
    again = reconstruct(ImageSet(kermit_dir, names), kermit_folder, SfmSettings(), Monitor())
    assert again.report.mapper == kermit_sfm.report.mapper


def test_undistorted_views_are_pinhole_and_where_they_were(
    kermit_sfm: SfmResult, kermit_dir: Path, tmp_path: Path
):
    undistorted = undistort(kermit_sfm.model_dir, kermit_dir, tmp_path / "undistorted", Monitor())
    assert len(undistorted.views) == 11
    for view, expected in zip(undistorted.views, kermit_sfm.reconstruction.views, strict=True):
        assert isinstance(view.camera, PinholeCamera)
        np.testing.assert_allclose(view.centre, expected.centre, atol=1e-9)
        with Image.open(tmp_path / "undistorted" / "images" / view.name) as image:
            assert image.size == (view.camera.width, view.camera.height)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["undistorted"]
    assert sorted(path.name for path in (tmp_path / "undistorted").iterdir()) == ["images", "sparse"]


def test_masks_are_undistorted_with_their_images(
    kermit_sfm: SfmResult, kermit_names: list[str], tmp_path: Path
):
    """Of an image that is white where it counts, and black where it does not."""
    images = tmp_path / "images"
    images.mkdir()
    (tmp_path / "masks").mkdir()
    counts = np.ones((480, 640), dtype=bool)
    counts[100:300, 200:500] = False
    for name in kermit_names:
        Image.fromarray(counts).convert("RGB").save(images / name)
    Image.fromarray(counts).save(tmp_path / "masks" / f"{kermit_names[0]}.png")
    undistort(kermit_sfm.model_dir, images, tmp_path / "undistorted", Monitor())
    written = tmp_path / "undistorted" / "masks"
    assert [path.name for path in written.iterdir()] == [f"{kermit_names[0]}.png"]
    mask = read_mask(tmp_path / "undistorted" / "images", kermit_names[0])
    assert mask is not None
    shown = np.asarray(Image.open(tmp_path / "undistorted" / "images" / kermit_names[0]).convert("L"))
    assert shown[mask].min() > 200
    assert shown[~mask].max() > 50, "the border of the mask is left out"
    assert (shown[~mask] > 200).mean() < 0.05


def test_a_cancelled_undistortion_leaves_nothing_that_looks_whole(
    kermit_sfm: SfmResult, kermit_dir: Path, tmp_path: Path
):
    monitor = Monitor()
    monitor.cancel()
    with pytest.raises(Cancelled):
        undistort(kermit_sfm.model_dir, kermit_dir, tmp_path / "undistorted", monitor)
    assert not (tmp_path / "undistorted").exists()
    assert len(undistort(kermit_sfm.model_dir, kermit_dir, tmp_path / "undistorted", Monitor()).views) == 11


def test_imported_and_computed_centres_can_be_compared(data_dir: Path):
    views = import_transforms_json(data_dir / "fox" / "transforms.json").views
    assert len(views) == 67
    centres = np.stack([view.centre for view in views])
    raw = json.loads((data_dir / "fox" / "transforms.json").read_text())["frames"]
    by_name = {entry["file_path"]: np.array(entry["transform_matrix"])[:3, 3] for entry in raw}
    expected = np.stack([by_name[view.name] for view in views])
    # The file's own rotations are orthonormal to 1e-6 only.
    np.testing.assert_allclose(umeyama(centres, expected).apply(centres), expected, atol=1e-4)
