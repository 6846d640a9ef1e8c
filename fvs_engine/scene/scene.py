"""A scene: images are registered as they arrive, and the models are retrained on all of them."""

import time
from collections import Counter
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from fvs_engine.errors import InvalidInputError, TrainingError
from fvs_engine.geometry import Camera, PinholeCamera
from fvs_engine.monitor import Monitor
from fvs_engine.plan.familiarity import Observations
from fvs_engine.scene.dataset import Dataset
from fvs_engine.scene.models import SceneModels
from fvs_engine.scene.photographs import Photographs
from fvs_engine.scene.pose_source import PoseSource, open_pose_source
from fvs_engine.scene.scene_files import SceneFiles, SceneState
from fvs_engine.scene.scene_model import SceneModel
from fvs_engine.scene.seeding import MIN_POINTS, colored
from fvs_engine.scene.settings import ModelQuality, SceneSettings
from fvs_engine.scene.sparse_points import read_observations
from fvs_engine.sfm.growing.update import PoseUpdate
from fvs_engine.sfm.pose_priors import PosePriors
from fvs_engine.sfm.reconstruction import PointCloud
from fvs_engine.splat.raster import Rasterizer
from fvs_engine.splat.views import TrainingView
from fvs_engine.views import AnyView
from fvs_schema.findings import Finding, FindingCode
from fvs_schema.stages import Stage


@dataclass(frozen=True)
class SceneUpdate:
    """The result of one ``add``.

    ``registered``: images that have a pose now and had none before; ``unregistered``: all visited images
    without one; ``moved``: number of views whose camera or pose changed; ``seconds``: for the poses, and for
    loading the images.
    """

    registered: tuple[str, ...]
    unregistered: tuple[str, ...]
    moved: int
    warnings: tuple[Finding, ...]
    seconds: Mapping[str, float]


class Scene:
    """A dataset's scene in a folder of its own; a complete state survives a kill at any moment.

    A model depends on the registered views, their sparse points and the settings alone: neither on the order
    in which images were added nor on earlier models. ``add`` changes the views; ``train`` makes a model of
    the present ones, unless it is there already.

    ``train`` saves every minute, ``add`` before it begins. Repeating the calls that followed the last save,
    after a kill, gives the same scene bit by bit (on the CPU, with ``settings.sfm.threads=1`` where poses are
    estimated). Only one process at a time may use a folder.

    Images stay in memory, and are reread only if their camera's intrinsics changed visibly. For the cost of
    poses and points see ``GrowingReconstruction`` and ``KnownPoses``.
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
        self._visited: tuple[str, ...] = ()
        self._posed: dict[str, AnyView] = {}  # by name, in the order of names, with distortion
        self._views: tuple[TrainingView, ...] = ()  # in the same order
        self._points = self._starts = PointCloud.empty()
        self._models = SceneModels(files, settings, rasterizer, self._observations)
        self._usual_cameras: dict[tuple[int, int], Camera] = {}  # of the registered views, by image size
        self._generation = 0
        self._dirty = False

    @classmethod
    def open(
        cls, folder: Path, dataset: Dataset, settings: SceneSettings, rasterizer: Rasterizer, monitor: Monitor
    ) -> "Scene":
        """Create a scene in ``folder``, or resume the one in it.

        Views whose photograph was deleted from an ``arriving`` dataset are not resumed; they stay in
        ``visited`` until they are ``removed``.
        Raises ``InvalidInputError`` when the folder holds a scene of another dataset or other settings,
        ``StorageError`` when it cannot be read or written.
        """
        files = SceneFiles(folder)
        files.claim(dataset, settings)
        source = open_pose_source(files.sfm, dataset, settings, monitor)
        scene = cls(files, dataset, settings, rasterizer, source)
        scene._resume(monitor)
        return scene

    @property
    def visited(self) -> tuple[str, ...]:
        """The names of all added images, in the order of their visit."""
        return self._visited

    @property
    def views(self) -> tuple[TrainingView, ...]:
        """The registered views in the order of their names.

        Each has its name, its pinhole camera at the training size, ``camera_from_model``, and its image.
        """
        return self._views

    @property
    def points(self) -> PointCloud:
        """The sparse points of the model that registered views share. Gaussians start at others, too."""
        return self._points

    @property
    def unregistered(self) -> tuple[str, ...]:
        """Visited images without a pose, in the order of their visit."""
        return tuple(name for name in self._visited if name not in self._posed)

    @property
    def why_unregistered(self) -> Mapping[str, Finding]:
        """Visited images without a pose → the reason, as far as it is known."""
        return self._source.why_unregistered

    @property
    def quarantined(self) -> Mapping[str, Finding]:
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

    def _observations(self) -> Observations | None:
        """The sparse points and who saw them; None where poses are known."""
        return None if self.model_dir is None else read_observations(self.model_dir)

    def add(
        self,
        names: Sequence[str],
        monitor: Monitor,
        priors: PosePriors | None = None,
        *,
        removed: Collection[str] = (),
    ) -> SceneUpdate:
        """Visit the images ``names``, which registers them.

        Images ``removed`` are first taken out, as if they had never been visited; images that are
        also in ``names`` are added again.

        ``priors``: pose priors for a dataset without poses, those of earlier images included; by default the
        positions in their metadata. Poses that contradict them are rejected. Visited names are
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
        if not new and not gone and self._source.has(self._visited):
            return SceneUpdate((), self.unregistered, 0, self._scarcity(), {})
        if self._dirty:
            self.save()  # the pose source may be at most one update ahead of the state
        began = time.monotonic()
        visited = left + new
        if gone:
            self._source.release(gone)
        # The source may have committed these images before a kill: changes are relative to the scene's views.
        update = self._source.update(visited, self._posed.values(), monitor, priors)
        found = time.monotonic()
        posed, views, moved = self._load(update, monitor)
        self._visited, self._generation, self._dirty = visited, update.generation, True
        starts = update.points
        if update.two_view_points is not None:
            starts = starts.and_also(colored(update.two_view_points, views))
        self._set(posed, views, update.points, starts)
        return SceneUpdate(
            registered=update.registered,
            unregistered=update.unregistered,
            moved=moved,
            warnings=update.warnings + self._scarcity(),
            seconds={"poses": found - began, "images": time.monotonic() - found},
        )

    def is_trained(self, quality: ModelQuality) -> bool:
        """Whether there is a finished model of the present views."""
        return self._models.is_trained(quality)

    def train(self, quality: ModelQuality, monitor: Monitor) -> SceneModel:
        """Return the model of the present views; train it, or finish its training, if necessary.

        Raises ``Cancelled``, having saved, and ``TrainingError``, also when no view is registered.
        """
        self._require_views()
        if self._dirty:
            self.save()
        return self._models.train(quality, monitor)

    def train_again(self, seed: int, monitor: Monitor) -> SceneModel:
        """Train a full model of the same views with another seed; it is not stored.

        Raises ``Cancelled``, without having saved, and ``TrainingError``, also when no view is registered.
        """
        self._require_views()
        return self._models.train_again(seed, monitor)

    def _require_views(self) -> None:
        if not self._views:
            raise TrainingError(
                f"None of the {len(self._visited)} visited images has a pose yet.",
                hint="Add images that overlap those that were visited.",
            )

    def save(self) -> None:
        """Commit the visits and views: after a kill the folder holds this state or the previous one."""
        state = SceneState(
            visited=self._visited,
            views=tuple(self._posed.values()),
            generation=self._generation,
            two_view_points=len(self._starts) - len(self._points),
        )
        self._files.write_state(state, self._starts)
        self._dirty = False
        self._source.acknowledge()

    def localise(self, names: Sequence[str], monitor: Monitor) -> dict[str, TrainingView]:
        """Localise images that are not part of the scene, for evaluation; the scene does not change.

        Returns their views in the model frame with their images at the training size; those without a pose
        are left out.
        """
        posed = self._source.localise(names, monitor)
        views = (posed[name] for name in names if name in posed)
        return {
            view.name: self._photographs.load(view.name, view.camera, view.camera_from_model)
            for view in views
        }

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

    def _load(
        self, update: PoseUpdate, monitor: Monitor
    ) -> tuple[dict[str, AnyView], tuple[TrainingView, ...], int]:
        """The views of an update, without and with images, by name, and the number that have moved.

        An image is read only if it is new, or if its camera's intrinsics changed visibly.
        """
        loaded = {view.name: view for view in self._views}
        ordered = sorted(update.views, key=lambda view: view.name)
        posed, views, moved = {}, [], 0
        for done, view in enumerate(ordered, start=1):
            monitor.check()
            before = self._posed.get(view.name)
            if before is None or not self._photographs.same_image(before.camera, view.camera):
                training = self._photographs.load(view.name, view.camera, view.camera_from_model)
                moved += before is not None
            else:
                view = replace(view, camera=before.camera)
                training = replace(loaded[view.name], camera_from_model=view.camera_from_model)
                moved += not np.array_equal(before.camera_from_model.matrix, view.camera_from_model.matrix)
            posed[view.name] = view
            views.append(training)
            monitor.report(Stage.LOAD, done, len(ordered))
        return posed, tuple(views), moved

    def _scarcity(self) -> tuple[Finding, ...]:
        """The finding when models start from guesses."""
        if not self._views or len(self._starts) >= MIN_POINTS:
            return ()
        return (Finding.of(FindingCode.FEW_STARTS, views=len(self._views), points=len(self._starts)),)

    def _set(
        self,
        posed: Mapping[str, AnyView],
        views: Sequence[TrainingView],
        points: PointCloud,
        starts: PointCloud,
    ) -> None:
        """Replace the views, sorted by name, and the points; ``starts`` are these and the two-view points."""
        self._posed, self._views, self._points, self._starts = dict(posed), tuple(views), points, starts
        self._usual_cameras = _usual_cameras(posed.values())
        self._models.follow(self._posed, self._views, starts)

    def _resume(self, monitor: Monitor) -> None:
        saved = self._files.read_state()
        if saved is None:
            return
        state, starts = saved
        self._visited, self._generation = state.visited, state.generation
        posed = {
            view.name: view
            for view in state.views
            if not self.dataset.arriving or (self.dataset.image_dir / view.name).is_file()
        }
        views = self._photographs.load_all(tuple(posed.values()), monitor)
        shared = len(starts) - state.two_view_points
        self._set(posed, views, PointCloud(starts.xyz[:shared], starts.colors[:shared]), starts)


def _usual_cameras(views: Iterable[AnyView]) -> dict[tuple[int, int], Camera]:
    """Image size → the camera that most views of that size have, the earliest of equals."""
    by_size: dict[tuple[int, int], Counter[Camera]] = {}
    for view in views:
        by_size.setdefault((view.camera.width, view.camera.height), Counter())[view.camera] += 1
    return {size: cameras.most_common(1)[0][0] for size, cameras in by_size.items()}
