"""A reconstruction that images are added to, one by one or many at once."""

import contextlib
import shutil
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fvs_engine.errors import DamagedOutputError
from fvs_engine.monitor import Monitor
from fvs_engine.sfm.batch.mapping import leave_out
from fvs_engine.sfm.batch.reconstruct import reconstruct
from fvs_engine.sfm.colmap.database import (
    feature_counts,
    image_ids,
    read_descriptors,
    require_sound_database,
)
from fvs_engine.sfm.colmap.model import open_colmap, read_colmap
from fvs_engine.sfm.growing.localise import localise
from fvs_engine.sfm.growing.neighbours import ImageRetrieval, Surroundings
from fvs_engine.sfm.growing.reasons import doubts_by_priors, why_unregistered
from fvs_engine.sfm.growing.state import GrowthFolder, GrowthState, require_readable, require_unchanged
from fvs_engine.sfm.growing.step import step
from fvs_engine.sfm.growing.two_view_points import TwoViewPoints, find_two_view_points
from fvs_engine.sfm.growing.update import PoseUpdate
from fvs_engine.sfm.matching.features import add_features
from fvs_engine.sfm.pose_priors import ImageSet, PosePriors
from fvs_engine.sfm.quarantine import CulpritError
from fvs_engine.sfm.reconstruction import Reconstruction
from fvs_engine.sfm.settings import SfmSettings
from fvs_engine.sfm.stages import SfmFolder, Stages, fresh_folder
from fvs_engine.sfm.warnings import without_doubts, without_registered
from fvs_engine.views import AnyView
from fvs_schema.findings import Finding, FindingCode

_UNUSED_PRIORS = (FindingCode.POSITIONS_IGNORED, FindingCode.FROZEN_POSITIONS)
_MIN_BOOTSTRAP = 2


class GrowingReconstruction:
    """Incremental structure from motion in a folder of its own; the model frame never changes.

    The first images go through ``reconstruct``. Later ones are matched with a bounded number of earlier ones
    (near in capture order, added last, most similar, near in space to the best matched), registered and
    triangulated, with local bundle adjustment. A pose counts only if it explains the image's verified
    matches and these determine it; an unregistered image is tried again when its prior or the images around
    it have changed, or may with one tried now (``registration_inputs``). Global bundle adjustment follows
    when the model has grown by a share, after a review of the poses that hang on few points; a re-map, which
    must pass the gate, when match support has fallen or many images that match the model stay unregistered.
    Both results are aligned with the current model.

    When the new images are many compared with the registered ones, all are mapped together, as if none had
    been registered.

    An image keeps the features that it got when it was added: those of a small set when the set became large
    since, also where a kill came between.

    Every change is committed as a whole (``state``). With ``settings.threads`` 1 the result depends on the
    images, their order and the seed only, also after kills.
    """

    def __init__(
        self, folder: GrowthFolder, image_dir: Path, settings: SfmSettings, state: GrowthState
    ) -> None:
        self._folder = folder
        self._image_dir = image_dir
        self._settings = settings
        self._state = state
        self._retrieval: ImageRetrieval | None = None
        self._database_is_sound = False  # unknown yet: the check reads all of it
        self._current: tuple[int, Reconstruction] | None = None

    @classmethod
    def open(
        cls,
        folder: Path,
        image_dir: Path,
        settings: SfmSettings,
        monitor: Monitor,
        *,
        remove_missing: bool = False,
    ) -> "GrowingReconstruction":
        """Open the reconstruction in ``folder`` as it was last committed, or create it.

        ``remove_missing``: images whose file no longer exists are removed.
        Raises ``InvalidInputError`` when the folder belongs to other settings or an image file has changed,
        ``StorageError`` when it is damaged.
        """
        monitor.check()
        growth = GrowthFolder(folder)
        state = growth.open(settings)
        opened = cls(growth, image_dir, settings, state)
        if remove_missing and (gone := {name for name in state.images if not (image_dir / name).is_file()}):
            opened.remove(gone)
        require_unchanged(state, image_dir, opened.added)
        return opened

    @property
    def reconstruction(self) -> Reconstruction:
        """The current model; empty before the first one."""
        generation = self._state.generation
        if not self._state.registered:
            return Reconstruction.of_views(())
        if self._current is None or self._current[0] != generation:
            self._current = (generation, read_colmap(self._folder.model(generation)))
        return self._current[1]

    @property
    def model_dir(self) -> Path | None:
        """The folder of the current COLMAP model; None when no image is registered."""
        return self._folder.model(self.generation) if self.registered else None

    @property
    def registered(self) -> tuple[str, ...]:
        """Names of the registered images, in the order of registration."""
        return self._state.registered

    @property
    def unregistered(self) -> tuple[str, ...]:
        """Names of the added images without a pose, in the order of adding."""
        return self._state.unregistered

    @property
    def why_unregistered(self) -> Mapping[str, Finding]:
        """Unregistered images → the reason, by the last try."""
        return why_unregistered(self._state, self._folder.sfm.database)

    @property
    def added(self) -> tuple[str, ...]:
        """Names of the images that were added and neither removed nor quarantined, in the order of adding."""
        return tuple(self._state.images)

    @property
    def quarantined(self) -> Mapping[str, Finding]:
        """Images that crash pycolmap, which no job gets → the reasons."""
        return self._folder.sfm.quarantine.reasons

    @property
    def generation(self) -> int:
        """Number of the last committed model; 0 before the first one."""
        return self._state.generation

    def add(
        self,
        names: Sequence[str],
        monitor: Monitor,
        priors: PosePriors | None = None,
        known: Iterable[AnyView] | None = None,
    ) -> PoseUpdate:
        """Add images (posix paths in the image folder); those that were added before change nothing.

        The first two or more are reconstructed together; a single first one stays unregistered. Progress is
        reported as the stages of ``reconstruct``, or ``features``, ``matching``, ``registration`` and, in a
        re-map, its mapping stages. A call after ``Cancelled`` or a kill resumes, also with other names.

        ``priors``: pose priors, those of earlier images included; by default the positions in their
        metadata. Poses and models that contradict them are rejected; where they agree with the model, they
        keep it from drifting, and images that match nothing are matched where they should be. ``known``:
        the views from which the result counts its changes, by default those before the call. A caller that
        was killed after a commit has older ones; one that gives them also gets the warnings again that it
        did not ``acknowledge``.

        Images that crash pycolmap are quarantined: they are no longer added, and a warning names them.

        Raises ``ReconstructionError`` when the first images support no model (they stay added, and the next
        call tries again with them), ``InvalidInputError`` for files that are missing, no images or have
        changed, ``DamagedOutputError`` when nothing can be added any more, ``Cancelled``.
        """
        quarantined = self.quarantined
        names = [name for name in dict.fromkeys(names) if name not in quarantined]
        sizes = require_unchanged(self._state, self._image_dir, names)
        new = {name: size for name, size in sizes.items() if name not in self._state.images}
        require_readable(self._image_dir, tuple(new))
        with self._damage_named():
            if new:
                self._remove_left_over()
                self._state = self._state.model_copy(
                    update={"images": self._state.images | new, "pending": (*self._state.pending, *new)}
                )
                self._folder.save(self._state)
            before = self.reconstruction.views if known is None else known
            if known is None:
                self._state = self._state.model_copy(update={"unreported": ()})
            seconds: Mapping[str, float] = {}
            while self._state.pending and len(self._state.images) >= _MIN_BOOTSTRAP:
                try:
                    advance = self._grow if self.registered else self._bootstrap
                    seconds = advance(monitor, priors)
                except CulpritError as culprit:
                    self._folder.sfm.quarantine.add(culprit)
                    self._remove({culprit.name})
        crashed = (reason for name, reason in self.quarantined.items() if name not in quarantined)
        warnings = without_registered((*self._state.unreported, *crashed), set(self.registered))
        current = self.reconstruction
        if not self._state.ignores_positions:
            warnings += doubts_by_priors(priors, self._folder.sfm.database, current.centres())
        added = tuple(self._state.images)
        update = PoseUpdate.between(before, current.views, current.points, added, self.generation)
        return replace(update, warnings=warnings, seconds=seconds)

    def two_view_points(self, monitor: Monitor) -> TwoViewPoints | None:
        """The points that only two registered images show; None where they cannot be computed.

        Raises ``Cancelled``.
        """
        if self.model_dir is None:
            return None
        return find_two_view_points(self._stages(self._folder.sfm, monitor), self.model_dir)

    def acknowledge(self) -> None:
        """Forget the warnings so far: the caller has what ``add`` returned on disk."""
        if self._state.unreported:
            self._state = self._state.model_copy(update={"unreported": ()})
            self._folder.save(self._state)

    def remove(self, names: Collection[str]) -> None:
        """Remove images, as if they had never been added: their features, matches, poses and observations.

        The poses and intrinsics of the others stay; points that fewer than two of them saw are gone. When
        fewer than two registered images are left, the next images start a new model, in a frame of its own.
        An image that was removed, or quarantined, can be added again. Raises as ``add`` for damaged files.
        """
        with self._damage_named():
            self._remove(names)
        self._folder.sfm.quarantine.release(names)

    def localise(
        self, names: Sequence[str], monitor: Monitor, priors: PosePriors | None = None
    ) -> dict[str, AnyView]:
        """Estimate the poses of other images in the current model, which does not change.

        Those without a pose, whose matches or ``priors`` contradict it, or which crash pycolmap, are
        left out; registered images have their current poses. The result depends on the current model only,
        not on earlier calls. Raises ``InvalidInputError`` for missing files, ``Cancelled``.
        """
        require_unchanged(self._state, self._image_dir, names)
        if not self.registered:
            return {}
        registered = {view.name: view for view in self.reconstruction.views}
        found = {name: registered[name] for name in names if name in registered}
        quarantine = self._folder.localise.quarantine
        others = [name for name in dict.fromkeys(names) if name not in registered]
        while guests := [name for name in others if name not in quarantine.reasons]:
            stages = self._stages(self._folder.localise, monitor)
            around = Surroundings(self.registered, self.reconstruction, self._open_retrieval())
            try:
                return found | localise(stages, self._folder, guests, around, priors or PosePriors())
            except CulpritError as culprit:
                if culprit.name not in guests:
                    raise
                quarantine.add(culprit)
        return found

    def _bootstrap(self, monitor: Monitor, priors: PosePriors | None) -> Mapping[str, float]:
        """Make the first model; the seconds of its stages."""
        images = ImageSet(self._image_dir, list(self._state.images), priors)
        result = reconstruct(images, self._folder.sfm.root, self._settings, monitor)
        self._state = self._state.without(self.quarantined.keys())
        shutil.copytree(result.model_dir, fresh_folder(self._folder.next_model), dirs_exist_ok=True)
        posed = {view.name for view in result.reconstruction.views}
        chosen = next(c for c in result.report.candidates if c.mapper == result.report.mapper)
        names = list(self._state.images)
        state = self._state.model_copy(
            update={
                "pending": (),
                "bootstrap_images": len(names),
                "mapped_images": len(names),
                "mapped_support": chosen.evidence.match_support if chosen.evidence is not None else 0.0,
                "unreported": (*self._state.unreported, *result.report.warnings),
                "priors_ignored": tuple(
                    found for found in result.report.warnings if found.code in _UNUSED_PRIORS
                ),
            }
        )
        registered = [name for name in names if name in posed]
        self._commit(state.with_poses(registered, len(posed), len(result.reconstruction.points)))
        self._open_retrieval().prepare(names)
        return result.report.seconds

    def _grow(self, monitor: Monitor, priors: PosePriors | None) -> Mapping[str, float]:
        """Register new images in the current model; the seconds of the stages."""
        stages = self._stages(self._folder.sfm, monitor)
        usable = self._extract_features(stages)
        around = Surroundings(usable, self.reconstruction, self._open_retrieval())
        done = step(stages, self._folder, self._state, around, priors)
        if done.from_all:
            self._folder.words.unlink(missing_ok=True)  # a vocabulary of all images is a better one
            self._retrieval = None
        before = self._state.unreported
        unreported = (*(without_doubts(before) if done.replaced else before), *done.warnings)
        state = done.state.model_copy(update={"unreported": unreported})
        if done.changed:
            self._commit(state)
        else:
            self._folder.save(state)
            self._state = state
        if done.from_all:
            self._open_retrieval().prepare(list(done.state.images))
        return stages.seconds

    def _remove(self, names: Collection[str]) -> None:
        """Remove images from the state, the model and, once that is committed, the database."""
        if not names:
            return
        self._require_sound_database()
        state = self._state.without(names)
        if len(state.registered) < _MIN_BOOTSTRAP:
            state = state.model_copy(update={"registered": (), "pending": tuple(state.images)})
        if state.registered and state.registered != self._state.registered:
            model = open_colmap(self._folder.model(self.generation))
            leave_out(model, list(names))
            model.write_binary(fresh_folder(self._folder.next_model))
            self._commit(state)
        elif state != self._state:
            self._folder.save(state)
            self._state = state
        self._folder.sfm.remove_images(names)

    def _remove_left_over(self) -> None:
        """Remove images from the database that a removal left there when it was killed after its commit."""
        self._require_sound_database()
        database = self._folder.sfm.database
        if database.exists():
            self._folder.sfm.remove_images(image_ids(database).keys() - self._state.images.keys())

    def _require_sound_database(self) -> None:
        """Check the database; the model names its images by that one's ids, so no other replaces it."""
        database = self._folder.sfm.database
        if not self._database_is_sound:
            require_sound_database(database)
        if self.registered and not database.exists():
            raise DamagedOutputError(f"The feature database {database} is missing.", path=database)
        self._database_is_sound = True

    @contextlib.contextmanager
    def _damage_named(self) -> Iterator[None]:
        """Add the remedy to errors about damaged files in the block: start again, as nothing can be added."""
        try:
            yield
        except DamagedOutputError as damage:
            hint = f"Delete {self._folder.root} and add the images again."
            raise DamagedOutputError(damage.message, hint=hint, path=damage.path) from damage

    def _extract_features(self, stages: Stages) -> list[str]:
        """Extract features of all added images; returns the images that have some."""
        database = stages.folder.database
        self._require_sound_database()
        names = list(self._state.images)
        add_features(stages, names)
        features = feature_counts(database)
        blank = [name for name in self._state.pending if features.get(name, 0) == 0]
        if blank:
            stages.warnings.append(Finding.of(FindingCode.NO_FEATURES, blank))
        return [name for name in names if features.get(name, 0) > 0]

    def _stages(self, folder: SfmFolder, monitor: Monitor) -> Stages:
        return Stages(folder, self._image_dir, self._settings, monitor)

    def _open_retrieval(self) -> ImageRetrieval:
        if self._retrieval is None:
            first = list(self._state.images)[: self._state.bootstrap_images]
            self._retrieval = ImageRetrieval.open(
                self._folder.words, first, self._settings.seed, self._descriptors
            )
        return self._retrieval

    def _descriptors(self, name: str) -> NDArray[np.float32]:
        for folder in (self._folder.sfm, self._folder.localise):
            if folder.database.is_file() and name in (ids := image_ids(folder.database)):
                return read_descriptors(folder.database, ids[name])
        return np.zeros((0, 128), dtype=np.float32)

    def _commit(self, state: GrowthState) -> None:
        """Commit ``next_model`` as the current model."""
        state = state.model_copy(update={"generation": state.generation + 1})
        self._folder.commit(state)
        self._state = state
