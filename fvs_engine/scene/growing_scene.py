"""A scene over time: images are registered, Gaussians are added where new points are, training goes on."""

import time
from collections import Counter
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from fvs_engine.errors import InvalidInputError, TrainingError
from fvs_engine.geometry import Camera, PinholeCamera
from fvs_engine.monitor import Monitor
from fvs_engine.scene.dataset import Dataset
from fvs_engine.scene.photographs import Photographs
from fvs_engine.scene.pose_source import PoseSource, open_pose_source
from fvs_engine.scene.scene_files import SceneFiles, SceneState
from fvs_engine.scene.scene_update import SceneUpdate
from fvs_engine.scene.seeding import Seeds, guessed_seeds, seeds_on_free_points
from fvs_engine.scene.settings import SceneSettings
from fvs_engine.sfm.growing.update import PoseUpdate
from fvs_engine.sfm.pose_priors import PosePriors
from fvs_engine.sfm.reconstruction import PointCloud
from fvs_engine.splat.checkpoint import read_checkpoint, write_checkpoint
from fvs_engine.splat.gaussians import Gaussians
from fvs_engine.splat.raster import Rasterizer
from fvs_engine.splat.session import train_saving
from fvs_engine.splat.settings import coarse_to_fine
from fvs_engine.splat.trainer import Trainer
from fvs_engine.splat.views import TrainingView
from fvs_engine.views import AnyView

MIN_POINTS = 100
"""With fewer sparse points than this a new model also starts from guessed seeds."""

POINTS_GROWTH = 2.0
"""A model is retrained from scratch when its views share this many times the points that it started from.

A model trained on few views fits later ones badly. Measured on *bonsai*, four views far from one
another and then sixteen more: 18.5 dB on held-out views when a model started from 1,000 points is never
restarted, 22.0 dB when it last was at 18 views, as by this rule, 22.2 dB when all views are there from the
start (ADR 6).
"""

_SAVE_EVERY_S = 60.0


@dataclass(frozen=True, eq=False)
class _ModelEdit:
    """Change of the trained model that follows from a pose update; the images are loaded.

    ``restart``: a new model replaces the current one, if any; then all views are ``added``.
    ``points_at_start``: see ``SceneState``.
    """

    added: tuple[tuple[AnyView, TrainingView], ...]
    moved: tuple[tuple[AnyView, TrainingView], ...]
    lost: frozenset[str]
    seeds: Seeds
    warnings: tuple[str, ...]
    restart: bool
    points_at_start: int


class GrowingScene:
    """A dataset's growing scene in a folder of its own; a complete state survives a kill at any moment.

    A state is what the last ``save`` wrote (``train`` saves every minute, ``add`` before it begins).
    Repeating the calls that followed it, after a kill, gives the same scene bit by bit (on the CPU, with
    ``settings.sfm.threads=1`` where poses are estimated). Only one process at a time may use a folder.

    The cost of an added view grows little with the number of views: its image is read, and new points are
    compared with all points and Gaussians. Images stay in memory, and are read again only if their camera's
    intrinsics changed visibly. For the cost of poses and points see ``GrowingReconstruction`` and
    ``KnownPoses``. The exception: when the views share twice the points that the model started from, it is
    retrained from scratch, and ``train`` runs the whole schedule again.
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
        self._posed: dict[str, AnyView] = {}  # in the order of the trainer's views, with distortion
        self._seeded: NDArray[np.float32] = np.zeros((0, 3), np.float32)
        self._usual_cameras: dict[tuple[int, int], Camera] = {}  # of the registered views, by image size
        self._initial_views = 0
        self._points_at_start = 0
        self._generation = 0
        self._dirty = False

    @classmethod
    def open(
        cls, folder: Path, dataset: Dataset, settings: SceneSettings, rasterizer: Rasterizer, monitor: Monitor
    ) -> "GrowingScene":
        """Create a scene in ``folder``, or resume the one in it.

        Raises ``InvalidInputError`` when the folder holds a scene of another dataset or other settings,
        ``StorageError`` when it cannot be read or written.
        """
        files = SceneFiles(folder)
        files.claim(dataset, settings)
        source = open_pose_source(files.sfm, dataset, settings, monitor)
        scene = cls(files, dataset, settings, rasterizer, source)
        if files.checkpoint.exists():
            scene._resume(monitor)
        return scene

    @property
    def visited(self) -> tuple[str, ...]:
        """The names of all added images, in the order of their visit."""
        return self._visited

    @property
    def views(self) -> tuple[TrainingView, ...]:
        """The registered views in order of registration.

        Each has its name, its pinhole camera at the training size, ``camera_from_model``, and its image.
        """
        return self._trainer.views if self._trainer else ()

    @property
    def unregistered(self) -> tuple[str, ...]:
        """Visited images without a pose, in the order of their visit."""
        return tuple(name for name in self._visited if name not in self._posed)

    @property
    def quarantined(self) -> Mapping[str, str]:
        """Visited images that are left out because they crash structure from motion → the reasons."""
        return self._source.quarantined

    @property
    def generation(self) -> int:
        """The pose source's generation after the last ``add``."""
        return self._generation

    @property
    def model_dir(self) -> Path | None:
        """The folder of the COLMAP model with the current poses; None when the source has none."""
        return self._source.model_dir

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
        """The number of iterations done."""
        return self._trainer.iteration if self._trainer else 0

    @property
    def is_reduced(self) -> bool:
        """Whether the model is being trained on reduced images: its renders are blurred."""
        return self._model().is_reduced

    @property
    def target_iteration(self) -> int:
        """The iteration up to which the schedule goes with the present views; 0 before the first."""
        return 0 if self._trainer is None else self._iterations_for(len(self.views))

    def add(
        self,
        names: Sequence[str],
        monitor: Monitor,
        priors: PosePriors | None = None,
        *,
        removed: Collection[str] = (),
    ) -> SceneUpdate:
        """Visit the images ``names``: register them, and seed Gaussians where new points are.

        Images ``removed`` are first taken out, as if they had never been visited; those that are in
        ``names``, too, are added again. When one of them was trained on, the model is retrained from
        scratch: there is no other way to remove their influence.

        ``priors``: pose priors for a dataset without poses, those of earlier images included; by
        default the GPS positions in their EXIF. Poses that contradict them are rejected. Visited names are
        ignored. When this raises, the scene does not change.

        Raises ``InvalidInputError`` for names that are not in the dataset, and what the pose source raises.
        """
        unknown = [name for name in names if name not in self.dataset.by_name]
        if unknown and not self.dataset.arriving:
            raise InvalidInputError(
                f"{self.dataset.name} has no view {unknown[0]}.", hint="Give names of the dataset's views."
            )
        gone = set(removed).intersection((*self._visited, *self.quarantined))
        left = tuple(name for name in self._visited if name not in gone)
        new = tuple(name for name in dict.fromkeys(names) if name not in left)
        if not new and not gone:
            return SceneUpdate((), self.unregistered, 0, 0, self.target_iteration, (), {})
        if self._dirty:
            self.save()  # the pose source may be at most one update ahead of the checkpoint
        began = time.monotonic()
        visited = left + new
        if gone:
            self._source.release(gone)
        # Before a kill the source may have committed these images: changes are relative to the scene's views.
        update = self._source.update(visited, self._posed.values(), monitor, priors)
        found = time.monotonic()
        edit = self._edit(update, visited, monitor, restart=not gone.isdisjoint(self._posed))
        self._apply(edit)
        self._visited, self._generation, self._dirty = visited, update.generation, True
        return SceneUpdate(
            registered=update.registered,
            unregistered=update.unregistered,
            moved=len(edit.moved),
            new_gaussians=len(edit.seeds),
            iterations=self.target_iteration,
            warnings=update.warnings + edit.warnings,
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
        """Commit the state: after a kill the folder has this state or the one before."""
        state = SceneState(
            visited=self._visited,
            views=tuple(self._posed.values()),
            initial_views=self._initial_views,
            points_at_start=self._points_at_start,
            generation=self._generation,
        ).model_dump(mode="json")
        if self._trainer is None:
            write_checkpoint(self._files.checkpoint, {}, {"owner": state})
        else:
            seeded = torch.from_numpy(self._seeded)
            self._trainer.save(self._files.checkpoint, owner_tensors={"seeded": seeded}, owner_state=state)
        self._dirty = False

    def localise(self, names: Sequence[str], monitor: Monitor) -> dict[str, TrainingView]:
        """Localise images that are not part of the scene, for evaluation; the scene does not change.

        Returns their views in the model frame with their images at the training size; those without a pose
        are left out.
        """
        posed = self._source.localise(names, monitor)
        return {name: self._load(posed[name]) for name in names if name in posed}

    def expected_camera(self, name: str) -> PinholeCamera:
        """The pinhole camera, at the training size, that view ``name`` of the dataset will have.

        With known poses it is the dataset's; else that of most registered views of the image's size, because
        the image must not be used before its visit. Without one, it is the dataset's.
        """
        expected = self.dataset.by_name[name].camera
        if self.settings.poses == "known":
            return self._photographs.pinhole(expected)
        usual = self._usual_cameras.get((expected.width, expected.height), expected)
        return self._photographs.pinhole(usual)

    def _model(self) -> Trainer:
        if self._trainer is None:
            raise TrainingError(
                f"None of the {len(self._visited)} visited images has a pose yet.",
                hint="Add images that overlap those that were visited.",
            )
        return self._trainer

    def _edit(
        self, update: PoseUpdate, visited: Sequence[str], monitor: Monitor, *, restart: bool
    ) -> _ModelEdit:
        """Load the images of new and changed views and find seeds; changes nothing."""
        restart = restart or self._trainer is None or self._outgrown(update.points)
        current = {view.name: view for view in update.views}
        new = current.keys() if restart else set(update.registered)
        names = [name for name in visited if name in new]
        added = []
        for done, name in enumerate(names, start=1):
            monitor.check()
            added.append((current[name], self._load(current[name])))
            monitor.report("load", done, len(names))
        if restart:
            moved = []
            points_at_start = len(update.points)
            seeds, warnings = self._first_seeds(update.points, [view for _, view in added])
        else:
            moved = self._moved([current[name] for name in visited if name in update.moved], monitor)
            points_at_start = self._points_at_start
            seeds, warnings = self._further_seeds(update.points), ()
        return _ModelEdit(tuple(added), tuple(moved), update.lost, seeds, warnings, restart, points_at_start)

    def _moved(self, views: Sequence[AnyView], monitor: Monitor) -> list[tuple[AnyView, TrainingView]]:
        """The changed ``views`` whose training view changes; an image is loaded only if its pixels do."""
        loaded = {view.name: view for view in self._model().views}
        moved = []
        for view in views:
            monitor.check()
            before = self._posed[view.name]
            if not self._photographs.same_image(before.camera, view.camera):
                moved.append((view, self._load(view)))
            elif not np.array_equal(before.camera_from_model.matrix, view.camera_from_model.matrix):
                kept = replace(view, camera=before.camera)
                moved.append((kept, replace(loaded[view.name], camera_from_model=view.camera_from_model)))
        return moved

    def _iterations_for(self, views: int) -> int:
        """The iterations of the schedule for a number of views."""
        more = max(0, views - self._initial_views)
        return self.settings.initial_iterations + self.settings.iterations_per_view * more

    def _load(self, view: AnyView) -> TrainingView:
        return self._photographs.load(view.name, view.camera, view.camera_from_model)

    def _outgrown(self, points: PointCloud) -> bool:
        """Whether the shared points have grown enough for retraining from scratch."""
        return len(points) >= max(MIN_POINTS, POINTS_GROWTH * self._points_at_start)

    def _further_seeds(self, points: PointCloud) -> Seeds:
        means = self._model().gaussians.means.detach().cpu().numpy()
        occupied = np.concatenate([means, self._seeded]).astype(np.float64)
        return seeds_on_free_points(points, occupied, self.settings.training.max_gaussians - len(means))

    def _first_seeds(
        self, points: PointCloud, views: Sequence[TrainingView]
    ) -> tuple[Seeds, tuple[str, ...]]:
        """The seeds of a new model, and warnings about them."""
        room = self.settings.training.max_gaussians
        seeds = seeds_on_free_points(points, np.zeros((0, 3)), room)
        if len(seeds) >= MIN_POINTS or not views:
            warning = (
                f"The model is retrained from scratch on {len(seeds)} points that {len(views)} views share."
            )
            return seeds, (warning,) if self._trainer else ()
        guesses = guessed_seeds(views, room - len(seeds), self.settings.seed)
        warning = (
            f"The first {len(views)} views share only {len(seeds)} points: "
            f"{len(guesses)} Gaussians start at guessed depths."
        )
        return seeds.and_also(guesses), (warning,)

    def _apply(self, edit: _ModelEdit) -> None:
        views = [view for _, view in edit.added]
        if edit.restart:
            if not views:
                self._trainer, self._posed = None, {}
                return
            gaussians = edit.seeds.gaussians(self.settings.training.sh_degree)
            if self._trainer is None:
                self._initial_views = len(views)
            schedule = self.settings.schedule
            if self.settings.coarse_to_fine:
                levels = coarse_to_fine(self._iterations_for(len(views)))
                schedule = schedule.model_copy(update={"levels": levels})
            self._trainer = Trainer(views, gaussians, schedule, self.rasterizer, self.settings.seed)
            self._seeded, self._posed = self._seeded[:0], {}
        else:
            trainer = self._model()
            trainer.update_views([view for _, view in edit.moved])
            trainer.add_views(views)
            trainer.drop_views(edit.lost)
            if len(edit.seeds):
                trainer.add_gaussians(edit.seeds.gaussians(self.settings.training.sh_degree))
        self._points_at_start = edit.points_at_start
        self._posed.update({view.name: view for view, _ in (*edit.moved, *edit.added)})
        self._posed = {name: view for name, view in self._posed.items() if name not in edit.lost}
        self._usual_cameras = _usual_cameras(self._posed.values())
        self._seeded = np.concatenate([self._seeded, edit.seeds.points.xyz.astype(np.float32)])

    def _resume(self, monitor: Monitor) -> None:
        tensors, state = read_checkpoint(self._files.checkpoint)
        saved = self._files.state(state)
        self._visited, self._generation = saved.visited, saved.generation
        self._posed = {view.name: view for view in saved.views}
        self._usual_cameras = _usual_cameras(self._posed.values())
        self._initial_views, self._points_at_start = saved.initial_views, saved.points_at_start
        if not self._posed:
            return
        self._seeded = tensors["owner.seeded"].numpy()
        views = []
        for done, view in enumerate(self._posed.values(), start=1):
            monitor.check()
            views.append(self._load(view))
            monitor.report("load", done, len(self._posed))
        self._trainer = Trainer.resume(self._files.checkpoint, views, self.rasterizer)


def _usual_cameras(views: Iterable[AnyView]) -> dict[tuple[int, int], Camera]:
    """Image size → the camera that most views of that size have, the earliest of equals."""
    by_size: dict[tuple[int, int], Counter[Camera]] = {}
    for view in views:
        by_size.setdefault((view.camera.width, view.camera.height), Counter())[view.camera] += 1
    return {size: cameras.most_common(1)[0][0] for size, cameras in by_size.items()}
