"""Cameras of a reconstruction: estimated by structure from motion or imported, then undistorted."""

import time
from dataclasses import dataclass, replace
from pathlib import Path

from fvs_engine.errors import InvalidInputError
from fvs_engine.files.storage import blame_full_disk, storage_errors
from fvs_engine.images.names import match_names
from fvs_engine.monitor import Monitor
from fvs_engine.pipeline.manifest import CamerasRecord, ImagesRecord, Manifest, ReconstructionSettings
from fvs_engine.pipeline.workspace import Workspace
from fvs_engine.sfm.batch.reconstruct import reconstruct
from fvs_engine.sfm.batch.triangulate import triangulate
from fvs_engine.sfm.batch.undistort import undistort
from fvs_engine.sfm.colmap.imports import import_colmap
from fvs_engine.sfm.colmap.transforms_json import import_transforms_json
from fvs_engine.sfm.native_process import end_child
from fvs_engine.sfm.pose_priors import ImageSet, PosePriors
from fvs_engine.sfm.quarantine import CulpritError
from fvs_engine.sfm.reconstruction import Reconstruction
from fvs_engine.sfm.report import SfmReport
from fvs_engine.sfm.settings import SfmSettings
from fvs_engine.sfm.stages import SfmFolder
from fvs_schema.findings import Finding, FindingCode, Severity

_MIN_VIEWS = 2


@dataclass(frozen=True, eq=False)
class GivenCameras:
    """Imported cameras, and what was found about them."""

    cameras: Reconstruction
    findings: tuple[Finding, ...]


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
    given = import_given(manifest.settings, manifest.images)
    with storage_errors(workspace.sfm), blame_full_disk(workspace.root):
        model, report = _find_undistorted(workspace, manifest, given, monitor, threads)
    end_child()
    origin = (0.0, 0.0, 0.0) if given is None else given.cameras.origin
    for finding in (*(given.findings if given else ()), *report.warnings):
        monitor.warn(finding)
    names = {record.normalised_name for record in manifest.images.photographs}
    registered = tuple(sorted(view.name for view in model.views))
    record = CamerasRecord(
        source=manifest.settings.camera_source,
        origin=tuple(origin),
        registered=registered,
        unregistered=tuple(sorted(names.difference(registered))),
        points=len(model.points),
        seconds=time.monotonic() - began,
        report=report.model_dump(mode="json"),
    )
    manifest = manifest.model_copy(update={"cameras": record})
    workspace.write_manifest(manifest)
    return manifest


def import_given(settings: ReconstructionSettings, images: ImagesRecord) -> GivenCameras | None:
    """The imported cameras of the photographs, by these photographs' names in ``images/``; None without any.

    Raises ``InvalidInputError`` when they cannot be read or do not belong to the photographs,
    ``StorageError`` when the model is damaged.
    """
    if settings.colmap is not None:
        return _of_photographs(import_colmap(Path(settings.colmap)), Path(settings.colmap), images)
    if settings.transforms is not None:
        file = Path(settings.transforms)
        return _of_photographs(import_transforms_json(file, Path(images.folder)), file, images)
    return None


def _find_undistorted(
    workspace: Workspace,
    manifest: Manifest,
    given: GivenCameras | None,
    monitor: Monitor,
    threads: int | None,
) -> tuple[Reconstruction, SfmReport]:
    """The undistorted model, and the report on the cameras.

    Images that crash the undistortion are quarantined, and the cameras are found without them.
    """
    quarantine = SfmFolder(workspace.sfm).quarantine
    settings = _sfm_settings(manifest.settings, threads)
    while True:
        if given is None:
            names = [record.normalised_name for record in manifest.images.photographs]
            priors = None if manifest.settings.gps else PosePriors()  # None: those in metadata
            images = ImageSet(workspace.images, names, priors)
            result = reconstruct(images, workspace.sfm, settings, monitor)
        else:
            result = triangulate(given.cameras, workspace.images, workspace.sfm, settings, monitor)
        try:
            model = undistort(result.model_dir, workspace.images, workspace.undistorted, monitor)
        except CulpritError as culprit:
            quarantine.add(culprit)
            continue
        return model, result.report


def _sfm_settings(settings: ReconstructionSettings, threads: int | None) -> SfmSettings:
    return SfmSettings(
        seed=settings.seed,
        threads=threads,
        camera_model=settings.camera_model,
        intrinsics=settings.intrinsics,
    )


def _of_photographs(imported: Reconstruction, file: Path, images: ImagesRecord) -> GivenCameras:
    """The views with a photograph in the folder, by the photographs' names in ``images/``."""
    photographs = images.photographs
    known = {record.normalised_name: record.normalised_name for record in photographs}
    known |= {record.name: record.normalised_name for record in photographs}
    matches = match_names([view.name for view in imported.views], known)
    matches.require_unambiguous()
    names = matches.found
    views = [replace(view, name=names[view.name]) for view in imported.views if view.name in names]
    if len(views) < _MIN_VIEWS:
        raise InvalidInputError(
            f"Of the {len(imported.views)} images of {file}, {len(views)} are in {images.folder} "
            f"(its first is {imported.views[0].name}, the folder's {photographs[0].name}).",
            hint="Give the folder of photographs that these cameras were computed from.",
            path=file,
        )
    cameras = replace(imported, views=tuple(sorted(views, key=lambda view: view.name)))
    findings = list(matches.findings())
    if imported.origin.any():
        x, y, z = imported.origin.tolist()
        findings.append(Finding.of(FindingCode.FAR_COORDINATES, severity=Severity.NOTE, x=x, y=y, z=z))
    return GivenCameras(cameras, tuple(findings))
