"""The output folder of a reconstruction: its paths, lock and manifest.

manifest.json                  settings, photographs, cameras, training so far
images/                        the photographs, upright, 8-bit
masks/                         their masks, as COLMAP names them: black is left out
sfm/                           features, matches and the COLMAP model of the photographs
undistorted/                   images/, masks/, sparse/: pinhole cameras, opened by COLMAP and splat viewers
splat/checkpoint.safetensors   training resumes from here
splat/point_cloud.ply          the Gaussians, in the layout that splat viewers read
splat/point_cloud.spz          the same, compressed and rounded
metrics.json                   quality on held-out views, and what the training cost
renders/                       held-out views as the model renders them
ranking/                       ranking.json and contact_sheet.png of the last `fvs rank`
plan/                          plan.json and plan.png of the last `fvs plan`
control.json                   the alignment of the last `fvs align`, and the residual of every point
export/                        files of the last `fvs export` for other programs
"""

import contextlib
import re
import shutil
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from fvs_engine.errors import InvalidInputError
from fvs_engine.files.folders import require_folder
from fvs_engine.files.lock import locked_folder
from fvs_engine.files.owned_folder import OwnedFolder
from fvs_engine.files.record import read_record, write_record
from fvs_engine.files.storage import storage_errors
from fvs_engine.images.metadata import PhotographPriors, read_priors
from fvs_engine.pipeline.manifest import Manifest, Metrics

_OWN_ENTRIES = frozenset(
    {
        "manifest.json",
        "metrics.json",
        "images",
        "masks",
        "sfm",
        "undistorted",
        "splat",
        "renders",
        "ranking",
        "plan",
        "control.json",
        "export",
        ".lock",
    }
    | {"undistorted.log", ".undistorted.partial"}
)
_BEFORE_MANIFEST = re.compile(r"\.lock$|\.manifest\.json\.\d+\.partial$")
"""Entries that a run leaves when it is killed before it writes the manifest."""


@dataclass(frozen=True)
class Workspace:
    """The paths inside an output folder, and its manifest."""

    root: Path

    @property
    def manifest_path(self) -> Path:
        """The folder's manifest."""
        return self.root / "manifest.json"

    @property
    def _owned(self) -> OwnedFolder[Manifest]:
        remedy = "Choose another output folder, or start again with --overwrite."
        return OwnedFolder(self.root, self.manifest_path.name, Manifest, "reconstruction", remedy)

    @property
    def images(self) -> Path:
        """Normalised photographs."""
        return self.root / "images"

    def read_priors(self, name: str) -> PhotographPriors:
        """The pose priors in the photograph of a normalised name; raises ``StorageError``."""
        file = self.images / name
        with storage_errors(file), file.open("rb") as content:
            return read_priors(content)

    @property
    def sfm(self) -> Path:
        """The files of structure from motion."""
        return self.root / "sfm"

    @property
    def undistorted(self) -> Path:
        """Pinhole cameras and their images."""
        return self.root / "undistorted"

    @property
    def undistorted_images(self) -> Path:
        """The images of the pinhole cameras."""
        return self.undistorted / "images"

    @property
    def checkpoint(self) -> Path:
        """The training state."""
        return self.root / "splat" / "checkpoint.safetensors"

    @property
    def point_cloud(self) -> Path:
        """The Gaussians of the last checkpoint."""
        return self.root / "splat" / "point_cloud.ply"

    @property
    def metrics_path(self) -> Path:
        """Quality on held-out views."""
        return self.root / "metrics.json"

    @property
    def renders(self) -> Path:
        """Rendered views."""
        return self.root / "renders"

    @property
    def ranking(self) -> Path:
        """The last ranking."""
        return self.root / "ranking"

    @property
    def plan(self) -> Path:
        """The last plan."""
        return self.root / "plan"

    @property
    def control(self) -> Path:
        """The alignment by control points."""
        return self.root / "control.json"

    @property
    def export(self) -> Path:
        """The last exported files."""
        return self.root / "export"

    @staticmethod
    def existing(root: Path) -> "Workspace":
        """The workspace at ``root``; raises ``InvalidInputError`` when there is none."""
        workspace, hint = Workspace(root), "Run `fvs reconstruct IMAGES --out DIR` first and give its DIR."
        require_folder(root, hint)
        if not workspace.manifest_path.is_file():
            raise InvalidInputError(
                f"{root} is not the output of a reconstruction: it has no manifest.json.",
                hint=hint,
                path=root,
            )
        return workspace

    @contextlib.contextmanager
    def locked(self) -> Iterator[None]:
        """Create the folder if need be and keep other writers out.

        Raises ``OutputExistsError`` when the folder holds something else or another process writes to
        it, ``StorageError`` when it cannot be created or its file system knows no locks.
        """
        # Without a manifest, entries with our names are foreign, too: `images` may be the user's photographs.
        self._owned.create(lambda name: _BEFORE_MANIFEST.match(name) is not None)
        with locked_folder(self.root):
            yield

    def read_manifest(self) -> Manifest | None:
        """The manifest, None in a new folder; raises ``StorageError`` when it cannot be used."""
        return self._owned.read()

    def write_manifest(self, manifest: Manifest) -> None:
        """Replace the manifest; atomic."""
        self._owned.write(manifest)

    def read_metrics(self) -> Metrics | None:
        """The metrics of finished training, None before."""
        remedy = "Delete it and run the same `fvs reconstruct` again: the model is then evaluated again."
        return read_record(self.metrics_path, Metrics, remedy)

    def write_metrics(self, metrics: Metrics) -> None:
        """Write ``metrics.json``; atomic."""
        write_record(self.metrics_path, metrics)

    def clear(self) -> None:
        """Delete what fvs wrote here, and nothing else; the lock file stays."""
        with storage_errors(self.root):
            # The manifest goes last: a folder without one is not accepted as an output folder.
            for name in sorted(_OWN_ENTRIES - {".lock"}, key=lambda name: name == "manifest.json"):
                entry = self.root / name
                if entry.is_dir() and not entry.is_symlink():
                    shutil.rmtree(entry)
                else:
                    entry.unlink(missing_ok=True)
