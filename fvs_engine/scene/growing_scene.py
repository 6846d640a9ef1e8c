"""One scene over time: photographs come, cameras are found, Gaussians are added, training goes on."""

import time
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from fvs_engine.errors import InvalidInputError, TrainingError
from fvs_engine.geometry import Camera, PinholeCamera
from fvs_engine.monitor import Monitor
from fvs_engine.scene.dataset import Dataset
from fvs_engine.scene.known_poses import KnownPoses
from fvs_engine.scene.photographs import Photographs
from fvs_engine.scene.poses import PoseSource, Standing
from fvs_engine.scene.scene_files import SceneFiles, SceneMemory
from fvs_engine.scene.seeding import Seeds, guessed_seeds, seeds_on_free_points
from fvs_engine.scene.settings import SceneSettings
from fvs_engine.scene.sfm_poses import SfmPoses
from fvs_engine.sfm.verification.positions import Positions
from fvs_engine.splat.checkpoint import read_checkpoint, write_checkpoint
from fvs_engine.splat.gaussians import Gaussians
from fvs_engine.splat.raster import Rasterizer
from fvs_engine.splat.session import train_saving
from fvs_engine.splat.trainer import Trainer
from fvs_engine.splat.views import TrainingView
from fvs_engine.views import AnyView

MIN_POINTS = 100
"""With fewer sparse points than this a new model starts from guesses as well."""

POINTS_GROWTH = 2.0
"""A model begins anew when its views share so many times the points that it began on.

What training made of few views stays in the way of those that follow. Measured on *bonsai*, four views far
from one another and then sixteen more: 18.5 dB on held-out views when a model that stands on 1,000 points
never begins anew, 22.0 dB when it last did so at 18 views, as by this rule, 22.2 dB when all views are there
from the start (ADR 6).
"""

_SAVE_EVERY_S = 60.0


@dataclass(frozen=True)
class SceneUpdate:
    """What one ``add`` changed.

    ``registered``: views that got their camera now, those that had waited among them; ``waiting``: all that
    have none, those that lost theirs among them; ``moved``: how many views that were there changed their
    camera; ``iterations``: up to which ``train`` will go on; ``seconds``: for the poses, and for the model.
    """

    registered: tuple[str, ...]
    waiting: tuple[str, ...]
    moved: int
    new_gaussians: int
    iterations: int
    warnings: tuple[str, ...]
    seconds: Mapping[str, float]


@dataclass(frozen=True, eq=False)
class _Change:
    """What an addition asks for: views with their photographs, and where Gaussians start.

    ``anew``: a new model takes the place of the one that was there, if any; then all views are ``added``.
    ``begun_points``: see ``GrowingScene._begun_points``.
    """

    added: tuple[tuple[AnyView, TrainingView], ...]
    moved: tuple[tuple[AnyView, TrainingView], ...]
    lost: frozenset[str]
    seeds: Seeds
    warnings: tuple[str, ...]
    anew: bool
    begun_points: int


class GrowingScene:
    """Owns a folder in which a dataset's scene grows; on disk, a whole state survives a kill at any moment.

    A state is what the last ``save`` wrote (``train`` saves every minute, ``add`` before it begins). Whoever
    repeats the calls that followed it, after a kill, comes to the same scene bit by bit (on the CPU, with
    ``settings.sfm.threads=1`` where poses are estimated). One process at a time may own a folder.

    What an added view costs grows little with how many there are: its photograph is read, and places are
    sought for the points that came with it, among all points and Gaussians. Images stay in memory, and are
    read again only if their camera's lens or zoom changed. Finding poses and points has costs of its own, see
    ``GrowingReconstruction`` and ``KnownPoses``. The exception: when the views share twice the points that
    the model began on, it begins anew, and ``train`` goes through the whole schedule again.
    """

    def __init__(
        self,
        files: SceneFiles,
        dataset: Dataset,
        settings: SceneSettings,
        rasterizer: Rasterizer,
        source: PoseSource,
    ) -> None:
        self.dataset = dataset
        self.settings = settings
        self.rasterizer = rasterizer
        self._files = files
        self._source = source
        self._photographs = Photographs(dataset.image_dir, settings.long_side_px)
        self._trainer: Trainer | None = None
        self._visited: tuple[str, ...] = ()
        self._posed: dict[str, AnyView] = {}  # in the order of the trainer's views, lenses and all
        self._seeded: NDArray[np.float32] = np.zeros((0, 3), np.float32)
        self._usual_cameras: dict[tuple[int, int], Camera] = {}  # of the registered views, by image size
        self._initial_views = 0
        self._begun_points = 0
        """How many points the views shared when the model began, the last time."""
        self._generation = 0
        self._dirty = False

    @classmethod
    def open(
        cls, folder: Path, dataset: Dataset, settings: SceneSettings, rasterizer: Rasterizer, monitor: Monitor
    ) -> "GrowingScene":
        """Begin a scene in ``folder``, or go on with the one that is there.

        Raises ``InvalidInputError`` when the folder holds a scene of another dataset or other settings,
        ``StorageError`` when it cannot be read or written.
        """
        files = SceneFiles(folder)
        files.claim(dataset, settings)
        scene = cls(files, dataset, settings, rasterizer, _pose_source(files, dataset, settings, monitor))
        if files.checkpoint.exists():
            scene._resume(monitor)
        return scene

    @property
    def visited(self) -> tuple[str, ...]:
        """The names of all photographs that were added, in the order of their visit."""
        return self._visited

    @property
    def views(self) -> tuple[TrainingView, ...]:
        """The registered views in order of registration (that of the visit, for those that never waited).

        Each has its name, its pinhole camera at the training size, ``camera_from_model``, and its photograph.
        """
        return self._trainer.views if self._trainer else ()

    @property
    def waiting(self) -> tuple[str, ...]:
        """Visited photographs without a camera, in the order of their visit."""
        return tuple(name for name in self._visited if name not in self._posed)

    @property
    def generation(self) -> int:
        """The pose source's count of its changes, as of the last ``add``."""
        return self._generation

    @property
    def gaussians(self) -> Gaussians:
        """The model; raises ``TrainingError`` before the first view is registered."""
        return self._model().gaussians

    @property
    def sh_degree(self) -> int:
        """The degree of spherical harmonics in use."""
        return self._model().sh_degree

    @property
    def iteration(self) -> int:
        """How many iterations were done."""
        return self._trainer.iteration if self._trainer else 0

    @property
    def target_iteration(self) -> int:
        """Up to which iteration the schedule goes with the present views; 0 before the first."""
        if self._trainer is None:
            return 0
        more = len(self.views) - self._initial_views
        return self.settings.initial_iterations + self.settings.iterations_per_view * more

    def add(self, names: Sequence[str], monitor: Monitor, positions: Positions | None = None) -> SceneUpdate:
        """Visit the photographs ``names``: find their cameras, and seed Gaussians where new points are.

        ``positions``: where photographs were taken whose poses nobody knows, those of earlier calls included;
        by default what GPS wrote into their EXIF. Structure from motion believes no place that contradicts
        them. Names that were visited before change nothing. When this fails, the scene stays as it was.
        Raises ``InvalidInputError`` for names that the dataset has not, and what the pose source raises.
        """
        unknown = [name for name in names if name not in self.dataset.by_name]
        if unknown and not self.dataset.arriving:
            raise InvalidInputError(
                f"{self.dataset.name} has no view {unknown[0]}.", hint="Give names of the dataset's views."
            )
        new = tuple(name for name in dict.fromkeys(names) if name not in self._visited)
        if not new:
            return SceneUpdate((), self.waiting, 0, 0, self.target_iteration, (), {})
        if self._dirty:
            self.save()  # the pose source may never be more than one step ahead of the checkpoint
        began = time.monotonic()
        visited = self._visited + new
        standing = self._source.stand(visited, monitor, positions)
        found = time.monotonic()
        change = self._change(standing, visited, monitor)
        registered = tuple(view.name for view, _ in change.added if view.name not in self._posed)
        self._apply(change)
        self._visited, self._generation, self._dirty = visited, standing.generation, True
        return SceneUpdate(
            registered=registered,
            waiting=self.waiting,
            moved=len(change.moved),
            new_gaussians=len(change.seeds),
            iterations=self.target_iteration,
            warnings=standing.warnings + change.warnings,
            seconds={"poses": found - began, "model": time.monotonic() - found},
        )

    def train(self, monitor: Monitor) -> None:
        """Go on up to ``target_iteration``. Raises ``Cancelled``, having saved, and ``TrainingError``."""
        trainer = self._model()
        if trainer.iteration >= self.target_iteration:
            return
        self._dirty = True
        train_saving(trainer, self.target_iteration, monitor, self.save, _SAVE_EVERY_S)

    def save(self) -> None:
        """Commit the state: whatever was done since the last time is on disk, whole, or not at all."""
        memory = SceneMemory(
            visited=self._visited,
            views=tuple(self._posed.values()),
            initial_views=self._initial_views,
            begun_points=self._begun_points,
            generation=self._generation,
        ).model_dump(mode="json")
        if self._trainer is None:
            write_checkpoint(self._files.checkpoint, {}, {"owner": memory})
        else:
            seeded = torch.from_numpy(self._seeded)
            self._trainer.save(self._files.checkpoint, owner_tensors={"seeded": seeded}, owner_state=memory)
        self._dirty = False

    def localise(self, names: Sequence[str], monitor: Monitor) -> dict[str, TrainingView]:
        """Photographs that are not part of the scene, placed in it for comparison; it does not change.

        Their cameras, in the model frame, and their images at the training size; those that cannot be placed
        are left out. Nothing that is learnt here reaches the model.
        """
        posed = self._source.localise(names, monitor)
        return {name: self._photograph(posed[name]) for name in names if name in posed}

    def expected_camera(self, name: str) -> PinholeCamera:
        """The pinhole camera, at the training size, that view ``name`` of the dataset will have.

        With known poses it is the dataset's; else that of most registered views of the photograph's size,
        because the photograph itself must not be looked at before it is visited. Where there is none such,
        it is the dataset's.
        """
        expected = self.dataset.by_name[name].camera
        if self.settings.poses == "known":
            return self._photographs.pinhole(expected)
        usual = self._usual_cameras.get((expected.width, expected.height), expected)
        return self._photographs.pinhole(usual)

    def _model(self) -> Trainer:
        if self._trainer is None:
            raise TrainingError(
                f"None of the {len(self._visited)} visited photographs has a camera yet.",
                hint="Add photographs that overlap those that were visited.",
            )
        return self._trainer

    def _change(self, standing: Standing, visited: Sequence[str], monitor: Monitor) -> _Change:
        """What the standing poses and points ask for; reads photographs, changes nothing."""
        anew = self._trainer is None or self._outgrown(standing)
        order = {name: place for place, name in enumerate(visited)}
        loaded = {} if self._trainer is None else {view.name: view for view in self._trainer.views}
        added, moved = [], []
        views = sorted(standing.views, key=lambda view: order[view.name])
        for done, view in enumerate(views, start=1):
            monitor.check()
            before = None if anew else self._posed.get(view.name)
            if before is None:
                added.append((view, self._photograph(view)))
            elif not self._photographs.same_image(before.camera, view.camera):
                moved.append((view, self._photograph(view)))
            elif not np.array_equal(before.camera_from_model.matrix, view.camera_from_model.matrix):
                kept = replace(view, camera=before.camera)
                moved.append((kept, replace(loaded[view.name], camera_from_model=view.camera_from_model)))
            if before is None:
                monitor.report("load", done, len(views))
        lost = frozenset(self._posed).difference(view.name for view in views)
        if anew:
            begun_points = len(standing.points)
            seeds, warnings = self._first_seeds(standing, [view for _, view in added])
        else:
            begun_points = self._begun_points
            seeds, warnings = self._further_seeds(standing), ()
        return _Change(tuple(added), tuple(moved), lost, seeds, warnings, anew, begun_points)

    def _photograph(self, view: AnyView) -> TrainingView:
        return self._photographs.load(view.name, view.camera, view.camera_from_model)

    def _outgrown(self, standing: Standing) -> bool:
        """Whether the views share so many more points now that a new model is worth its training."""
        return len(standing.points) >= max(MIN_POINTS, POINTS_GROWTH * self._begun_points)

    def _further_seeds(self, standing: Standing) -> Seeds:
        means = self._model().gaussians.means.detach().cpu().numpy()
        occupied = np.concatenate([means, self._seeded]).astype(np.float64)
        return seeds_on_free_points(
            standing.points, occupied, self.settings.training.max_gaussians - len(means)
        )

    def _first_seeds(
        self, standing: Standing, views: Sequence[TrainingView]
    ) -> tuple[Seeds, tuple[str, ...]]:
        """Where a model begins, and what to say of it."""
        room = self.settings.training.max_gaussians
        seeds = seeds_on_free_points(standing.points, np.zeros((0, 3)), room)
        if len(seeds) >= MIN_POINTS or not views:
            warning = f"The model begins anew on the {len(seeds)} points that {len(views)} views share."
            return seeds, (warning,) if self._trainer else ()
        guesses = guessed_seeds(views, room - len(seeds), self.settings.seed)
        warning = (
            f"The first {len(views)} views share only {len(seeds)} points: "
            f"{len(guesses)} Gaussians start at guessed depths."
        )
        return seeds.and_also(guesses), (warning,)

    def _apply(self, change: _Change) -> None:
        views = [view for _, view in change.added]
        if change.anew:
            if not views:
                return
            gaussians = change.seeds.gaussians(self.settings.training.sh_degree)
            schedule, seed = self.settings.schedule, self.settings.seed
            if self._trainer is None:
                self._initial_views = len(views)
            self._trainer = Trainer(views, gaussians, schedule, self.rasterizer, seed)
            self._seeded, self._posed = self._seeded[:0], {}
        else:
            trainer = self._model()
            trainer.update_views([view for _, view in change.moved])
            trainer.add_views(views)
            trainer.drop_views(change.lost)
            if len(change.seeds):
                trainer.add_gaussians(change.seeds.gaussians(self.settings.training.sh_degree))
        self._begun_points = change.begun_points
        self._posed.update({view.name: view for view, _ in (*change.moved, *change.added)})
        self._posed = {name: view for name, view in self._posed.items() if name not in change.lost}
        self._usual_cameras = _usual_cameras(self._posed.values())
        self._seeded = np.concatenate([self._seeded, change.seeds.points.xyz.astype(np.float32)])

    def _resume(self, monitor: Monitor) -> None:
        tensors, state = read_checkpoint(self._files.checkpoint)
        memory = self._files.memory(state)
        self._visited, self._generation = memory.visited, memory.generation
        self._posed = {view.name: view for view in memory.views}
        self._usual_cameras = _usual_cameras(self._posed.values())
        self._initial_views, self._begun_points = memory.initial_views, memory.begun_points
        if not self._posed:
            return
        self._seeded = tensors["owner.seeded"].numpy()
        views = []
        for done, view in enumerate(self._posed.values(), start=1):
            monitor.check()
            views.append(self._photograph(view))
            monitor.report("load", done, len(self._posed))
        self._trainer = Trainer.resume(self._files.checkpoint, views, self.rasterizer)


def _usual_cameras(views: Iterable[AnyView]) -> dict[tuple[int, int], Camera]:
    """Image size → the camera that most views of that size have, the earliest of equals."""
    by_size: dict[tuple[int, int], Counter[Camera]] = {}
    for view in views:
        by_size.setdefault((view.camera.width, view.camera.height), Counter())[view.camera] += 1
    return {size: cameras.most_common(1)[0][0] for size, cameras in by_size.items()}


def _pose_source(
    files: SceneFiles, dataset: Dataset, settings: SceneSettings, monitor: Monitor
) -> PoseSource:
    if settings.poses == "known":
        return KnownPoses(files.sfm, dataset, settings.sfm)
    return SfmPoses(files.sfm, dataset, settings.sfm, monitor)
