"""Cameras made elsewhere: kermit's own, written as a transforms.json and as a COLMAP model without points."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from fvs_engine.errors import ProcessDiedError
from fvs_engine.geometry.cameras import DistortedCamera
from fvs_engine.monitor import Monitor
from fvs_engine.pipeline.cameras import find_cameras
from fvs_engine.pipeline.manifest import ImageRecord, ImagesRecord, Manifest, ReconstructionSettings
from fvs_engine.pipeline.model import read_undistorted
from fvs_engine.pipeline.workspace import Workspace
from fvs_engine.sfm.batch import undistort
from fvs_engine.sfm.batch.reconstruct import SfmResult
from fvs_engine.sfm.colmap.model import write_colmap
from fvs_engine.sfm.jobs import UndistortImages
from fvs_engine.sfm.reconstruction import Reconstruction
from fvs_engine.views import AnyView
from fvs_schema.findings import Finding, FindingCode

pytestmark = pytest.mark.usefixtures("all_native_here")

USED = 6


@pytest.fixture(scope="module")
def given(kermit_sfm: SfmResult) -> tuple[AnyView, ...]:
    return kermit_sfm.reconstruction.views[:USED]


@pytest.fixture
def workspace(kermit_dir: Path, tmp_path: Path) -> Workspace:
    """With the photographs at half their size: given cameras are scaled to them."""
    workspace = Workspace(tmp_path / "out")
    workspace.images.mkdir(parents=True)
    for path in kermit_dir.iterdir():
        with Image.open(path) as image:
            image.resize((320, 240)).save(workspace.images / path.name, quality=95)
    return workspace


def frame(view: AnyView) -> dict[str, object]:
    """The view in OpenGL's axes, camera to world, with its own intrinsics."""
    camera = view.camera
    assert isinstance(camera, DistortedCamera)
    assert camera.model == "RADIAL"
    focal, cx, cy, k1, k2 = camera.params
    matrix = view.camera_from_model.inverse().matrix @ np.diag([1.0, -1.0, -1.0, 1.0])
    return {
        "file_path": f"images/{view.name}",
        "transform_matrix": matrix.tolist(),
        "fl_x": focal,
        "fl_y": focal,
        "cx": cx,
        "cy": cy,
        "k1": k1,
        "k2": k2,
        "w": camera.width,
        "h": camera.height,
    }


def check_given_cameras_get_points(
    settings: ReconstructionSettings, workspace: Workspace, given: tuple[AnyView, ...]
) -> None:
    names = sorted(path.name for path in workspace.images.iterdir())
    photographs = tuple(ImageRecord(name=name, normalised_name=name, sha256="") for name in names)
    images = ImagesRecord(folder=str(workspace.images), photographs=photographs, rejected=())
    warnings: list[Finding] = []
    monitor = Monitor(on_warning=warnings.append)
    manifest = find_cameras(workspace, Manifest(settings=settings, images=images), monitor=monitor)
    record = manifest.cameras
    assert record is not None
    assert record.registered == tuple(view.name for view in given)
    assert set(record.unregistered) == set(names) - set(record.registered)
    assert record.report is not None
    assert record.report["verdict"] == "accepted"
    assert warnings == []

    model = read_undistorted(workspace)
    for view, expected in zip(model.views, given, strict=True):
        np.testing.assert_allclose(view.centre, expected.centre, atol=1e-9)
    assert record.points == len(model.points) > 150
    assert model.points.colors.max() > 0
    assert np.median(model.point_errors_px) < 1.0
    seen = [
        (expected.camera_from_model.apply(model.points.xyz)[:, 2] > 0).mean() for expected in given
    ]  # what is triangulated lies before the cameras
    assert min(seen) > 0.99


@pytest.mark.system
def test_cameras_of_a_transforms_json_get_points(
    workspace: Workspace, given: tuple[AnyView, ...], tmp_path: Path
):
    file = tmp_path / "transforms.json"
    file.write_text(json.dumps({"frames": [frame(view) for view in given]}))
    check_given_cameras_get_points(ReconstructionSettings(transforms=str(file)), workspace, given)


@pytest.mark.slow  # 20 s; a transforms.json takes the same way
def test_cameras_of_a_colmap_model_without_points_get_them(
    workspace: Workspace, given: tuple[AnyView, ...], tmp_path: Path
):
    bare = Reconstruction.of_views(given)
    write_colmap(bare, tmp_path / "model")
    check_given_cameras_get_points(ReconstructionSettings(colmap=str(tmp_path / "model")), workspace, given)


def test_a_colmap_model_fits_photographs_that_were_resized_and_renamed(
    kermit_dir: Path, workspace: Workspace, kermit_sfm: SfmResult, tmp_path: Path
):
    """The model knows ``IMG 0.jpg`` of 640×480 px; ``images/`` holds ``IMG%200.jpg`` of 320×240 px."""
    views = kermit_sfm.reconstruction.views
    photographs = []
    for index, view in enumerate(views):
        with Image.open(kermit_dir / view.name) as image:
            image.convert("RGB").resize((320, 240)).save(workspace.images / f"IMG%20{index}.jpg")
        photographs.append(
            ImageRecord(name=f"IMG {index}.jpg", normalised_name=f"IMG%20{index}.jpg", sha256="")
        )
    renamed = tuple(replace(view, name=f"IMG {index}.jpg") for index, view in enumerate(views))
    write_colmap(replace(kermit_sfm.reconstruction, views=renamed), tmp_path / "model")
    settings = ReconstructionSettings(colmap=str(tmp_path / "model"))
    images = ImagesRecord(folder="", photographs=tuple(photographs), rejected=())
    monitor = Monitor(on_warning=lambda finding: pytest.fail(finding.code))
    find_cameras(workspace, Manifest(settings=settings, images=images), monitor=monitor)
    by_name = {view.name: view for view in read_undistorted(workspace).views}
    for index, view in enumerate(views):
        camera = by_name[f"IMG%20{index}.jpg"].camera
        assert camera.fx == pytest.approx(view.camera.fx / 2, rel=1e-3)


@pytest.mark.system
def test_a_photograph_that_kills_the_undistortion_is_left_out(
    workspace: Workspace, kermit_sfm: SfmResult, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    names = sorted(view.name for view in kermit_sfm.reconstruction.views)
    deadly = names[3]
    write_colmap(kermit_sfm.reconstruction, tmp_path / "model")
    photographs = tuple(ImageRecord(name=name, normalised_name=name, sha256="") for name in names)
    manifest = Manifest(
        settings=ReconstructionSettings(colmap=str(tmp_path / "model")),
        images=ImagesRecord(folder="", photographs=photographs, rejected=()),
    )
    run_here = undistort.run_native

    def run(request: UndistortImages, *rest: Any, **options: Any) -> Any:
        if deadly in request.names:
            raise ProcessDiedError("undistort", "signal SIGSEGV")
        return run_here(request, *rest, **options)

    monkeypatch.setattr(undistort, "run_native", run)
    warnings: list[Finding] = []
    cameras = find_cameras(workspace, manifest, monitor=Monitor(on_warning=warnings.append)).cameras
    assert cameras is not None
    assert cameras.unregistered == (deadly,)
    stage, how = "undistort", "signal SIGSEGV"
    assert warnings == [Finding.of(FindingCode.QUARANTINED, [deadly], stage=stage, how=how)]
    assert {path.name for path in workspace.undistorted_images.iterdir()} == set(names) - {deadly}
