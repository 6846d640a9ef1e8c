"""The folder of structure from motion, and the state that its stages share."""

import contextlib
import hashlib
import json
import shutil
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pycolmap

from fvs_engine.errors import InvalidInputError, NativeJobError, NoImagesError
from fvs_engine.files.atomic import write_text_atomically
from fvs_engine.monitor import Monitor
from fvs_engine.sfm.colmap.database import (
    delete_database,
    image_ids,
    remove_images,
    require_sound_database,
)
from fvs_engine.sfm.colmap.part_database import matches_around
from fvs_engine.sfm.culprit import Item, run_or_accuse
from fvs_engine.sfm.jobs import Answer, Request
from fvs_engine.sfm.native_process import run_native
from fvs_engine.sfm.quarantine import CulpritError, Quarantine
from fvs_engine.sfm.settings import SfmSettings
from fvs_schema.findings import Finding
from fvs_schema.masks import MASKS, find_mask

_MAPPING = "mapping"
_NOT_MAPPING = ("gate", "incremental_first_up_to")
"""Settings that do not change the mappers' models."""


@dataclass(frozen=True)
class SfmFolder:
    """Paths in the folder of structure from motion."""

    root: Path

    @property
    def database(self) -> Path:
        """Features, matches and two-view geometries."""
        return self.root / "database.db"

    @property
    def parts(self) -> Path:
        """Temporary databases of the processes that match images."""
        return self.root / "parts"

    @property
    def masks(self) -> Path:
        """The masks of masked images, as COLMAP names them."""
        return self.root / MASKS

    @property
    def calibrated(self) -> Path:
        """The same with focal lengths and relative poses of the calibrated view graph."""
        return self.root / "calibrated.db"

    @property
    def sparse(self) -> Path:
        """The chosen COLMAP model."""
        return self.root / "sparse"

    @property
    def report(self) -> Path:
        """The report, written last: when it exists, the result is complete."""
        return self.root / "report.json"

    @property
    def rejected(self) -> Path:
        """The evidence against the models when all were rejected."""
        return self.root / "rejected.json"

    @property
    def log(self) -> Path:
        """Pycolmap's output."""
        return self.root / "native.log"

    @property
    def state(self) -> Path:
        """Which images and settings the folder's contents belong to."""
        return self.root / "state.json"

    @property
    def quarantine(self) -> Quarantine:
        """The images that no job gets."""
        return Quarantine(self.root / "quarantine.json")

    def mapping(self, mapper: str) -> Path:
        """A mapper's models, in folders 0, 1 and so on."""
        return self.root / _MAPPING / mapper

    def remove_images(self, names: Iterable[str]) -> None:
        """Remove images from the database and delete the results that refer to them; ignore unknown names.

        An image that is added again gets another id: models and results from before do not fit it.
        """
        gone = list(names)
        if self.database.exists() and not image_ids(self.database).keys().isdisjoint(gone):
            self.report.unlink(missing_ok=True)
            delete_database(self.calibrated)
            shutil.rmtree(self.root / _MAPPING, ignore_errors=True)
        remove_images(self.database, gone)
        delete_database(matches_around(self.database))

    def partial(self, final: Path) -> Path:
        """Where ``final`` is written until it is whole."""
        return final.with_name(f".{final.name}.partial")


class Stages:
    """One run in a folder: times stages, runs native jobs, deletes outdated files."""

    def __init__(self, folder: SfmFolder, image_dir: Path, settings: SfmSettings, monitor: Monitor) -> None:
        self.folder = folder
        self.image_dir = image_dir
        self.settings = settings
        self.monitor = monitor
        self.seconds: dict[str, float] = {}
        self.warnings: list[Finding] = []
        self.pairs_matched = 0

    def open(self, image_names: Sequence[str], min_images: int, *, growing: bool = False) -> list[str]:
        """Check the input and the folder; returns the image names.

        Features are extracted anew when the set has become large or small, unless it is ``growing``.

        Results of other images or settings are deleted as far as they depend on them: when images are
        added, features and matches are kept; when masks change, those of the other images; when only the gate
        changes, the mappers' models are kept, too.
        """
        names = list(dict.fromkeys(image_names))
        if len(names) < min_images:
            raise NoImagesError(
                f"Structure from motion needs at least two images, not {len(names)}"
                + (f" ({names[0]})." if names else "."),
                hint="Give photographs of the same scene from several places; ten or more work well.",
            )
        missing = [file for name in names if not (file := self.image_dir / name).is_file()]
        if missing:
            raise InvalidInputError(f"{missing[0]} does not exist.", hint="Check the image names.")
        self.folder.root.mkdir(parents=True, exist_ok=True)
        require_sound_database(self.folder.database)
        self._delete_stale(names, growing)
        return names

    def _delete_stale(self, names: Sequence[str], growing: bool) -> None:
        settings = self.settings.model_dump(mode="json", exclude={"threads", "growth"})
        # Features of one kind match those of the other: a set that grows from few to many images keeps them.
        features = {
            key: settings[key]
            for key in ("features_of_few", "features_of_many", "camera_model", "intrinsics", "focal_prior")
        }
        sizes = {name: (self.image_dir / name).stat().st_size for name in names}
        masks = {
            name: hashlib.sha256(file.read_bytes()).hexdigest()
            for name in names
            if (file := find_mask(self.image_dir, name)) is not None
        }
        kind = _digest(self.settings.features(len(names)).model_dump())
        state = {"features": _digest(features), "images": sizes, "masks": masks}
        state["mapping"] = _digest([settings, names])
        mapping = {key: value for key, value in settings.items() if key not in _NOT_MAPPING}
        state["models"] = _digest([mapping, names])
        before: dict[str, Any] = {}
        with contextlib.suppress(OSError, ValueError):
            before = json.loads(self.folder.state.read_text(encoding="utf-8"))
        changed = any(before.get("images", {}).get(name, size) != size for name, size in sizes.items())
        state["kind"] = before.get("kind", kind) if growing else kind
        changed |= before.get("kind", kind) != state["kind"]
        if before.get("features") != state["features"] or changed:
            delete_database(self.folder.database)
        elif self.folder.database.exists():
            known = masks if growing else before.get("masks", {})  # which begins before there is a state
            remasked = {name for name in names if known.get(name) != masks.get(name)}
            self.folder.remove_images((image_ids(self.folder.database).keys() - sizes.keys()) | remasked)
        if before.get("models") != state["models"] or changed:
            delete_database(self.folder.calibrated)
            shutil.rmtree(self.folder.root / _MAPPING, ignore_errors=True)
        if before.get("mapping") != state["mapping"] or changed:
            self.folder.report.unlink(missing_ok=True)
        self.folder.rejected.unlink(missing_ok=True)
        write_text_atomically(self.folder.state, json.dumps(state, indent=1))

    @contextlib.contextmanager
    def timed(self, stage: str) -> Iterator[None]:
        """Add the block's wall-clock time to ``seconds``."""
        began = time.monotonic()
        try:
            yield
        finally:
            self.seconds[stage] = round(self.seconds.get(stage, 0.0) + time.monotonic() - began, 2)

    def native(
        self,
        request: Request[Answer],
        *,
        on_tick: Callable[[], None] | None = None,
        on_event: Callable[[int], None] | None = None,
    ) -> Answer:
        """Run a native job with the folder's log and this run's monitor."""
        return run_native(request, self.folder.log, self.monitor, on_tick=on_tick, on_event=on_event)

    def native_over(
        self,
        items: Sequence[Item],
        request_of: Callable[[Sequence[Item]], Request[Answer]],
        *,
        controls: Sequence[Item] = (),
        on_tick: Callable[[], None] | None = None,
        on_event: Callable[[int], None] | None = None,
    ) -> Answer:
        """Run a native job on ``items``, images or pairs of them; its answer.

        ``request_of`` gives the request for a part of the items; the job may run several times. Raises
        ``CulpritError`` when a single item crashes it (see ``culprit``), of a pair for its first image, and
        ``DamagedOutputError`` when the database is the cause.
        """
        results: list[Answer] = []

        def run(some: Sequence[Item]) -> None:
            try:
                results.append(self.native(request_of(some), on_tick=on_tick, on_event=on_event))
            except NativeJobError:
                require_sound_database(self.folder.database)  # else no image is to blame
                raise

        accused = run_or_accuse(run, items, controls)
        if accused is not None:
            culprit, error = accused
            raise CulpritError(str(culprit[0] if isinstance(culprit, tuple) else culprit), error)
        return results[-1]

    def write_model(self, model: pycolmap.Reconstruction) -> None:
        """Write ``model`` to ``sparse``, whole or not at all."""
        partial = fresh_folder(self.folder.partial(self.folder.sparse))
        model.write_binary(partial)
        rename_over(partial, self.folder.sparse)


def fresh_folder(folder: Path) -> Path:
    """``folder``, existing and empty."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    return folder


def rename_over(source: Path, target: Path) -> None:
    """Rename ``source`` to ``target``, which may exist; not flushed: the contents can be recomputed."""
    if target.exists():
        shutil.rmtree(target)
    source.replace(target)


def _digest(value: object) -> str:
    return hashlib.sha256(json.dumps(value, sort_keys=True).encode()).hexdigest()
