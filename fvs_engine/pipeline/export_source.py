"""What can be exported: the model of an output folder, or a snapshot downloaded from the service."""

import contextlib
import tempfile
import zipfile
import zlib
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TypeVar

from pydantic import ValidationError

from fvs_engine.errors import InvalidInputError
from fvs_engine.export.placement import Placement
from fvs_engine.images.masks import Mask, read_mask
from fvs_engine.monitor import Monitor
from fvs_engine.pipeline.model import full_size_views, open_model, read_undistorted
from fvs_engine.pipeline.placement import place, require_place
from fvs_engine.pipeline.workspace import Workspace
from fvs_engine.records import first_error
from fvs_engine.sfm.colmap.model import MODEL_FILES, read_colmap
from fvs_engine.sfm.reconstruction import PointCloud
from fvs_engine.snapshot_cameras import model_from_cameras, usual_camera
from fvs_engine.splat.floaters import without_floaters
from fvs_engine.splat.gaussians import Gaussians
from fvs_engine.splat.ply import read_ply
from fvs_engine.splat.raster import create_rasterizer
from fvs_engine.views import PinholeView
from fvs_schema.artifacts import ALIGNMENT, CAMERAS, COLMAP, COLMAP_FOLDER, GAUSSIANS
from fvs_schema.masks import find_mask
from fvs_schema.snapshots import SnapshotAlignment, SnapshotCameras

_Artifact = TypeVar("_Artifact", SnapshotAlignment, SnapshotCameras)


@dataclass(frozen=True, eq=False)
class ExportSource:
    """A model in its own frame: Gaussians, views and sparse points, and the folder of its COLMAP model.

    ``trained`` are the views that the Gaussians were trained on, ``read_masks`` reads the masks of those that
    have one, by name. ``place`` finds where it is on Earth, or raises ``InvalidInputError``.
    """

    gaussians: Gaussians
    views: tuple[PinholeView, ...]
    trained: tuple[PinholeView, ...]
    points: PointCloud
    colmap: Path
    place: Callable[[], Placement]
    read_masks: Callable[[], Mapping[str, Mask]] = dict

    def without_floaters(self, monitor: Monitor) -> "ExportSource":
        """The same without floaters; raises ``Cancelled``."""
        rasterizer = create_rasterizer("cpu", monitor)
        kept = without_floaters(
            self.gaussians, self.trained, self.points.xyz, rasterizer, monitor, self.read_masks()
        )
        return replace(self, gaussians=kept)


@contextlib.contextmanager
def opened(root: Path) -> Iterator[ExportSource]:
    """The model in ``root``: an output folder, or one with the artifacts of a snapshot.

    Raises what ``open_model`` raises, and ``InvalidInputError`` when an artifact is missing or damaged.
    """
    if Workspace(root).manifest_path.is_file() or not (root / ALIGNMENT).is_file():
        model = open_model(root)
        undistorted = read_undistorted(model.workspace)
        views, colmap = full_size_views(undistorted), model.workspace.undistorted / "sparse"
        yield ExportSource(
            model.gaussians,
            views,
            model.views,
            undistorted.points,
            colmap,
            partial(place, model),
            partial(_masks, model.workspace.undistorted_images, model.views),
        )
        return
    with tempfile.TemporaryDirectory(prefix="fvs-export-") as folder:
        _unpack(root / COLMAP, Path(folder))
        alignment = _read(root / ALIGNMENT, SnapshotAlignment)
        views = _views(_read(root / CAMERAS, SnapshotCameras))
        yield ExportSource(
            read_ply(root / GAUSSIANS),
            views,
            views,
            read_colmap(Path(folder)).points,
            Path(folder),
            partial(require_place, alignment.origin, alignment, root),
        )


def _masks(images: Path, views: Iterable[PinholeView]) -> Mapping[str, Mask]:
    """The masks, each a file beside the undistorted images."""
    masked = [view.name for view in views if find_mask(images, view.name) is not None]
    read = {name: read_mask(images, name) for name in masked}
    return {name: mask for name, mask in read.items() if mask is not None}


def _unpack(file: Path, folder: Path) -> None:
    try:
        with zipfile.ZipFile(file) as archive:
            for name in MODEL_FILES:
                (folder / f"{name}.bin").write_bytes(archive.read(f"{COLMAP_FOLDER}/{name}.bin"))
    except (OSError, KeyError, zipfile.BadZipFile, zlib.error) as error:
        raise _unusable(file, str(error)) from error


def _read(file: Path, kind: type[_Artifact]) -> _Artifact:
    try:
        return kind.model_validate_json(file.read_bytes())
    except OSError as error:
        raise _unusable(file, str(error.strerror)) from error
    except ValidationError as error:
        raise _unusable(file, first_error(error)) from error


def _views(cameras: SnapshotCameras) -> tuple[PinholeView, ...]:
    """The images by their senders' names, all with the camera of most of them."""
    camera = usual_camera(cameras)
    return tuple(
        PinholeView(view.name, camera, model_from_camera.inverse())
        for view, model_from_camera in zip(cameras.views, model_from_cameras(cameras), strict=True)
    )


def _unusable(file: Path, why: str) -> InvalidInputError:
    return InvalidInputError(
        f"{file} cannot be used: {why}.", hint="Download the artifacts of the snapshot again.", path=file
    )
