"""Growing scenes whose views are registered late, move, or are removed."""

from collections.abc import Callable, Collection, Iterable, Sequence
from pathlib import Path

import numpy as np
import pytest
from same_scenes import assert_same, assert_same_scenes

from fvs_engine.errors import Cancelled, TrainingError
from fvs_engine.geometry import PinholeCamera, RigidTransform
from fvs_engine.monitor import Monitor
from fvs_engine.scene.dataset import Dataset
from fvs_engine.scene.scene import Scene
from fvs_engine.scene.scene_files import SceneFiles
from fvs_engine.scene.settings import SceneSettings
from fvs_engine.sfm.growing.update import PoseUpdate
from fvs_engine.sfm.pose_priors import PosePriors
from fvs_engine.sfm.reconstruction import PointCloud
from fvs_engine.splat.raster import Rasterizer
from fvs_engine.views import AnyView, View
from fvs_schema.findings import Finding, FindingCode

Settings = Callable[..., SceneSettings]
FIRST = ("4.png", "0.png", "2.png", "6.png")


class MovingPoses:
    """A pose source as structure from motion is one: views come late and move, points are renumbered."""

    def __init__(self, dataset: Dataset) -> None:
        self.dataset = dataset
        self.late: set[str] = set()
        self.shift = 0.0
        self.camera: PinholeCamera | None = None
        self.points = dataset.points.cloud.xyz if dataset.points else np.zeros((0, 3))
        self.quarantined: dict[str, Finding] = {}
        self.renumbers = True
        self.images: set[str] = set()
        self.acknowledged = 0

    model_dir = None

    def has(self, visited: Collection[str]) -> bool:
        return self.images == set(visited)

    def acknowledge(self) -> None:
        self.acknowledged += 1

    def release(self, names: Collection[str]) -> None:
        for name in names:
            self.quarantined.pop(name, None)

    def update(
        self,
        visited: Sequence[str],
        known: Iterable[AnyView],
        monitor: Monitor,
        priors: PosePriors | None = None,  # noqa: ARG002
    ) -> PoseUpdate:
        self.images = set(visited)
        monitor.check()
        views = [self._posed(name) for name in visited if name not in self.late]
        draw = np.random.default_rng(len(visited) if self.renumbers else 0)
        xyz = draw.permutation(self.points)
        points = PointCloud(xyz, np.full(xyz.shape, 128, np.uint8))
        return PoseUpdate.between(known, views, points, visited, len(visited))

    def localise(self, names: Sequence[str], monitor: Monitor) -> dict[str, AnyView]:
        monitor.check()
        return {name: self._posed(name) for name in names if name not in self.late}

    def _posed(self, name: str) -> AnyView:
        view = self.dataset.by_name[name]
        moved = RigidTransform(
            view.camera_from_model.rotation,
            view.camera_from_model.translation + np.array([self.shift, 0.0, 0.0]),
        )
        return View(name, self.camera or view.camera, moved)


@pytest.fixture
def moving(
    tmp_path: Path, ball: Dataset, quick_settings: Settings, cpu: Rasterizer
) -> tuple[Scene, MovingPoses]:
    source = MovingPoses(ball)
    (tmp_path / "moving").mkdir()
    return Scene(SceneFiles(tmp_path / "moving"), ball, quick_settings(), cpu, source), source


def test_a_photograph_without_a_camera_waits_and_joins_later(
    moving: tuple[Scene, MovingPoses], cpu: Rasterizer
) -> None:
    scene, source = moving
    source.late = {"2.png"}
    assert scene.add(FIRST, Monitor()).unregistered == ("2.png",)
    assert [view.name for view in scene.views] == ["0.png", "4.png", "6.png"]
    source.late = set()
    update = scene.add(["7.png"], Monitor())
    assert update.registered == ("2.png", "7.png")
    assert update.unregistered == ()
    scene.train("full", Monitor())
    resumed = Scene(scene._files, scene.dataset, scene.settings, cpu, source)
    resumed._resume(Monitor())
    assert_same_scenes(scene, resumed)


def test_an_image_that_is_not_registered_changes_no_model(moving: tuple[Scene, MovingPoses]) -> None:
    scene, source = moving
    source.renumbers = False
    scene.add(FIRST, Monitor())
    scene.train("full", Monitor())
    source.late = {"7.png"}
    assert scene.add(["7.png"], Monitor()).unregistered == ("7.png",)
    assert scene.is_trained("full")
    source.late = set()
    scene.add(["8.png"], Monitor())
    assert not scene.is_trained("full")


def test_a_view_that_loses_its_camera_waits_again(moving: tuple[Scene, MovingPoses]) -> None:
    scene, source = moving
    scene.add(FIRST, Monitor())
    source.late = {"0.png"}
    update = scene.add(["7.png"], Monitor())
    assert (update.registered, update.unregistered) == (("7.png",), ("0.png",))
    assert [view.name for view in scene.views] == ["2.png", "4.png", "6.png", "7.png"]
    source.late = set()
    assert scene.add(["8.png"], Monitor()).registered == ("0.png", "8.png")


def test_a_scene_without_any_camera_says_so_and_waits(
    moving: tuple[Scene, MovingPoses], cpu: Rasterizer
) -> None:
    scene, source = moving
    source.late = {"0.png", "5.png"}
    assert scene.add(["0.png", "5.png"], Monitor()).registered == ()
    assert scene.views == ()
    with pytest.raises(TrainingError, match="None of the 2 visited"):
        scene.train("quick", Monitor())
    scene.save()
    resumed = Scene(scene._files, scene.dataset, scene.settings, cpu, source)
    resumed._resume(Monitor())
    assert resumed.unregistered == ("0.png", "5.png")
    source.late = set()
    assert resumed.add(["1.png"], Monitor()).registered == ("0.png", "5.png", "1.png")


def test_cameras_that_moved_are_followed_and_their_images_are_not_read_again(
    moving: tuple[Scene, MovingPoses],
) -> None:
    scene, source = moving
    scene.add(FIRST, Monitor())
    images = {view.name: view.image for view in scene.views}
    source.shift = 0.01
    assert scene.add(["8.png"], Monitor()).moved == 4
    assert all(view.camera_from_model.translation[0] == 0.01 for view in scene.views)
    assert all(view.image is images[view.name] for view in scene.views if view.name in images)
    assert scene.add(["9.png"], Monitor()).moved == 0


def test_the_expected_camera_needs_no_photograph(
    tmp_path: Path, ball: Dataset, quick_settings: Settings, cpu: Rasterizer
) -> None:
    scene = Scene.open(tmp_path / "scene", ball, quick_settings(long_side_px=32), cpu, Monitor())
    assert scene.expected_camera("3.png") == ball.by_name["3.png"].camera.resized(32, 27)

    estimated = PinholeCamera(48, 40, 60.0, 60.0, 24.0, 20.0)
    source = MovingPoses(ball)
    source.camera = estimated
    files = SceneFiles(tmp_path / "estimated")
    scene = Scene(files, ball, quick_settings(poses="sfm"), cpu, source)
    assert scene.expected_camera("3.png") == ball.by_name["3.png"].camera
    scene.add(FIRST, Monitor())
    assert scene.expected_camera("3.png") == estimated


def test_a_removed_image_leaves_no_trace_and_can_come_back(
    moving: tuple[Scene, MovingPoses],
) -> None:
    scene, source = moving
    source.renumbers = False
    names = [view.name for view in source.dataset.views]
    scene.add(names[:5], Monitor())
    before = scene.train("full", Monitor())
    scene.add((), Monitor(), removed=[names[1]])
    assert scene.visited == (names[0], *names[2:5])
    assert [view.name for view in scene.views] == [names[0], *names[2:5]]
    assert not scene.is_trained("full")
    scene.add([names[1]], Monitor())
    assert_same(scene.train("full", Monitor()), before)


def test_images_come_back_that_an_update_which_failed_took_out(
    moving: tuple[Scene, MovingPoses],
) -> None:
    """The scene still has them, but its pose source does not."""
    scene, source = moving
    scene.add(FIRST, Monitor())
    stopped = Monitor()
    stopped.cancel()
    with pytest.raises(Cancelled):
        scene.add((), stopped, removed=FIRST[1:])
    assert scene.visited == FIRST
    assert source.images == {FIRST[0]}
    scene.add(FIRST, Monitor())
    assert source.images == set(FIRST)


def test_warnings_are_acknowledged_when_the_scene_is_saved(
    moving: tuple[Scene, MovingPoses],
) -> None:
    scene, source = moving
    scene.add(FIRST, Monitor())
    assert source.acknowledged == 0
    scene.save()
    assert source.acknowledged == 1


def test_removing_an_image_without_a_pose_keeps_the_models(
    moving: tuple[Scene, MovingPoses],
) -> None:
    scene, source = moving
    source.renumbers = False
    names = [view.name for view in source.dataset.views]
    source.late = {names[4]}
    scene.add(names[:5], Monitor())
    model = scene.train("full", Monitor())
    update = scene.add((), Monitor(), removed=[names[4]])
    assert update.unregistered == ()
    assert scene.train("full", Monitor()) is model
    source.quarantined[names[6]] = Finding.of(FindingCode.QUARANTINED, [names[6]])
    assert set(scene.quarantined) == {names[6]}
    scene.add([names[6]], Monitor(), removed=[names[6]])  # try it again
    assert scene.quarantined == {}
