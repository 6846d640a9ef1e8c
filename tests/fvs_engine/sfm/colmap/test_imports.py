import shutil
import struct
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pycolmap
import pytest
from PIL import Image

from fvs_engine.errors import Cancelled, InvalidInputError, StorageError
from fvs_engine.geometry import PinholeCamera, RigidTransform
from fvs_engine.geometry.cameras import DistortedCamera
from fvs_engine.images.masks import read_mask
from fvs_engine.images.names import decoded_name, match_names
from fvs_engine.monitor import Monitor
from fvs_engine.sfm.batch.reconstruct import SfmResult, reconstruct
from fvs_engine.sfm.batch.triangulate import triangulate
from fvs_engine.sfm.batch.undistort import undistort
from fvs_engine.sfm.colmap.imports import import_colmap
from fvs_engine.sfm.colmap.model import from_pycolmap, open_colmap, read_colmap, to_pycolmap, write_colmap
from fvs_engine.sfm.pose_priors import ImageSet
from fvs_engine.sfm.reconstruction import PointCloud, Reconstruction
from fvs_engine.sfm.settings import FeatureSettings, SfmSettings
from fvs_engine.views import AnyView, View
from fvs_schema.findings import Finding, FindingCode


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


def three_views(
    names: tuple[str, str, str], offset: tuple[float, float, float] = (0.0, 0.0, 0.0)
) -> Reconstruction:
    """Three cameras 2 apart, and the points before them."""
    camera = PinholeCamera(64, 48, 50.0, 50.0, 32.0, 24.0)
    views = [
        View(name, camera, RigidTransform(np.eye(3), -np.array(offset) - [2.0 * number, 0.0, 0.0]))
        for number, name in enumerate(names)
    ]
    points = np.array([[0.0, 0.0, 5.0], [1.0, 0.5, 6.0]]) + offset
    return replace(Reconstruction.of_views(views), points=PointCloud(points, np.zeros((2, 3), np.uint8)))


@pytest.mark.parametrize("kind", ["binary", "text"])
def test_names_in_another_character_set_are_read_and_matched(kind: str, tmp_path: Path):
    names = ("left\\照片1.jpg", "照片2.jpg", "plain.jpg")
    model = to_pycolmap(three_views(("XXXXX\\1.jpg", "XXXX2.jpg", "plain.jpg")).views)
    getattr(model, f"write_{kind}")(tmp_path)
    file = tmp_path / ("images.bin" if kind == "binary" else "images.txt")
    content = file.read_bytes()
    for placeholder, name in (("XXXXX\\1.jpg", names[0]), ("XXXX2.jpg", names[1])):
        content = content.replace(placeholder.encode(), name.encode("gbk"))
    file.write_bytes(content)
    imported = [view.name for view in import_colmap(tmp_path).views]
    assert imported == sorted(decoded_name(name.encode("gbk")) for name in names)
    files = ["left/照片1.jpg", "照片2.jpg", "plain.jpg"]
    found = match_names(imported, {name: name for name in files}).found
    assert sorted(found.values()) == sorted(files)
    if kind == "binary":
        assert {view.name for view in read_colmap(tmp_path).views} == set(imported)


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16"])
def test_a_text_model_that_an_editor_saved_is_read(encoding: str, tmp_path: Path):
    given = three_views(("ä.jpg", "b.jpg", "c.jpg"))
    to_pycolmap(given.views, points=given.points).write_text(tmp_path)
    for file in tmp_path.glob("*.txt"):
        file.write_bytes(file.read_text(encoding="utf-8").replace("\n", "\r\n").encode(encoding))
    imported = import_colmap(tmp_path)
    assert [view.name for view in imported.views] == ["b.jpg", "c.jpg", "ä.jpg"]
    assert len(imported.points) == 2


def test_a_model_in_real_coordinates_is_moved_to_its_middle(tmp_path: Path):
    offset = (448_000.25, 5_411_000.5, 300.0)
    names = ("a.jpg", "b.jpg", "c.jpg")
    far, near = three_views(names, offset), three_views(names)
    write_colmap(far, tmp_path)
    imported = import_colmap(tmp_path)
    assert imported.origin.tolist() == [448_002.0, 5_411_000.0, 300.0]
    back = np.array(offset) - imported.origin
    for view, expected in zip(imported.views, near.views, strict=True):
        np.testing.assert_allclose(view.centre, expected.centre + back, atol=1e-8)
    np.testing.assert_allclose(
        np.sort(imported.points.xyz, axis=0), np.sort(near.points.xyz, axis=0) + back, atol=1e-8
    )


def test_a_camera_without_distortion_is_a_pinhole_whatever_its_model(tmp_path: Path):
    camera = DistortedCamera("SIMPLE_RADIAL", 64, 48, (50.0, 32.0, 24.0, 0.0))
    views = [replace(view, camera=camera) for view in three_views(("a.jpg", "b.jpg", "c.jpg")).views]
    write_colmap(Reconstruction.of_views(views), tmp_path)
    plain = PinholeCamera(64, 48, 50.0, 50.0, 32.0, 24.0)
    assert [view.camera for view in import_colmap(tmp_path).views] == [plain] * 3
    assert [view.camera for view in read_colmap(tmp_path).views] == [plain] * 3


@pytest.mark.parametrize(
    ("model", "params"),
    [
        ("OPENCV_FISHEYE", (30.0, 30.0, 32.0, 24.0, 0.0, 0.0, 0.0, 0.0)),
        ("SIMPLE_FISHEYE", (30.0, 32.0, 24.0)),
        ("RADIAL_FISHEYE", (30.0, 32.0, 24.0, 0.01, 0.0)),
    ],
)
@pytest.mark.usefixtures("native_here")
def test_a_fisheye_is_undistorted_also_without_coefficients(
    model: str, params: tuple[float, ...], tmp_path: Path
):
    """The model bends a straight edge; undistortion makes it straight."""
    camera = DistortedCamera(model, 64, 48, params)
    views = [replace(view, camera=camera) for view in three_views(("a.png", "b.png", "c.png")).views]
    write_colmap(Reconstruction.of_views(views), tmp_path / "model")
    pixels = np.stack(np.meshgrid(np.arange(64) + 0.5, np.arange(48) + 0.5), axis=-1)
    bright = np.nan_to_num(camera.unproject(pixels))[..., 1] < 0.3  # above the plane y = 0.3 z
    for view in views:
        Image.fromarray(np.where(bright, 255, 0).astype(np.uint8)).convert("RGB").save(tmp_path / view.name)
    undistorted = undistort(tmp_path / "model", tmp_path, tmp_path / "undistorted", Monitor())
    assert not (tmp_path / "undistorted" / "bent").exists()
    for view in undistorted.views:
        assert isinstance(view.camera, PinholeCamera)
        with Image.open(tmp_path / "undistorted" / "images" / view.name) as image:
            rows = (np.asarray(image.convert("L")) > 127).sum(axis=0)
        assert np.ptp(rows) <= 2
        assert np.median(rows) == pytest.approx(view.camera.cy + 0.3 * view.camera.fy, abs=1.0)


@pytest.mark.usefixtures("native_here")
def test_given_points_stay_and_the_matches_judge_the_cameras(
    kermit_sfm: SfmResult, kermit_dir: Path, kermit_folder: Path
):
    given = kermit_sfm.reconstruction
    result = triangulate(given, kermit_dir, kermit_folder, SfmSettings(), Monitor())
    assert result.report.verdict == "accepted"
    assert result.report.mean_reprojection_error_px == pytest.approx(given.point_errors_px.mean())
    np.testing.assert_array_equal(
        np.sort(result.reconstruction.points.xyz, axis=0), np.sort(given.points.xyz, axis=0)
    )
    names = [view.name for view in given.views]
    swapped = [replace(view, name=name) for view, name in zip(given.views, reversed(names), strict=True)]
    wrong = replace(given, views=tuple(sorted(swapped, key=lambda view: view.name)))
    report = triangulate(wrong, kermit_dir, kermit_folder, SfmSettings(), Monitor()).report
    assert report.verdict == "doubtful"
    assert [warning.code for warning in report.warnings] == [FindingCode.MATCH_SUPPORT]


def test_a_text_model_names_the_camera_that_it_cannot_have(tmp_path: Path):
    given = three_views(("a.jpg", "b.jpg", "c.jpg"))
    to_pycolmap(given.views, points=given.points).write_text(tmp_path)
    file = tmp_path / "cameras.txt"
    file.write_text(file.read_text().replace("PINHOLE", "SPHERICAL"))
    with pytest.raises(InvalidInputError, match="type SPHERICAL, which the engine does not know"):
        import_colmap(tmp_path)
