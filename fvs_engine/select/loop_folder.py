"""The folder of a selection, which survives a kill at any moment.

selection.json      settings, the dataset's fingerprint, the initial views, why it stopped
steps/0001.json …   one file per step: first the choice, after training the complete record
scene/              the scene

A choice is written before the model is trained on it: a resumed selection visits the same view and
does not score with a model that may already be trained on part of it.
"""

import hashlib
import re
from pathlib import Path
from typing import Literal

from fvs_engine.errors import StorageError
from fvs_engine.files.owned_folder import OwnedFolder, differences
from fvs_engine.files.record import read_record, write_record
from fvs_engine.files.storage import storage_errors
from fvs_engine.records import Record
from fvs_engine.scene.dataset import Dataset
from fvs_engine.select.loop_records import Choice, StepRecord, StopReason
from fvs_engine.select.loop_settings import LoopSettings
from fvs_schema.masks import find_mask

_STEP_FILE = re.compile(r"\d{4,}\.json")


class SelectionManifest(Record):
    """``selection.json``: the identity of the steps beside it. ``stop`` is None while views may be added."""

    version: Literal[1] = 1
    dataset: str
    fingerprint: str
    settings: LoopSettings
    initial: tuple[str, ...]
    stop: StopReason | None = None


class _StepFile(Record):
    """One step: ``record`` is None between the choice and the end of training on it."""

    choice: Choice
    record: StepRecord | None


class LoopFolder:
    """Reads and writes a selection's folder; raises ``StorageError`` when it cannot."""

    def __init__(self, root: Path) -> None:
        self.root = root

    @property
    def scene(self) -> Path:
        """The folder of the scene."""
        return self.root / "scene"

    @property
    def _owned(self) -> OwnedFolder[SelectionManifest]:
        return OwnedFolder(self.root, "selection.json", SelectionManifest, "selection")

    def open(self, manifest: SelectionManifest) -> SelectionManifest:
        """Create the folder for ``manifest``, or check that it holds this selection.

        The time limit and the number of threads may differ. Returns what is on disk. Raises
        ``OutputExistsError`` when it holds another selection or something else.
        """
        earlier = self.manifest()
        if earlier is None:
            self._owned.create(lambda name: name.startswith((".", "steps")))
            with storage_errors(self.root):
                (self.root / "steps").mkdir(exist_ok=True)
            self.write_manifest(manifest)
            return manifest
        found = differences(_lasting(earlier.settings), _lasting(manifest.settings))
        if earlier.fingerprint != manifest.fingerprint:
            found.append("the dataset's photographs, masks or poses differ")
        self._owned.require_same(found)
        return earlier

    def manifest(self) -> SelectionManifest | None:
        """The selection that the folder holds, None in a new folder; raises ``StorageError``."""
        return self._owned.read()

    def write_manifest(self, manifest: SelectionManifest) -> None:
        """Replace the manifest; atomic."""
        self._owned.write(manifest)

    def read_steps(self) -> tuple[list[StepRecord], Choice | None]:
        """The finished steps in order, and the choice of one that was not finished."""
        records: list[StepRecord] = []
        paths = sorted(path for path in (self.root / "steps").iterdir() if _STEP_FILE.fullmatch(path.name))
        for number, path in enumerate(paths, start=1):
            step = read_record(path, _StepFile)
            if step is None or step.choice.step != number or (step.record is None and number < len(paths)):
                raise StorageError(
                    f"{path.parent} is incomplete: step {number} is missing or unfinished.",
                    hint="Start again in another output folder.",
                    path=path.parent,
                )
            if step.record is None:
                return records, step.choice
            records.append(step.record)
        return records, None

    def write_step(self, choice: Choice, record: StepRecord | None) -> None:
        """Write a choice, and later the whole record of its step; atomic."""
        path = self.root / "steps" / f"{choice.step:04d}.json"
        write_record(path, _StepFile(choice=choice, record=record))


def fingerprint(dataset: Dataset) -> str:
    """Hash of a dataset: cameras, poses, masks, and the photographs by their sizes in bytes."""
    digest = hashlib.sha256()
    for view in dataset.views:
        size_bytes = (dataset.image_dir / view.name).stat().st_size
        digest.update(f"{view.name}\0{view.camera}\0{size_bytes}\0".encode())
        digest.update(view.camera_from_model.matrix.tobytes())
        if (mask := find_mask(dataset.image_dir, view.name)) is not None:
            digest.update(b"\0mask\0" + mask.read_bytes())
    return digest.hexdigest()


def _lasting(settings: LoopSettings) -> dict[str, object]:
    """The settings that a selection depends on."""
    return settings.model_dump(mode="json", exclude={"time_limit_s": True, "scene": {"sfm": {"threads"}}})
