"""The cameras of a reconstruction: by structure from motion, or imported; pinhole in the end."""

import time
from collections.abc import Callable

from fvs_engine.monitor import Monitor
from fvs_engine.pipeline.manifest import CamerasRecord, Manifest
from fvs_engine.pipeline.storage import blame_full_disk, storage_errors
from fvs_engine.pipeline.workspace import Workspace
from fvs_engine.sfm.reconstruct import reconstruct
from fvs_engine.sfm.settings import SfmSettings
from fvs_engine.sfm.undistort import undistort


def find_cameras(
    workspace: Workspace, manifest: Manifest, *, monitor: Monitor, warn: Callable[[str], None]
) -> Manifest:
    began = time.monotonic()
    names = [record.normalised_name for record in manifest.images.photographs]
    with storage_errors(workspace.sfm), blame_full_disk(workspace.root):
        result = reconstruct(workspace.images, names, workspace.sfm, SfmSettings(), monitor)
        report = result.report
        undistort(workspace.sfm / "sparse", workspace.images, workspace.undistorted, monitor)
    registered = tuple(sorted(view.name for view in result.reconstruction.views))
    record = CamerasRecord(
        source="photographs",
        registered=registered,
        unregistered=tuple(sorted(set(names) - set(registered))),
        points=len(result.reconstruction.points),
        seconds=time.monotonic() - began,
        report=report,
    )
    if record.unregistered:
        warn("not registered " + ", ".join(record.unregistered))
    manifest = manifest.model_copy(update={"cameras": record})
    workspace.write_manifest(manifest)
    return manifest
