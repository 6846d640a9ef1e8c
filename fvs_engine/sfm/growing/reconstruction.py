"""A reconstruction that photographs are added to, one by one or many at once."""

import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from fvs_engine.errors import InvalidInputError
from fvs_engine.monitor import Monitor
from fvs_engine.sfm.batch.reconstruct import reconstruct
from fvs_engine.sfm.colmap.database import (
    feature_counts,
    image_ids,
    read_descriptors,
    require_sound_database,
    verified_matches,
)
from fvs_engine.sfm.colmap.model import read_colmap
from fvs_engine.sfm.growing.localise import localise
from fvs_engine.sfm.growing.neighbours import Looks, match_with_neighbours
from fvs_engine.sfm.growing.registration import reason_to_remap, register, remap
from fvs_engine.sfm.growing.state import GrowthFolder, GrowthState, require_unchanged
from fvs_engine.sfm.matching.features import add_features
from fvs_engine.sfm.matching.match import require_plain_names
from fvs_engine.sfm.reconstruction import Reconstruction
from fvs_engine.sfm.settings import SfmSettings
from fvs_engine.sfm.stages import Stages, fresh_folder
from fvs_engine.sfm.verification.evidence import MIN_PAIR_MATCHES
from fvs_engine.sfm.verification.positions import Positions, positions_in_exif
from fvs_engine.views import AnyView

_MIN_BOOTSTRAP = 2


@dataclass(frozen=True)
class GrowthReport:
    """What one ``add`` changed."""

    registered: tuple[str, ...]
    """Images that got their camera now, those that had waited among them."""

    waiting: tuple[str, ...]
    """All images that have no camera yet."""

    refreshed: bool
    """Whether the cameras that stood before were all adjusted or found anew, not only those near new ones."""

    warnings: tuple[str, ...]
    seconds: dict[str, float]
    """Wall-clock time per stage, s."""


class GrowingReconstruction:
    """Structure from motion that owns a folder over time; its model frame stays where it is.

    The first images are bootstrapped through the gated ``reconstruct``. Later ones are matched with a bounded
    number of standing images (in capture order, added last, alike in looks, near in space to the best
    matched), registered, triangulated and adjusted with the cameras near them. A pose counts only if the
    image's verified matches explain it; an image without one waits and is tried again whenever others are
    added. All cameras are adjusted together when the model grew by a share, and found anew through the gate
    when the evidence has fallen or images that match the model pile up waiting; what comes of it is laid onto
    the standing model.

    Every change is committed whole (``growing_state``). With ``settings.threads`` 1 the result depends on the
    images, their order and the seed only, also through kills.
    """

    def __init__(
        self, folder: GrowthFolder, image_dir: Path, settings: SfmSettings, state: GrowthState
    ) -> None:
        self._folder = folder
        self._image_dir = image_dir
        self._settings = settings
        self._state = state
        self._looks: Looks | None = None
        self._database_is_sound = False  # not known yet: the check reads all of it
        self._standing: tuple[int, Reconstruction] | None = None

    @classmethod
    def open(
        cls, folder: Path, image_dir: Path, settings: SfmSettings, monitor: Monitor
    ) -> "GrowingReconstruction":
        """Create the reconstruction that ``folder`` keeps, or go on with what was committed last.

        Raises ``InvalidInputError`` when the folder belongs to other settings or a photograph has changed,
        ``StorageError`` when it is damaged.
        """
        monitor.check()
        growth = GrowthFolder(folder)
        state = growth.open(settings)
        require_unchanged(state, image_dir, tuple(state.images))
        return cls(growth, image_dir, settings, state)

    @property
    def reconstruction(self) -> Reconstruction:
        """The standing model, in the model frame; empty before the first model."""
        generation = self._state.generation
        if generation == 0:
            return Reconstruction((), np.zeros((0, 3)), np.zeros((0, 3), np.uint8), np.zeros(0))
        if self._standing is None or self._standing[0] != generation:
            self._standing = (generation, read_colmap(self._folder.model(generation)))
        return self._standing[1]

    @property
    def model_dir(self) -> Path | None:
        """Where the standing model lies as COLMAP's files; None before the first."""
        return self._folder.model(self.generation) if self.generation > 0 else None

    @property
    def registered(self) -> tuple[str, ...]:
        """Names of the images that have a camera, in the order in which they got it."""
        return self._state.registered

    @property
    def waiting(self) -> tuple[str, ...]:
        """Names of the images that were added and have no camera yet, in the order of adding."""
        return self._state.waiting

    @property
    def generation(self) -> int:
        """Grows with every committed change of the model; 0 before the first."""
        return self._state.generation

    def add(self, names: Sequence[str], monitor: Monitor, positions: Positions | None = None) -> GrowthReport:
        """Add photographs (posix paths in the image folder); what was added before is not added again.

        The first two or more are bootstrapped; a single first one waits. Progress is reported as the stages
        of ``reconstruct``, or ``features``, ``matching``, ``registration`` and, when all cameras are found
        anew, its mapping stages. A call after ``Cancelled`` or a kill goes on where the former stopped, also
        if it names other images.

        ``positions``: where photographs were taken, as far as it is known, those of earlier calls included;
        by default what GPS wrote into their EXIF. They move no camera, but places and models that contradict
        them are not believed.

        Raises ``ReconstructionError`` when the first images support no model (they stay added, and the next
        call tries again with them), ``InvalidInputError`` for files that are missing, no images or have
        changed, ``Cancelled``.
        """
        require_plain_names(names)
        sizes = require_unchanged(self._state, self._image_dir, list(dict.fromkeys(names)))
        new = {name: size for name, size in sizes.items() if name not in self._state.images}
        _require_readable(self._image_dir, tuple(new))
        if new:
            self._state = self._state.model_copy(
                update={"images": self._state.images | new, "pending": (*self._state.pending, *new)}
            )
            self._folder.save(self._state)
        if not self._state.pending or len(self._state.images) < _MIN_BOOTSTRAP:
            return GrowthReport((), self.waiting, False, (), {})
        if self.generation == 0:
            return self._bootstrap(monitor, positions)
        return self._grow(monitor, positions)

    def localise(
        self, names: Sequence[str], monitor: Monitor, positions: Positions | None = None
    ) -> dict[str, AnyView]:
        """Cameras of other photographs in the standing model, which stays as it is.

        Those that cannot be placed, or whose matches or ``positions`` contradict the place, are left out;
        registered ones have the camera that they have. What is found depends on the standing model alone, not
        on earlier calls. Raises ``InvalidInputError`` for missing files, ``Cancelled``.
        """
        require_plain_names(names)
        require_unchanged(self._state, self._image_dir, names)
        if self.generation == 0:
            return {}
        standing = {view.name: view for view in self.reconstruction.views}
        guests = [name for name in dict.fromkeys(names) if name not in standing]
        found = {name: standing[name] for name in names if name in standing}
        if guests:
            stages = Stages(self._folder.localise, self._settings, monitor)
            found |= localise(
                stages,
                self._image_dir,
                guests,
                self.reconstruction,
                self.registered,
                self._folder.model(self.generation),
                self._folder.sfm.database,
                self._open_looks(),
                positions or Positions(),
            )
        return found

    def _bootstrap(self, monitor: Monitor, positions: Positions | None) -> GrowthReport:
        names = list(self._state.images)
        folder = self._folder.sfm.root
        result = reconstruct(self._image_dir, names, folder, self._settings, monitor, positions)
        shutil.copytree(result.model_dir, fresh_folder(self._folder.next_model), dirs_exist_ok=True)
        posed = {view.name for view in result.reconstruction.views}
        chosen = next(c for c in result.report.candidates if c.mapper == result.report.mapper)
        self._commit(
            self._state.model_copy(
                update={
                    "pending": (),
                    "registered": tuple(name for name in names if name in posed),
                    "bootstrap_images": len(names),
                    "adjusted_images": len(posed),
                    "adjusted_points": len(result.reconstruction.points),
                    "mapped_images": len(names),
                    "mapped_support": chosen.evidence.match_support if chosen.evidence is not None else 0.0,
                }
            )
        )
        return GrowthReport(
            self.registered, self.waiting, False, result.report.warnings, result.report.seconds
        )

    def _grow(self, monitor: Monitor, given: Positions | None) -> GrowthReport:
        stages = Stages(self._folder.sfm, self._settings, monitor)
        before = self._state
        standing = self._folder.model(before.generation)
        candidates = self._match_waiting(stages)
        positions = given or positions_in_exif(stages.folder.database)
        grown = register(
            stages, self._image_dir, before, candidates, positions, standing, self._folder.next_model
        )
        warnings = [*stages.warnings, *grown.warnings]
        state, refreshed = grown.state, grown.adjusted
        reason = reason_to_remap(state, grown.support, self._stranded(state), self._settings)
        if reason is not None:
            model_dir = self._folder.next_model if grown.changed else standing
            found = remap(stages, self._image_dir, state, positions, model_dir, self._folder.next_model)
            state, refreshed = found.state, refreshed or found.adopted
            warnings += [f"{reason} {line}" for line in found.warnings]
        state = state.model_copy(update={"pending": ()})
        if grown.changed or state.registered != before.registered or refreshed:
            self._commit(state)
        else:
            self._folder.save(state)
            self._state = state
        new = set(self.registered) - set(before.registered)
        return GrowthReport(
            tuple(name for name in self.registered if name in new),
            self.waiting,
            refreshed,
            tuple(warnings),
            stages.seconds,
        )

    def _match_waiting(self, stages: Stages) -> list[str]:
        """Find features and matches of the images that wait; returns those that match anything."""
        database = stages.folder.database
        if not self._database_is_sound:
            require_sound_database(database)
            self._database_is_sound = True
        names = list(self._state.images)
        add_features(stages, self._image_dir, names)
        features = feature_counts(database)
        usable = [name for name in names if features.get(name, 0) > 0]
        blank = [name for name in self._state.pending if features.get(name, 0) == 0]
        if blank:
            stages.warnings.append(f"No features could be found in {', '.join(blank)}.")
        waiting = [name for name in self.waiting if name in set(usable)]
        match_with_neighbours(stages, waiting, usable, self.reconstruction.centres(), self._open_looks())
        tied = {name for pair in verified_matches(database, MIN_PAIR_MATCHES) for name in pair}
        return [name for name in waiting if name in tied]

    def _stranded(self, state: GrowthState) -> int:
        """How many waiting images match registered ones."""
        waiting, registered = set(state.waiting), set(state.registered)
        pairs = verified_matches(self._folder.sfm.database, MIN_PAIR_MATCHES)
        return len({a for pair in pairs for a, b in (pair, pair[::-1]) if a in waiting and b in registered})

    def _open_looks(self) -> Looks:
        if self._looks is None:
            first = list(self._state.images)[: self._state.bootstrap_images]
            self._looks = Looks.open(self._folder.words, first, self._settings.seed, self._descriptors)
        return self._looks

    def _descriptors(self, name: str) -> NDArray[np.float32]:
        for folder in (self._folder.sfm, self._folder.localise):
            if folder.database.is_file() and name in (ids := image_ids(folder.database)):
                return read_descriptors(folder.database, ids[name])
        return np.zeros((0, 128), dtype=np.float32)

    def _commit(self, state: GrowthState) -> None:
        """Make ``next_model`` the standing model."""
        state = state.model_copy(update={"generation": state.generation + 1})
        self._folder.commit(state)
        self._state = state


def _require_readable(image_dir: Path, names: Sequence[str]) -> None:
    """Raise ``InvalidInputError`` for what is no image, before it becomes part of the state."""
    for name in names:
        try:
            with Image.open(image_dir / name):
                pass
        except (OSError, Image.DecompressionBombError) as error:
            raise InvalidInputError(
                f"{image_dir / name} cannot be read as an image.", hint="Leave it out, or export it again."
            ) from error
