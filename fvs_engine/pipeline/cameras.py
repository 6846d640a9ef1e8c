"""The cameras of a reconstruction: by structure from motion, or imported; pinhole in the end."""

import time
from collections.abc import Callable
from pathlib import Path

from fvs_engine.monitor import Monitor
from fvs_engine.pipeline.manifest import CameraSource, CamerasRecord, Manifest
from fvs_engine.pipeline.storage import blame_full_disk, storage_errors
from fvs_engine.pipeline.workspace import Workspace
from fvs_engine.sfm.imports import import_colmap, import_transforms_json, triangulate
from fvs_engine.sfm.reconstruct import SfmResult, reconstruct
from fvs_engine.sfm.settings import SfmSettings
from fvs_engine.sfm.undistort import undistort


def find_cameras(
    workspace: Workspace,
    manifest: Manifest,
    *,
    monitor: Monitor,
    warn: Callable[[str], None],
    threads: int | None = None,
) -> Manifest:
    """Place the normalised photographs, write the undistorted model, and remember both.

    Structure from motion goes on from what it finished in an earlier call. What it doubts is told to
    ``warn``. Raises ``ReconstructionError`` when the photographs support no model, ``InvalidInputError`` when
    imported cameras do not belong to them, ``StorageError`` when the folder cannot be written, ``Cancelled``.
    """
    began = time.monotonic()
    with storage_errors(workspace.sfm), blame_full_disk(workspace.root):
        source, found = _find(workspace, manifest, monitor, threads)
        model = undistort(found.model_dir, workspace.images, workspace.undistorted, monitor)
    for sentence in found.report.warnings:
        warn(sentence)
    names = {record.normalised_name for record in manifest.images.photographs}
    registered = tuple(sorted(view.name for view in model.views))
    record = CamerasRecord(
        source=source,
        registered=registered,
        unregistered=tuple(sorted(names.difference(registered))),
        points=len(model.points),
        seconds=time.monotonic() - began,
        report=found.report.model_dump(mode="json"),
    )
    manifest = manifest.model_copy(update={"cameras": record})
    workspace.write_manifest(manifest)
    return manifest


def _find(
    workspace: Workspace, manifest: Manifest, monitor: Monitor, threads: int | None
) -> tuple[CameraSource, SfmResult]:
    """Where the cameras come from, and the cameras."""
    settings = manifest.settings
    names = [record.normalised_name for record in manifest.images.photographs]
    sfm_settings = SfmSettings(seed=settings.seed, threads=threads)
    if settings.colmap is not None:
        imported = import_colmap(Path(settings.colmap), workspace.images, names, workspace.sfm, monitor)
        return "colmap", imported
    if settings.transforms is not None:
        cameras = import_transforms_json(Path(settings.transforms), workspace.images)
        return "transforms", triangulate(cameras, workspace.images, workspace.sfm, sfm_settings, monitor)
    return "photographs", reconstruct(workspace.images, names, workspace.sfm, sfm_settings, monitor)
