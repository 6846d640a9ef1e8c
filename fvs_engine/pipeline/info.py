"""Description of an output folder."""

import stat
from pathlib import Path

from fvs_engine.errors import StorageError
from fvs_engine.pipeline.manifest import Manifest, Metrics
from fvs_engine.pipeline.workspace import Workspace
from fvs_engine.records import Record
from fvs_engine.sfm.stages import SfmFolder


class FolderInfo(Record):
    """The manifest, the metrics once training is finished, and the size on disk."""

    folder: str
    stage: str
    manifest: Manifest
    metrics: Metrics | None
    disk_bytes: int


def folder_info(root: Path) -> FolderInfo:
    """Describe the output folder ``root``; raises ``InvalidInputError`` when it is not one."""
    workspace = Workspace.existing(root)
    manifest = workspace.read_manifest()
    if manifest is None:
        raise StorageError(f"{workspace.manifest_path} has just been deleted.", path=workspace.manifest_path)
    metrics = workspace.read_metrics()
    if manifest.cameras is None and SfmFolder(workspace.sfm).rejected.is_file():
        stage = (
            "structure from motion has rejected every model: other settings or more photographs are needed"
        )
    elif manifest.cameras is None:
        stage = "structure from motion is not finished"
    elif manifest.training is None:
        stage = "training has not begun"
    elif metrics is None or metrics.iterations < manifest.training.target_iterations:
        stage = "training is not finished"
    else:
        stage = "finished"
    return FolderInfo(
        folder=str(root),
        stage=stage,
        manifest=manifest,
        metrics=metrics,
        disk_bytes=sum(map(_size_bytes, root.rglob("*"))),
    )


def _size_bytes(path: Path) -> int:
    """Bytes of a file; 0 for anything else, and for a file that training has just renamed."""
    try:
        status = path.lstat()
    except FileNotFoundError:
        return 0
    return status.st_size if stat.S_ISREG(status.st_mode) else 0
