"""An image on which a stage dies is found and left out, whatever the stage."""

import shutil
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fvs_engine.errors import ProcessDiedError
from fvs_engine.monitor import Monitor
from fvs_engine.sfm import stages
from fvs_engine.sfm.batch import undistort as undistortion
from fvs_engine.sfm.batch.reconstruct import SfmResult, reconstruct
from fvs_engine.sfm.batch.triangulate import triangulate
from fvs_engine.sfm.batch.undistort import undistort
from fvs_engine.sfm.colmap.model import open_colmap
from fvs_engine.sfm.colmap.transforms_json import import_transforms_json
from fvs_engine.sfm.growing.reconstruction import GrowingReconstruction
from fvs_engine.sfm.jobs import (
    CalibrateViewGraph,
    LocaliseImages,
    Request,
    TriangulatePoints,
    UndistortImages,
)
from fvs_engine.sfm.pose_priors import ImageSet
from fvs_engine.sfm.quarantine import CulpritError
from fvs_engine.sfm.settings import SfmSettings
from fvs_schema.findings import FindingCode

pytestmark = [pytest.mark.process, pytest.mark.slow, pytest.mark.usefixtures("all_native_here")]
SETTINGS = SfmSettings(threads=1)
NAMES = [f"{i:04d}.jpg" for i in range(5)]
DEADLY = NAMES[2]


@pytest.fixture(scope="module")
def images(yard_dir: Path) -> Path:
    return yard_dir / "images"


@pytest.fixture(scope="module")
def found(
    images: Path,
    tmp_path_factory: pytest.TempPathFactory,
    all_native_here: None,  # noqa: ARG001
) -> SfmResult:
    return reconstruct(ImageSet(images, NAMES), tmp_path_factory.mktemp("found") / "sfm", SETTINGS, Monitor())


@pytest.fixture
def dying(monkeypatch: pytest.MonkeyPatch) -> Callable[..., list[Sequence[str]]]:
    """Make a job die whenever it gets an image; returns the images of its runs."""

    def make(deadly_job: str, image: str = DEADLY) -> list[Sequence[str]]:
        runs: list[Sequence[str]] = []
        run_here = stages.run_native

        def run(request: Request[Any], *rest: Any, **options: Any) -> Any:
            if request.job == deadly_job:
                runs.append(_images_of(request))
                if image in runs[-1]:
                    raise ProcessDiedError(deadly_job, "signal SIGSEGV")
            return run_here(request, *rest, **options)

        monkeypatch.setattr(stages, "run_native", run)
        monkeypatch.setattr(undistortion, "run_native", run)
        return runs

    return make


def _images_of(request: Request[Any]) -> Sequence[str]:
    match request:
        case TriangulatePoints():
            return [image.name for image in open_colmap(request.model_dir).images.values()]
        case LocaliseImages():
            return list(request.neighbours)
        case CalibrateViewGraph() | UndistortImages():
            return list(request.names)
    raise AssertionError(request)


def _quarantined(result: SfmResult) -> set[tuple[str, ...]]:
    """The images of each finding about a quarantined one."""
    warnings = result.report.warnings
    return {warning.images for warning in warnings if warning.code is FindingCode.QUARANTINED}


def test_calibration(images: Path, found: SfmResult, tmp_path: Path, dying: Any) -> None:
    shutil.copytree(found.model_dir.parent, tmp_path / "sfm")
    (tmp_path / "sfm" / "report.json").unlink()
    runs = dying("calibrate")
    global_first = SETTINGS.model_copy(update={"incremental_first_up_to": 0})
    result = reconstruct(ImageSet(images, NAMES), tmp_path / "sfm", global_first, Monitor())
    assert {view.name for view in result.reconstruction.views} == set(NAMES) - {DEADLY}
    assert _quarantined(result) == {(DEADLY,)}
    assert [DEADLY] in runs


def test_triangulation(yard_dir: Path, tmp_path: Path, dying: Any) -> None:
    cameras = import_transforms_json(yard_dir / "transforms.json")
    given = type(cameras).of_views(tuple(view for view in cameras.views if Path(view.name).name in NAMES))
    runs = dying("triangulate")
    result = triangulate(given, yard_dir / "images", tmp_path / "sfm", SETTINGS, Monitor())
    assert {view.name for view in result.reconstruction.views} == set(NAMES) - {DEADLY}
    assert _quarantined(result) == {(DEADLY,)}
    assert [DEADLY] in runs


def test_undistortion(images: Path, found: SfmResult, tmp_path: Path, dying: Any) -> None:
    whole = undistort(found.model_dir, images, tmp_path / "whole", Monitor())
    assert {view.name for view in whole.views} == set(NAMES)
    assert {path.name for path in (tmp_path / "whole" / "images").iterdir()} == set(NAMES)
    runs = dying("undistort")
    with pytest.raises(CulpritError) as error:
        undistort(found.model_dir, images, tmp_path / "dead", Monitor())
    assert error.value.name == DEADLY
    assert [DEADLY] in runs
    assert not (tmp_path / "dead").exists()


def test_localisation(images: Path, tmp_path: Path, dying: Any) -> None:
    folder = shutil.copytree(images, tmp_path / "images")
    deadly, innocent = "0009-deadly.jpg", NAMES[4]
    shutil.copyfile(folder / innocent, folder / deadly)
    growing = GrowingReconstruction.open(tmp_path / "growing", folder, SETTINGS, Monitor())
    growing.add(NAMES[:4], Monitor())
    before = growing.reconstruction
    runs = dying("localise", deadly)
    localised = growing.localise([NAMES[0], deadly, innocent], Monitor())
    assert set(localised) == {NAMES[0], innocent}
    assert [deadly] in runs
    runs.clear()
    assert growing.localise([deadly], Monitor()) == {}
    assert runs == []  # it is not even tried
    for view, same in zip(growing.reconstruction.views, before.views, strict=True):
        np.testing.assert_array_equal(view.camera_from_model.matrix, same.camera_from_model.matrix)
