from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from fvs_engine.errors import Cancelled, InvalidInputError, StorageError, TrainingError
from fvs_engine.evaluate.metrics import psnr
from fvs_engine.geometry import PinholeCamera, RigidTransform
from fvs_engine.monitor import Monitor
from fvs_engine.scene.dataset import Dataset
from fvs_engine.scene.growing_scene import MIN_POINTS, GrowingScene
from fvs_engine.scene.scene_files import SceneFiles
from fvs_engine.scene.settings import SceneSettings
from fvs_engine.sfm.growing.update import PoseUpdate
from fvs_engine.sfm.pose_priors import PosePriors
from fvs_engine.sfm.reconstruction import PointCloud
from fvs_engine.splat.raster import Rasterizer
from fvs_engine.views import AnyView, View

Settings = Callable[..., SceneSettings]
FIRST = ("4.png", "0.png", "2.png", "6.png")


class MovingPoses:
    """A pose source as structure from motion is one: views come late and move, points are renumbered."""

    def __init__(self, dataset: Dataset) -> None:
        self.dataset = dataset
        self.late: set[str] = set()
        self.shift = 0.0
        self.camera: PinholeCamera | None = None
        self.jitter = 0.0
        self.points = dataset.points.cloud.xyz if dataset.points else np.zeros((0, 3))
        self.quarantined: dict[str, str] = {}

    model_dir = None

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
        monitor.check()
        views = [self._posed(name) for name in visited if name not in self.late]
        draw = np.random.default_rng(len(visited))
        xyz = draw.permutation(self.points) + self.jitter * draw.normal(size=self.points.shape)
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
) -> tuple[GrowingScene, MovingPoses]:
    source = MovingPoses(ball)
    (tmp_path / "moving").mkdir()
    return GrowingScene(SceneFiles(tmp_path / "moving"), ball, quick_settings(), cpu, source), source


def assert_same(a: GrowingScene, b: GrowingScene) -> None:
    assert (a.visited, a.iteration, a.unregistered) == (b.visited, b.iteration, b.unregistered)
    assert [view.name for view in a.views] == [view.name for view in b.views]
    for name, tensor in a.gaussians.tensors().items():
        assert torch.equal(tensor, b.gaussians.tensors()[name]), name


def quality_db(scene: GrowingScene, names: Sequence[str]) -> float:
    results = []
    with torch.no_grad():
        for view in scene.localise(names, Monitor()).values():
            color = scene.rasterizer.render(scene.gaussians, view.camera, view.camera_from_model).color
            results.append(psnr(color.clamp(0, 1).numpy(), view.image / 255))
    return float(np.mean(results))


def test_added_views_teach_more_than_as_many_iterations_without_them(
    tmp_path: Path, ball: Dataset, quick_settings: Settings, cpu: Rasterizer
) -> None:
    settings = quick_settings(initial_iterations=60, iterations_per_view=40)
    scene = GrowingScene.open(tmp_path / "scene", ball, settings, cpu, Monitor())
    first = ("9.png", "0.png", "1.png", "2.png")
    update = scene.add(first, Monitor())
    assert update.registered == first
    assert update.iterations == 60
    assert ball.points is not None
    assert update.new_gaussians == len(ball.points.seen_by(scene.visited)) == len(scene.gaussians)
    for name in ("5.png", "7.png"):
        scene.train(Monitor())
        assert scene.add([name], Monitor()).registered == (name,)
    scene.train(Monitor())
    assert scene.iteration == scene.target_iteration == 140
    assert [view.name for view in scene.views] == [*first, "5.png", "7.png"]
    longer = quick_settings(initial_iterations=140)
    blind = GrowingScene.open(tmp_path / "blind", ball, longer, cpu, Monitor())
    blind.add(first, Monitor())
    blind.train(Monitor())
    assert quality_db(scene, ["6.png"]) > quality_db(blind, ["6.png"])


def test_only_what_visited_views_saw_becomes_a_gaussian(
    tmp_path: Path, ball: Dataset, quick_settings: Settings, cpu: Rasterizer
) -> None:
    scene = GrowingScene.open(tmp_path / "scene", ball, quick_settings(), cpu, Monitor())
    visited = ["9.png", "0.png", "1.png", "2.png"]
    scene.add(visited, Monitor())
    centres = np.stack([ball.by_name[name].centre for name in visited])
    means = scene.gaussians.means.detach().numpy()
    assert 100 < len(means) < 200
    assert ((means @ centres.T > 0).sum(axis=1) >= 2).all()
    assert scene.add(["5.png", "6.png"], Monitor()).new_gaussians == 200 - len(means)


@pytest.mark.parametrize("stop", ["after add", "in training", "after training", "before add"])
def test_a_killed_scene_comes_to_the_same_end(
    tmp_path: Path, ball: Dataset, quick_settings: Settings, cpu: Rasterizer, stop: str
) -> None:
    def opened(folder: str) -> GrowingScene:
        return GrowingScene.open(tmp_path / folder, ball, quick_settings(), cpu, Monitor())

    def go_on(scene: GrowingScene) -> None:
        for names in (FIRST, ("8.png",), ("1.png", "3.png")):
            scene.add(names, Monitor())
            scene.train(Monitor())
        scene.save()

    whole = opened("whole")
    go_on(whole)

    killed = opened("killed")
    killed.add(FIRST, Monitor())
    killed.train(Monitor())
    if stop != "before add":
        killed.add(["8.png"], Monitor())
    if stop == "in training":
        with pytest.raises(Cancelled):
            killed.train(stopping_at(24))
    if stop == "after training":
        killed.train(Monitor())
        killed.save()
    del killed
    resumed = opened("killed")
    go_on(resumed)
    assert_same(whole, resumed)
    assert_same(whole, opened("killed"))


def stopping_at(iteration: int) -> Monitor:
    monitor = Monitor(lambda progress: monitor.cancel() if progress.done == iteration else None)
    return monitor


def test_nothing_is_done_twice(
    tmp_path: Path, ball: Dataset, quick_settings: Settings, cpu: Rasterizer
) -> None:
    scene = GrowingScene.open(tmp_path / "scene", ball, quick_settings(), cpu, Monitor())
    scene.add(FIRST, Monitor())
    scene.train(Monitor())
    count = len(scene.gaussians)
    again = scene.add([*FIRST, FIRST[0]], Monitor())
    assert (again.registered, again.new_gaussians, again.iterations) == ((), 0, 20)
    scene.train(Monitor())
    assert (scene.iteration, len(scene.gaussians)) == (20, count)


def test_a_photograph_without_a_camera_waits_and_joins_later(
    moving: tuple[GrowingScene, MovingPoses], cpu: Rasterizer
) -> None:
    scene, source = moving
    source.late = {"2.png"}
    assert scene.add(FIRST, Monitor()).unregistered == ("2.png",)
    assert [view.name for view in scene.views] == ["4.png", "0.png", "6.png"]
    assert scene.target_iteration == 20
    source.late = set()
    update = scene.add(["7.png"], Monitor())
    assert update.registered == ("2.png", "7.png")
    assert (update.unregistered, update.iterations) == ((), 40)
    scene.train(Monitor())
    scene.save()
    resumed = GrowingScene(scene._files, scene.dataset, scene.settings, cpu, source)
    resumed._resume(Monitor())
    assert_same(scene, resumed)


def test_a_view_that_loses_its_camera_waits_again(moving: tuple[GrowingScene, MovingPoses]) -> None:
    scene, source = moving
    scene.add(FIRST, Monitor())
    scene.train(Monitor())
    source.late = {"0.png"}
    update = scene.add(["7.png"], Monitor())
    assert (update.registered, update.unregistered) == (("7.png",), ("0.png",))
    assert [view.name for view in scene.views] == ["4.png", "2.png", "6.png", "7.png"]
    source.late = set()
    assert scene.add(["8.png"], Monitor()).registered == ("0.png", "8.png")
    scene.train(Monitor())
    assert scene.iteration == scene.target_iteration == 40


def test_a_retrained_scene_resumes_with_its_views_in_order(
    moving: tuple[GrowingScene, MovingPoses], cpu: Rasterizer
) -> None:
    scene, source = moving
    points, source.points, source.late = source.points, np.zeros((0, 3)), {"0.png"}
    scene.add(FIRST, Monitor())
    source.late = set()
    scene.add(["7.png"], Monitor())
    assert [view.name for view in scene.views] == ["4.png", "2.png", "6.png", "0.png", "7.png"]
    source.points = points
    scene.add(["8.png"], Monitor())
    assert [view.name for view in scene.views] == [*FIRST, "7.png", "8.png"]
    scene.save()
    resumed = GrowingScene(scene._files, scene.dataset, scene.settings, cpu, source)
    resumed._resume(Monitor())
    assert_same(scene, resumed)


def test_a_scene_without_any_camera_says_so_and_waits(
    moving: tuple[GrowingScene, MovingPoses], cpu: Rasterizer
) -> None:
    scene, source = moving
    source.late = {"0.png", "5.png"}
    assert scene.add(["0.png", "5.png"], Monitor()).registered == ()
    assert (scene.iteration, scene.target_iteration, scene.views) == (0, 0, ())
    with pytest.raises(TrainingError, match="None of the 2 visited"):
        scene.train(Monitor())
    scene.save()
    resumed = GrowingScene(scene._files, scene.dataset, scene.settings, cpu, source)
    resumed._resume(Monitor())
    assert resumed.unregistered == ("0.png", "5.png")
    source.late = set()
    assert resumed.add(["1.png"], Monitor()).registered == ("0.png", "5.png", "1.png")
    assert resumed.target_iteration == 20


def test_cameras_that_moved_are_followed_and_moved_points_are_not_new(
    moving: tuple[GrowingScene, MovingPoses],
) -> None:
    scene, source = moving
    assert scene.add(FIRST, Monitor()).new_gaussians == 200
    images = [view.image for view in scene.views]
    source.shift, source.jitter = 0.01, 0.01
    update = scene.add(["8.png"], Monitor())
    assert (update.moved, update.new_gaussians) == (4, 0)
    assert all(view.camera_from_model.translation[0] == 0.01 for view in scene.views)
    assert all(view.image is image for view, image in zip(scene.views, images, strict=False))
    source.shift, source.points = 0.01, np.concatenate([source.points, [[3.0, 0.0, 0.0]]])
    update = scene.add(["9.png"], Monitor())
    assert (update.moved, update.new_gaussians) == (0, 1)
    assert len(scene.gaussians) == 201


def test_views_that_share_no_point_start_from_guesses_in_front_of_them(
    tmp_path: Path, ball: Dataset, quick_settings: Settings, cpu: Rasterizer
) -> None:
    settings = quick_settings(initial_iterations=60)
    scene = GrowingScene.open(tmp_path / "scene", ball, settings, cpu, Monitor())
    update = scene.add(["0.png", "5.png"], Monitor())
    assert "share only" in update.warnings[0]
    means = scene.gaussians.means.detach().numpy()
    in_view = []
    for view in scene.views:
        pixels = view.camera.project(view.camera_from_model.apply(means))
        in_view.append(((pixels > -1e-3) & (pixels < [48.001, 40.001])).all(axis=1))
    assert np.stack(in_view).any(axis=0).all()
    before = quality_db(scene, ["0.png", "5.png"])
    scene.train(Monitor())
    assert quality_db(scene, ["0.png", "5.png"]) > before + 5


def test_a_model_of_guesses_is_retrained_once_its_views_share_points(
    tmp_path: Path, ball: Dataset, quick_settings: Settings, cpu: Rasterizer
) -> None:
    settings = quick_settings()
    scene = GrowingScene.open(tmp_path / "scene", ball, settings, cpu, Monitor())
    scene.add(["0.png", "5.png"], Monitor())
    scene.train(Monitor())
    scene.save()
    resumed = GrowingScene.open(tmp_path / "scene", ball, settings, cpu, Monitor())
    for grown in (scene, resumed):  # as if the first was killed before it saved again
        update = grown.add(["1.png", "9.png"], Monitor())
        assert "retrained from scratch" in update.warnings[0]
        assert update.registered == ("1.png", "9.png")
        assert [view.name for view in grown.views] == ["0.png", "5.png", "1.png", "9.png"]
        assert (grown.iteration, grown.target_iteration) == (0, 40)
        assert ball.points is not None
        places = ball.points.seen_by(grown.visited).xyz.astype(np.float32)
        assert len(grown.gaussians) == update.new_gaussians == len(places) > MIN_POINTS
        assert set(map(tuple, grown.gaussians.means.tolist())) == set(map(tuple, places.tolist()))
        grown.train(Monitor())
    assert resumed.gaussians.means.equal(scene.gaussians.means)
    update = scene.add(["4.png"], Monitor())  # the points have not doubled again
    assert update.warnings == ()
    assert scene.iteration == 40


def test_a_model_is_retrained_from_scratch_whenever_its_points_have_doubled(
    moving: tuple[GrowingScene, MovingPoses], cpu: Rasterizer
) -> None:
    scene, source = moving
    points = source.points
    sizes = {"1.png": (1.9, False), "3.png": (2.0, True), "5.png": (3.9, False), "7.png": (4.0, True)}
    spread = np.concatenate([points, points + np.array([5.0, 0.0, 0.0])])
    source.points = spread[:MIN_POINTS]
    assert scene.add(FIRST, Monitor()).warnings == ()
    for name, (growth, restart) in sizes.items():
        scene.train(Monitor())
        scene.save()
        before = scene.iteration
        source.points = spread[: round(growth * MIN_POINTS)]
        resumed = GrowingScene(scene._files, scene.dataset, scene.settings, cpu, source)
        resumed._resume(Monitor())
        for grown in (scene, resumed):
            update = grown.add([name], Monitor())
            assert any("retrained from scratch" in warning for warning in update.warnings) == restart, name
            assert update.registered == (name,)
            assert grown.iteration == (0 if restart else before)
            assert grown.target_iteration == before + 10
        assert_same(scene, resumed)
    source.points = spread[:150]  # structure from motion lost some: what is there goes on
    assert scene.add(["8.png"], Monitor()).warnings == ()


def test_the_cap_on_gaussians_binds_additions_too(
    tmp_path: Path, ball: Dataset, quick_settings: Settings, cpu: Rasterizer
) -> None:
    capped = quick_settings().training.model_copy(update={"max_gaussians": 120})
    scene = GrowingScene.open(tmp_path / "scene", ball, quick_settings(training=capped), cpu, Monitor())
    scene.add(["0.png", "1.png", "2.png", "9.png"], Monitor())
    first = len(scene.gaussians)
    scene.add(["5.png", "6.png"], Monitor())
    assert first < len(scene.gaussians) == 120


def test_a_folder_belongs_to_one_dataset_and_its_settings(
    tmp_path: Path, ball: Dataset, quick_settings: Settings, cpu: Rasterizer
) -> None:
    GrowingScene.open(tmp_path / "scene", ball, quick_settings(), cpu, Monitor())
    with pytest.raises(InvalidInputError, match=r"another scene: seed was \d+ and is \d+"):
        GrowingScene.open(tmp_path / "scene", ball, quick_settings(seed=1), cpu, Monitor())
    fewer = replace(ball, views=ball.views[1:])
    with pytest.raises(InvalidInputError, match="another dataset"):
        GrowingScene.open(tmp_path / "scene", fewer, quick_settings(), cpu, Monitor())
    (tmp_path / "scene" / "scene.json").write_text("{")
    with pytest.raises(StorageError, match=r"scene\.json"):
        GrowingScene.open(tmp_path / "scene", ball, quick_settings(), cpu, Monitor())


def test_names_that_the_dataset_has_not_change_nothing(
    tmp_path: Path, ball: Dataset, quick_settings: Settings, cpu: Rasterizer
) -> None:
    scene = GrowingScene.open(tmp_path / "scene", ball, quick_settings(), cpu, Monitor())
    with pytest.raises(InvalidInputError, match=r"no view 11\.png"):
        scene.add(["0.png", "11.png"], Monitor())
    assert scene.visited == ()


def test_the_expected_camera_needs_no_photograph(
    tmp_path: Path, ball: Dataset, quick_settings: Settings, cpu: Rasterizer
) -> None:
    scene = GrowingScene.open(tmp_path / "scene", ball, quick_settings(long_side_px=32), cpu, Monitor())
    assert scene.expected_camera("3.png") == ball.by_name["3.png"].camera.resized(32, 27)

    estimated = PinholeCamera(48, 40, 60.0, 60.0, 24.0, 20.0)
    source = MovingPoses(ball)
    source.camera = estimated
    files = SceneFiles(tmp_path / "estimated")
    scene = GrowingScene(files, ball, quick_settings(poses="sfm"), cpu, source)
    assert scene.expected_camera("3.png") == ball.by_name["3.png"].camera
    scene.add(FIRST, Monitor())
    assert scene.expected_camera("3.png") == estimated


def test_a_removed_image_is_unlearnt_and_can_come_back(
    moving: tuple[GrowingScene, MovingPoses],
):
    scene, source = moving
    names = [view.name for view in source.dataset.views]
    scene.add(names[:5], Monitor())
    scene.train(Monitor())
    assert scene.iteration > 0
    scene.add(names[5:6], Monitor(), removed=[names[1]])
    assert scene.visited == (names[0], *names[2:6])
    assert [view.name for view in scene.views] == [names[0], *names[2:6]]
    assert scene.iteration == 0  # retrained from scratch
    scene.train(Monitor())
    trained = scene.iteration
    scene.add([names[1]], Monitor())
    assert names[1] in {view.name for view in scene.views}
    assert scene.iteration == trained


def test_removing_an_image_without_a_pose_keeps_the_training(
    moving: tuple[GrowingScene, MovingPoses],
):
    scene, source = moving
    names = [view.name for view in source.dataset.views]
    source.late = {names[4]}
    scene.add(names[:5], Monitor())
    scene.train(Monitor())
    trained = scene.iteration
    update = scene.add((), Monitor(), removed=[names[4]])
    assert update.unregistered == ()
    assert scene.iteration == trained > 0
    source.quarantined[names[6]] = "it kills"
    assert scene.quarantined == {names[6]: "it kills"}
    scene.add([names[6]], Monitor(), removed=[names[6]])  # try it again
    assert scene.quarantined == {}


def test_a_new_model_begins_on_reduced_images_and_a_grown_one_does_not(
    tmp_path: Path, ball: Dataset, quick_settings: Settings, cpu: Rasterizer
) -> None:
    settings = quick_settings(initial_iterations=16, coarse_to_fine=True)
    scene = GrowingScene.open(tmp_path / "scene", ball, settings, cpu, Monitor())
    scene.add(FIRST, Monitor())
    reduced: list[bool] = []
    scene.train(Monitor(lambda _progress: reduced.append(scene.is_reduced)))
    assert reduced == [True] * 13 + [False] * 3
    scene.save()
    resumed = GrowingScene.open(tmp_path / "scene", ball, settings, cpu, Monitor())
    resumed.add(["8.png"], Monitor())
    assert not resumed.is_reduced
    resumed.add([], Monitor(), removed=["8.png"])  # which retrains the model
    assert resumed.is_reduced
