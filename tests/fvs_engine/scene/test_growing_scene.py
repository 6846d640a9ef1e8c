from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from fvs_engine.errors import Cancelled, InvalidInputError, StorageError, TrainingError
from fvs_engine.geometry import PinholeCamera, RigidTransform
from fvs_engine.monitor import Monitor, Progress
from fvs_engine.scene.dataset import Dataset
from fvs_engine.scene.growing_scene import GrowingScene
from fvs_engine.scene.scene_files import SceneFiles
from fvs_engine.scene.scene_model import SceneModel
from fvs_engine.scene.settings import SceneSettings
from fvs_engine.sfm.growing.update import PoseUpdate
from fvs_engine.sfm.pose_priors import PosePriors
from fvs_engine.sfm.reconstruction import PointCloud
from fvs_engine.splat.metrics import psnr
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
        self.points = dataset.points.cloud.xyz if dataset.points else np.zeros((0, 3))
        self.quarantined: dict[str, str] = {}
        self.renumbers = True

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
) -> tuple[GrowingScene, MovingPoses]:
    source = MovingPoses(ball)
    (tmp_path / "moving").mkdir()
    return GrowingScene(SceneFiles(tmp_path / "moving"), ball, quick_settings(), cpu, source), source


def assert_same(a: SceneModel, b: SceneModel) -> None:
    assert (a.iterations, a.sh_degree) == (b.iterations, b.sh_degree)
    for name, tensor in a.gaussians.tensors().items():
        assert torch.equal(tensor, b.gaussians.tensors()[name]), name


def assert_same_scenes(a: GrowingScene, b: GrowingScene) -> None:
    assert (a.visited, a.unregistered) == (b.visited, b.unregistered)
    assert [view.name for view in a.views] == [view.name for view in b.views]
    assert_same(a.train("full", Monitor()), b.train("full", Monitor()))


def quality_db(scene: GrowingScene, model: SceneModel, names: Sequence[str]) -> float:
    results = []
    with torch.no_grad():
        for view in scene.localise(names, Monitor()).values():
            color = scene.rasterizer.render(model.gaussians, view.camera, view.camera_from_model).color
            results.append(psnr(color.clamp(0, 1).numpy(), view.image / 255))
    return float(np.mean(results))


def starts(scene: GrowingScene) -> np.ndarray:
    """Where the Gaussians of the scene's model start."""
    trainer = scene._models.initial_trainer("full", 100, 0)
    return trainer.gaussians.means.detach().numpy()


def test_a_model_depends_on_its_views_and_not_on_how_they_came(
    tmp_path: Path, ball: Dataset, quick_settings: Settings, cpu: Rasterizer
) -> None:
    def opened(name: str) -> GrowingScene:
        return GrowingScene.open(tmp_path / name, ball, quick_settings(), cpu, Monitor())

    grown, anew = opened("grown"), opened("anew")
    for names in (("9.png", "0.png"), ("5.png",), ("1.png", "7.png")):
        grown.add(names, Monitor())
        for quality in ("quick", "full"):
            grown.train(quality, Monitor())
    grown.add((), Monitor(), removed=("5.png",))
    anew.add(("7.png", "1.png", "0.png", "9.png"), Monitor())
    assert [view.name for view in grown.views] == ["0.png", "1.png", "7.png", "9.png"]
    for quality in ("quick", "full"):
        assert_same(grown.train(quality, Monitor()), anew.train(quality, Monitor()))


def test_more_views_teach_more_than_as_many_iterations_on_fewer(
    tmp_path: Path, ball: Dataset, quick_settings: Settings, cpu: Rasterizer
) -> None:
    settings = quick_settings(initial_iterations=140)
    scene = GrowingScene.open(tmp_path / "scene", ball, settings, cpu, Monitor())
    first = ("9.png", "0.png", "1.png", "2.png")
    assert scene.add(first, Monitor()).registered == first
    blind = scene.train("full", Monitor())
    assert scene.add(["5.png", "7.png"], Monitor()).registered == ("5.png", "7.png")
    model = scene.train("full", Monitor())
    assert blind.iterations == model.iterations == 140
    assert quality_db(scene, model, ["6.png"]) > quality_db(scene, blind, ["6.png"])


def test_the_full_model_has_the_iterations_of_its_views_and_the_quick_one_a_share(
    tmp_path: Path, ball: Dataset, quick_settings: Settings, cpu: Rasterizer
) -> None:
    settings = quick_settings(initial_iterations=40, iterations_per_view=10, quick_share=0.25)
    scene = GrowingScene.open(tmp_path / "scene", ball, settings, cpu, Monitor())
    stages: set[str] = set()
    monitor = Monitor(lambda progress: stages.add(progress.stage))
    for count, quick, full in ((2, 10, 40), (4, 10, 40), (6, 15, 60)):
        scene.add([f"{number}.png" for number in range(count)], Monitor())
        assert scene.train("quick", monitor).iterations == quick
        assert stages == {"quick training"}
        assert scene.train("full", monitor).iterations == full
        assert stages == {"quick training", "train"}
        stages.clear()


def test_only_what_visited_views_saw_becomes_a_gaussian(
    tmp_path: Path, ball: Dataset, quick_settings: Settings, cpu: Rasterizer
) -> None:
    scene = GrowingScene.open(tmp_path / "scene", ball, quick_settings(), cpu, Monitor())
    visited = ["9.png", "0.png", "1.png", "2.png"]
    scene.add(visited, Monitor())
    centres = np.stack([ball.by_name[name].centre for name in visited])
    means = starts(scene)
    assert 100 < len(means) < 200
    assert ((means @ centres.T > 0).sum(axis=1) >= 2).all()
    scene.add(["5.png", "6.png"], Monitor())
    assert len(starts(scene)) == 200


@pytest.mark.parametrize(
    "stop",
    ["before add", "after add", "in quick training", "after quick training", "in training", "at the end"],
)
def test_a_killed_scene_comes_to_the_same_end(
    tmp_path: Path, ball: Dataset, quick_settings: Settings, cpu: Rasterizer, stop: str
) -> None:
    def opened(folder: str) -> GrowingScene:
        return GrowingScene.open(tmp_path / folder, ball, quick_settings(), cpu, Monitor())

    def go_on(scene: GrowingScene) -> SceneModel:
        for names in (FIRST, ("8.png",), ("1.png", "3.png")):
            scene.add(names, Monitor())
            quick = scene.train("quick", Monitor())
        scene.train("full", Monitor())
        return quick

    whole = opened("whole")
    quick = go_on(whole)

    killed = opened("killed")
    killed.add(FIRST, Monitor())
    killed.train("quick", Monitor())
    if stop != "before add":
        killed.add(["8.png"], Monitor())
    if stop == "in quick training":
        with pytest.raises(Cancelled):
            killed.train("quick", stopping_at(4))
    if stop in ("after quick training", "in training", "at the end"):
        killed.train("quick", Monitor())
    if stop == "in training":
        with pytest.raises(Cancelled):
            killed.train("full", stopping_at(24))
    if stop == "at the end":
        killed.train("full", Monitor())
    del killed
    resumed = opened("killed")
    assert_same(quick, go_on(resumed))
    assert_same_scenes(whole, resumed)
    assert_same_scenes(whole, opened("killed"))


def stopping_at(iteration: int) -> Monitor:
    monitor = Monitor(lambda progress: monitor.cancel() if progress.done == iteration else None)
    return monitor


def test_nothing_is_done_twice(
    tmp_path: Path, ball: Dataset, quick_settings: Settings, cpu: Rasterizer
) -> None:
    def busy(progress: Progress) -> None:
        raise AssertionError(progress)

    scene = GrowingScene.open(tmp_path / "scene", ball, quick_settings(), cpu, Monitor())
    scene.add(FIRST, Monitor())
    assert not scene.is_trained("full")
    model = scene.train("full", Monitor())
    again = scene.add([*FIRST, FIRST[0]], Monitor(busy))
    assert (again.registered, again.moved) == ((), 0)
    assert scene.is_trained("full")
    assert scene.train("full", Monitor(busy)) is model
    resumed = GrowingScene.open(tmp_path / "scene", ball, quick_settings(), cpu, Monitor())
    assert resumed.is_trained("full")
    assert not resumed.is_trained("quick")
    assert_same(resumed.train("full", Monitor(busy)), model)


def test_a_photograph_without_a_camera_waits_and_joins_later(
    moving: tuple[GrowingScene, MovingPoses], cpu: Rasterizer
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
    resumed = GrowingScene(scene._files, scene.dataset, scene.settings, cpu, source)
    resumed._resume(Monitor())
    assert_same_scenes(scene, resumed)


def test_an_image_that_is_not_registered_changes_no_model(moving: tuple[GrowingScene, MovingPoses]) -> None:
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


def test_a_view_that_loses_its_camera_waits_again(moving: tuple[GrowingScene, MovingPoses]) -> None:
    scene, source = moving
    scene.add(FIRST, Monitor())
    source.late = {"0.png"}
    update = scene.add(["7.png"], Monitor())
    assert (update.registered, update.unregistered) == (("7.png",), ("0.png",))
    assert [view.name for view in scene.views] == ["2.png", "4.png", "6.png", "7.png"]
    source.late = set()
    assert scene.add(["8.png"], Monitor()).registered == ("0.png", "8.png")


def test_a_scene_without_any_camera_says_so_and_waits(
    moving: tuple[GrowingScene, MovingPoses], cpu: Rasterizer
) -> None:
    scene, source = moving
    source.late = {"0.png", "5.png"}
    assert scene.add(["0.png", "5.png"], Monitor()).registered == ()
    assert scene.views == ()
    with pytest.raises(TrainingError, match="None of the 2 visited"):
        scene.train("quick", Monitor())
    scene.save()
    resumed = GrowingScene(scene._files, scene.dataset, scene.settings, cpu, source)
    resumed._resume(Monitor())
    assert resumed.unregistered == ("0.png", "5.png")
    source.late = set()
    assert resumed.add(["1.png"], Monitor()).registered == ("0.png", "5.png", "1.png")


def test_cameras_that_moved_are_followed_and_their_images_are_not_read_again(
    moving: tuple[GrowingScene, MovingPoses],
) -> None:
    scene, source = moving
    scene.add(FIRST, Monitor())
    images = {view.name: view.image for view in scene.views}
    source.shift = 0.01
    assert scene.add(["8.png"], Monitor()).moved == 4
    assert all(view.camera_from_model.translation[0] == 0.01 for view in scene.views)
    assert all(view.image is images[view.name] for view in scene.views if view.name in images)
    assert scene.add(["9.png"], Monitor()).moved == 0


def test_views_that_share_no_point_start_from_guesses_in_front_of_them(
    tmp_path: Path, ball: Dataset, quick_settings: Settings, cpu: Rasterizer
) -> None:
    settings = quick_settings(initial_iterations=60)
    scene = GrowingScene.open(tmp_path / "scene", ball, settings, cpu, Monitor())
    update = scene.add(["0.png", "5.png"], Monitor())
    assert "share only" in update.warnings[0]
    means = starts(scene)
    in_view = []
    for view in scene.views:
        pixels = view.camera.project(view.camera_from_model.apply(means))
        in_view.append(((pixels > -1e-3) & (pixels < [48.001, 40.001])).all(axis=1))
    assert np.stack(in_view).any(axis=0).all()
    quick = quality_db(scene, scene.train("quick", Monitor()), ["0.png", "5.png"])
    assert quality_db(scene, scene.train("full", Monitor()), ["0.png", "5.png"]) > quick + 2
    assert scene.add(["1.png", "9.png"], Monitor()).warnings == ()
    assert ball.points is not None
    places = ball.points.seen_by(scene.visited).xyz.astype(np.float32)
    assert set(map(tuple, starts(scene).tolist())) == set(map(tuple, places.tolist()))


def test_the_cap_on_gaussians_binds_the_start_too(
    tmp_path: Path, ball: Dataset, quick_settings: Settings, cpu: Rasterizer
) -> None:
    capped = quick_settings().training.model_copy(update={"max_gaussians": 120})
    scene = GrowingScene.open(tmp_path / "scene", ball, quick_settings(training=capped), cpu, Monitor())
    scene.add(["0.png", "1.png", "2.png", "9.png", "5.png", "6.png"], Monitor())
    assert len(starts(scene)) == 120


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


def test_removing_an_image_without_a_pose_keeps_the_models(
    moving: tuple[GrowingScene, MovingPoses],
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
    source.quarantined[names[6]] = "it kills"
    assert scene.quarantined == {names[6]: "it kills"}
    scene.add([names[6]], Monitor(), removed=[names[6]])  # try it again
    assert scene.quarantined == {}
