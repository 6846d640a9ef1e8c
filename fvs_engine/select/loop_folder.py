"""What a selection keeps on disk, so that a kill at any moment costs only the work of that moment.

selection.json      settings, the dataset's fingerprint, the initial views, why it stopped
steps/0001.json …   one file per step: first the choice, and once it was learned the whole record
scene/              the growing scene

A choice is written before anything learns from it: whoever resumes visits the same view instead of asking a
model that may have seen part of it already.
"""

import hashlib
import re
from pathlib import Path
from typing import Literal, TypeVar

from pydantic import BaseModel, ValidationError

from fvs_engine.errors import OutputExistsError, StorageError
from fvs_engine.files.atomic import write_text_atomically
from fvs_engine.scene.dataset import Dataset
from fvs_engine.select.loop_records import Choice, Record, StepRecord, StopReason
from fvs_engine.select.loop_settings import LoopSettings

_Model = TypeVar("_Model", bound=BaseModel)
_STEP_FILE = re.compile(r"\d{4,}\.json")


class SelectionManifest(Record):
    """``selection.json``: what the steps beside it belong to. ``stop`` is None while views may be added."""

    version: Literal[1] = 1
    dataset: str
    fingerprint: str
    settings: LoopSettings
    initial: tuple[str, ...]
    stop: StopReason | None = None


class _StepFile(Record):
    """One step: ``record`` is None between the choice and the end of what was learned from it."""

    choice: Choice
    record: StepRecord | None


class LoopFolder:
    """Reads and writes a selection's folder; raises ``StorageError`` when it cannot."""

    def __init__(self, root: Path) -> None:
        self.root = root

    @property
    def scene(self) -> Path:
        """Where the growing scene lives."""
        return self.root / "scene"

    @property
    def manifest_path(self) -> Path:
        """The selection's memory."""
        return self.root / "selection.json"

    def open(self, manifest: SelectionManifest) -> SelectionManifest:
        """Create the folder for ``manifest``, or check that it holds just this selection.

        What may differ is the time limit and the number of threads. Returns what is on disk. Raises
        ``OutputExistsError`` when it holds another selection or something that is none.
        """
        try:
            self.root.mkdir(parents=True, exist_ok=True)
            if not self.manifest_path.exists():
                self._require_empty()
                (self.root / "steps").mkdir(exist_ok=True)
                self.write_manifest(manifest)
                return manifest
        except OSError as error:
            raise StorageError(
                f"{self.root} cannot be used: {error.strerror or error}.",
                hint="Choose an output folder that you may write to.",
            ) from error
        earlier = self._read(self.manifest_path, SelectionManifest)
        differences = list(_differences(earlier, manifest))
        if differences:
            raise OutputExistsError(
                f"{self.root} holds another selection: {'; '.join(differences)}.",
                hint="Give another output folder, or the settings of the one that is there.",
            )
        return earlier

    def write_manifest(self, manifest: SelectionManifest) -> None:
        """Remember; atomic."""
        write_text_atomically(self.manifest_path, manifest.model_dump_json(indent=1) + "\n")

    def read_steps(self) -> tuple[list[StepRecord], Choice | None]:
        """The finished steps in order, and the choice of one that was not finished."""
        records: list[StepRecord] = []
        paths = sorted(path for path in (self.root / "steps").iterdir() if _STEP_FILE.fullmatch(path.name))
        for number, path in enumerate(paths, start=1):
            step = self._read(path, _StepFile)
            if step.choice.step != number or (step.record is None and number < len(paths)):
                raise StorageError(
                    f"{path.parent} is incomplete: step {number} is missing or unfinished.",
                    hint="Start again in another output folder.",
                )
            if step.record is None:
                return records, step.choice
            records.append(step.record)
        return records, None

    def write_step(self, choice: Choice, record: StepRecord | None) -> None:
        """Remember a choice, and later what became of it; atomic."""
        path = self.root / "steps" / f"{choice.step:04d}.json"
        write_text_atomically(path, _StepFile(choice=choice, record=record).model_dump_json(indent=1) + "\n")

    def _require_empty(self) -> None:
        foreign = sorted(
            entry.name for entry in self.root.iterdir() if not entry.name.startswith((".", "steps"))
        )
        if foreign:
            raise OutputExistsError(
                f"{self.root} is not empty and holds no selection (it holds {foreign[0]}).",
                hint="Choose another output folder; nothing was changed.",
            )

    def _read(self, path: Path, model: type[_Model]) -> _Model:
        try:
            return model.model_validate_json(path.read_bytes())
        except OSError as error:
            raise StorageError(f"{path} cannot be read: {error.strerror}.") from error
        except ValidationError as error:
            first = error.errors()[0]
            where = ".".join(str(part) for part in first["loc"]) or "the file"
            raise StorageError(
                f"{path} cannot be used: {where}: {first['msg']}.",
                hint="It is damaged or of another version of fvs: choose another output folder.",
            ) from error


def fingerprint(dataset: Dataset) -> str:
    """A hash of everything about a dataset that a selection depends on, its photographs by their sizes."""
    digest = hashlib.sha256()
    for view in dataset.views:
        size_bytes = (dataset.image_dir / view.name).stat().st_size
        digest.update(f"{view.name}\0{view.camera}\0{size_bytes}\0".encode())
        digest.update(view.camera_from_model.matrix.tobytes())
    return digest.hexdigest()


def _differences(earlier: SelectionManifest, given: SelectionManifest) -> list[str]:
    """What makes two selections different, in words."""
    old, new = _lasting(earlier.settings), _lasting(given.settings)
    found = [f"{name} was {old[name]} and is {new[name]}" for name in new if old.get(name) != new[name]]
    if earlier.fingerprint != given.fingerprint:
        found.append("the dataset's photographs or poses are others")
    return found


def _lasting(settings: LoopSettings) -> dict[str, object]:
    """The settings that a selection depends on, the scene's and its parts' by their dotted names."""
    plain: dict[str, object] = {}

    def flatten(prefix: str, value: object) -> None:
        if isinstance(value, dict):
            for name, part in value.items():
                flatten(f"{prefix}{name}.", part)
        else:
            plain[prefix.removesuffix(".")] = value

    flatten(
        "", settings.model_dump(mode="json", exclude={"time_limit_s": True, "scene": {"sfm": {"threads"}}})
    )
    return plain
