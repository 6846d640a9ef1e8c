"""Cameras of a reconstruction: estimated by structure from motion or imported, then undistorted."""

import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from fvs_engine.errors import InvalidInputError
from fvs_engine.files.storage import blame_full_disk, storage_errors
from fvs_engine.images.names import match_names
from fvs_engine.monitor import Monitor
from fvs_engine.pipeline.manifest import CameraSource, CamerasRecord, Manifest, ReconstructionSettings
from fvs_engine.pipeline.workspace import Workspace
from fvs_engine.sfm.batch.reconstruct import reconstruct
from fvs_engine.sfm.batch.triangulate import triangulate
from fvs_engine.sfm.batch.undistort import undistort
from fvs_engine.sfm.colmap.imports import fit_cameras, import_colmap, import_transforms_json
from fvs_engine.sfm.colmap.model import write_colmap
from fvs_engine.sfm.native_process import end_child
from fvs_engine.sfm.pose_priors import ImageSet, PosePriors
from fvs_engine.sfm.quarantine import CulpritError
from fvs_engine.sfm.reconstruction import Reconstruction
from fvs_engine.sfm.report import SfmReport
from fvs_engine.sfm.settings import SfmSettings
from fvs_engine.sfm.stages import SfmFolder
from fvs_schema.findings import Finding

_MIN_VIEWS = 2


def find_cameras(
    workspace: Workspace,
    manifest: Manifest,
    *,
    monitor: Monitor,
    threads: int | None = None,
) -> Manifest:
    """Estimate or import the photographs' cameras, undistort them, and record both in the manifest.

    Structure from motion resumes an earlier call; the monitor gets its warnings. Raises
    ``ReconstructionError`` when the photographs support no model, ``InvalidInputError`` when imported cameras
    do not belong to them, ``StorageError`` when the folder cannot be written, ``Cancelled``.
    """
    began = time.monotonic()
    with storage_errors(workspace.sfm), blame_full_disk(workspace.root):
        source, model, report, warnings = _find_undistorted(workspace, manifest, monitor, threads)
    end_child()
    for finding in warnings:
        monitor.warn(finding)
    names = {record.normalised_name for record in manifest.images.photographs}
    registered = tuple(sorted(view.name for view in model.views))
    record = CamerasRecord(
        source=source,
        registered=registered,
        unregistered=tuple(sorted(names.difference(registered))),
        points=len(model.points),
        seconds=time.monotonic() - began,
        report=report.model_dump(mode="json") if report else None,
    )
    manifest = manifest.model_copy(update={"cameras": record})
    workspace.write_manifest(manifest)
    return manifest


def _find_undistorted(
    workspace: Workspace, manifest: Manifest, monitor: Monitor, threads: int | None
) -> tuple[CameraSource, Reconstruction, SfmReport | None, Sequence[Finding]]:
    """The source of the cameras, the undistorted model, the report on the cameras, and warnings.

    Images that crash the undistortion are quarantined, and the cameras are found without them.
    """
    quarantine = SfmFolder(workspace.sfm).quarantine
    while True:
        source, model_dir, report = _find(workspace, manifest, monitor, threads)
        try:
            model = undistort(model_dir, workspace.images, workspace.undistorted, monitor)
        except CulpritError as culprit:
            quarantine.add(culprit)
            continue
        left_out = tuple(quarantine.reasons.values())
        return source, model, report, left_out if report is None else report.warnings


def _find(
    workspace: Workspace, manifest: Manifest, monitor: Monitor, threads: int | None
) -> tuple[CameraSource, Path, SfmReport | None]:
    """The source of the cameras, the folder of their COLMAP model, and the report on them."""
    settings = _sfm_settings(manifest.settings, threads)
    names = [record.normalised_name for record in manifest.images.photographs]
    source: CameraSource
    if manifest.settings.colmap is not None:
        source, file = "colmap", Path(manifest.settings.colmap)
        # Images are found, and their sizes known, only by the photographs' own names.
        cameras = fit_cameras(_of_photographs(import_colmap(file), file, manifest), workspace.images)
        if len(cameras.points) > 0:
            model_dir = workspace.sfm / "sparse"
            quarantined = SfmFolder(workspace.sfm).quarantine.reasons
            usable = tuple(view for view in cameras.views if view.name not in quarantined)
            write_colmap(replace(cameras, views=usable), model_dir)
            return source, model_dir, None
        result = triangulate(cameras, workspace.images, workspace.sfm, settings, monitor)
    elif manifest.settings.transforms is not None:
        source, file = "transforms", Path(manifest.settings.transforms)
        cameras = _of_photographs(import_transforms_json(file), file, manifest)
        result = triangulate(cameras, workspace.images, workspace.sfm, settings, monitor)
    else:
        source = "photographs"
        priors = None if manifest.settings.gps else PosePriors()  # None: those in metadata
        images = ImageSet(workspace.images, names, priors)
        result = reconstruct(images, workspace.sfm, settings, monitor)
    return source, result.model_dir, result.report


def _sfm_settings(settings: ReconstructionSettings, threads: int | None) -> SfmSettings:
    return SfmSettings(
        seed=settings.seed,
        threads=threads,
        camera_model=settings.camera_model,
        intrinsics=settings.intrinsics,
    )


def _of_photographs(imported: Reconstruction, file: Path, manifest: Manifest) -> Reconstruction:
    """The views with a photograph in the folder, by the photographs' names in ``images/``."""
    photographs = manifest.images.photographs
    known = {record.normalised_name: record.normalised_name for record in photographs}
    known |= {record.name: record.normalised_name for record in photographs}
    matches = match_names([view.name for view in imported.views], known)
    matches.require_unambiguous()
    names = matches.found
    views = [replace(view, name=names[view.name]) for view in imported.views if view.name in names]
    if len(views) < _MIN_VIEWS:
        raise InvalidInputError(
            f"Of the {len(imported.views)} images of {file}, {len(views)} are in {manifest.images.folder} "
            f"(its first is {imported.views[0].name}, the folder's {photographs[0].name}).",
            hint="Give the folder of photographs that these cameras were computed from.",
            path=file,
        )
    return replace(imported, views=tuple(sorted(views, key=lambda view: view.name)))
