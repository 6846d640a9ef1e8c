"""State of a growing reconstruction on disk, and its commit.

The folder holds ``sfm`` (database and bootstrap, as ``reconstruct`` keeps them), ``model-<generation>`` (the
current COLMAP model; its name appears when it is complete), ``words.npz`` (the visual vocabulary),
``localise`` (features of images that are no part of the model) and ``growth.json``. Replacing the last is the
commit: after a kill before it the former model is the current one, whatever else was written.
"""

import hashlib
import json
import shutil
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

from PIL import Image
from pydantic import Field

from fvs_engine.errors import InvalidInputError
from fvs_engine.files.atomic import replace_folder
from fvs_engine.files.record import read_record, write_record
from fvs_engine.records import Record
from fvs_engine.sfm.settings import SfmSettings
from fvs_engine.sfm.stages import SfmFolder
from fvs_schema.findings import Finding, FindingCode


class GrowthState(Record):
    """Added and registered images, and the sizes that decide when bundle adjustment and re-maps are due."""

    version: Literal[1] = 1
    settings: str
    """Digest of the settings, apart from the number of threads."""

    images: dict[str, int] = Field(default={})
    """Added images, but removed and quarantined ones → the file's size in bytes, in the order of adding."""

    pending: tuple[str, ...] = ()
    """Added, and not yet processed by a complete update."""

    registered: tuple[str, ...] = ()
    """In the order of registration."""

    rejected: dict[str, Finding] = Field(default={})
    """Unregistered images whose estimated pose is uncertain, or contradicted by matches or prior → why."""

    tried: dict[str, str] = Field(default={})
    """Unregistered images → digest of their ``RegistrationInputs`` when their matches were last tried."""

    tried_guided: dict[str, str] = Field(default={})
    """The same for matches that their pose priors guide; the image tried last is the last."""

    priors_ignored: tuple[Finding, ...] = ()
    """Warnings of the last update about unused pose priors, which the next one does not repeat."""

    unreported: tuple[Finding, ...] = ()
    """Warnings that the caller has not acknowledged: it may have been killed before it got them."""

    generation: int = 0
    bootstrap_images: int = 0
    """Number of the first images, from which the vocabulary was computed."""

    adjusted_images: int = 0
    adjusted_points: int = 0
    """The model's size at the last global bundle adjustment."""

    mapped_images: int = 0
    """Number of added images at the last re-map, whether its model was chosen or not."""

    mapped_support: float = 0.0
    """Match support of the model that this re-map chose."""

    @property
    def unregistered(self) -> tuple[str, ...]:
        """Added images without a pose, in the order of adding."""
        registered = set(self.registered)
        return tuple(name for name in self.images if name not in registered)

    def with_poses(self, posed: Iterable[str], adjusted_images: int, adjusted_points: int) -> "GrowthState":
        """The state with the images ``posed`` registered, the new ones last and in the given order."""
        names = list(posed)
        now, before = set(names), set(self.registered)
        return self.model_copy(
            update={
                "registered": (
                    *(name for name in self.registered if name in now),
                    *(name for name in names if name not in before),
                ),
                **self._about_others(now),
                "adjusted_images": adjusted_images,
                "adjusted_points": adjusted_points,
            }
        )

    def without(self, names: Collection[str]) -> "GrowthState":
        """The state without these images, as if they had never been added."""
        images = {name: size for name, size in self.images.items() if name not in names}
        registered = tuple(name for name in self.registered if name not in names)
        first = list(self.images)[: self.bootstrap_images]
        return self.model_copy(
            update={
                "images": images,
                "pending": tuple(name for name in self.pending if name not in names),
                "registered": registered,
                **self._about_others(names),
                "bootstrap_images": sum(name not in names for name in first),
                "adjusted_images": min(self.adjusted_images, len(registered)),
                "mapped_images": min(self.mapped_images, len(images)),
            }
        )

    def _about_others(self, names: Collection[str]) -> dict[str, dict[str, Any]]:
        """What is kept of unregistered images other than ``names``."""
        fields: dict[str, Mapping[str, Any]] = {
            "rejected": self.rejected,
            "tried": self.tried,
            "tried_guided": self.tried_guided,
        }
        return {
            field: {name: value for name, value in values.items() if name not in names}
            for field, values in fields.items()
        }

    @property
    def ignores_positions(self) -> bool:
        """Whether the images contradicted the position priors of the last update."""
        return any(finding.code is FindingCode.POSITIONS_IGNORED for finding in self.priors_ignored)


class GrowthFolder:
    """Paths in the folder of a growing reconstruction, and the commit."""

    def __init__(self, root: Path) -> None:
        self.root = root

    @property
    def sfm(self) -> SfmFolder:
        """Features and matches of all added images."""
        return SfmFolder(self.root / "sfm")

    @property
    def localise(self) -> SfmFolder:
        """Features and matches of images that are only localised."""
        return SfmFolder(self.root / "localise")

    @property
    def words(self) -> Path:
        """The visual vocabulary."""
        return self.root / "words.npz"

    @property
    def next_model(self) -> Path:
        """The folder of a model that is not committed yet."""
        return self.root / ".model.partial"

    @property
    def guided_model(self) -> Path:
        """The folder of a model with images that were registered by guided matches."""
        return self.root / ".model.guided"

    def model(self, generation: int) -> Path:
        """The COLMAP model of a generation."""
        return self.root / f"model-{generation:06d}"

    def open(self, settings: SfmSettings) -> GrowthState:
        """The state that was committed last, a new one in a new folder; removes what was not committed.

        Raises ``InvalidInputError`` when the folder's contents belong to other settings, ``StorageError``
        when its state is damaged.
        """
        self.root.mkdir(parents=True, exist_ok=True)
        digest = settings_digest(settings)
        state = self._read()
        if state is None:
            return GrowthState(settings=digest)
        if state.settings != digest:
            raise InvalidInputError(
                f"{self.root} holds a reconstruction with other settings.",
                hint="Give the settings that it was created with, or another folder.",
                path=self.root,
            )
        self._remove_all_but(state.generation)
        return state

    @property
    def current_model(self) -> Path | None:
        """The COLMAP model that was committed last; None without one. Raises ``StorageError``."""
        state = self._read()
        return self.model(state.generation) if state is not None and state.registered else None

    @property
    def ignores_positions(self) -> bool:
        """Whether the images contradicted the position priors of the last update. Raises ``StorageError``."""
        state = self._read()
        return state is not None and state.ignores_positions

    def save(self, state: GrowthState) -> None:
        """Commit a state with the current model."""
        write_record(self._file, state)

    def commit(self, state: GrowthState) -> None:
        """Commit ``next_model`` as the model of ``state.generation``, and the state with it."""
        replace_folder(self.next_model, self.model(state.generation))
        self.save(state)
        self._remove_all_but(state.generation)

    @property
    def _file(self) -> Path:
        return self.root / "growth.json"

    def _read(self) -> GrowthState | None:
        return read_record(self._file, GrowthState, "Delete its folder and start again.")

    def _remove_all_but(self, generation: int) -> None:
        current = self.model(generation)
        for folder in [*self.root.glob("model-*"), self.next_model, self.guided_model]:
            if folder != current:
                shutil.rmtree(folder, ignore_errors=True)


def settings_digest(settings: SfmSettings) -> str:
    """Digest of the settings that change the reconstruction."""
    plain = settings.model_dump(mode="json", exclude={"threads"})
    return hashlib.sha256(json.dumps(plain, sort_keys=True).encode()).hexdigest()


@dataclass(frozen=True)
class ModelChange:
    """Result of registering images, or of a re-map.

    ``changed``: a model other than the current one was written; ``mapper`` made it, None without a re-map.
    ``match_support``: share of the verified matches that the model explains, known after a global bundle
    adjustment or a re-map. ``tried``: the images whose registration was tried.
    """

    state: GrowthState
    changed: bool = False
    mapper: str | None = None
    match_support: float | None = None
    warnings: tuple[Finding, ...] = ()
    tried: tuple[str, ...] = ()

    def with_state(self, **update: Any) -> "ModelChange":
        """The same change, with other values of the state's fields."""
        return replace(self, state=self.state.model_copy(update=update))


def require_unchanged(state: GrowthState, image_dir: Path, names: Sequence[str]) -> dict[str, int]:
    """Sizes in bytes of ``names``; raises ``InvalidInputError`` when a file is missing or has changed."""
    sizes = {}
    for name in names:
        file = image_dir / name
        if not file.is_file():
            raise InvalidInputError(f"{file} does not exist.", hint="Check the image names.", path=file)
        sizes[name] = file.stat().st_size
        if state.images.get(name, sizes[name]) != sizes[name]:
            raise InvalidInputError(
                f"{file} is not the photograph that was added before.",
                hint="Give the new photograph a name of its own, or start in another folder.",
                path=file,
            )
    return sizes


def require_readable(image_dir: Path, names: Sequence[str]) -> None:
    """Raise ``InvalidInputError`` for what is no image, before it becomes part of the state."""
    for name in names:
        try:
            with Image.open(image_dir / name):
                pass
        except (OSError, Image.DecompressionBombError) as error:
            raise InvalidInputError(
                f"{image_dir / name} cannot be read as an image.",
                hint="Leave it out, or export it again.",
                path=image_dir / name,
            ) from error
