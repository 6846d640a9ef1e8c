from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from same_scenes import assert_same, assert_same_scenes

from fvs_engine.errors import Cancelled, InvalidInputError, StorageError
from fvs_engine.monitor import Monitor, Progress
from fvs_engine.scene.dataset import Dataset
from fvs_engine.scene.scene import Scene
from fvs_engine.scene.scene_model import SceneModel
from fvs_engine.scene.settings import SceneSettings
from fvs_engine.splat.metrics import psnr
from fvs_engine.splat.raster import Rasterizer
from fvs_schema.findings import FindingCode

Settings = Callable[..., SceneSettings]
FIRST = ("4.png", "0.png", "2.png", "6.png")


def quality_db(scene: Scene, model: SceneModel, names: Sequence[str]) -> float:
    results = []
    with torch.no_grad():
        for view in scene.localise(names, Monitor()).values():
            color = scene.rasterizer.render(model.gaussians, view.camera, view.camera_from_model).color
            results.append(psnr(color.clamp(0, 1).numpy(), view.image / 255))
    return float(np.mean(results))


def starts(scene: Scene) -> np.ndarray:
    """Where the Gaussians of the scene's model start."""
    trainer = scene._models.initial_trainer("full", 100, 0)
    return trainer.gaussians.means.detach().numpy()


def test_a_model_depends_on_its_views_and_not_on_how_they_came(
    tmp_path: Path, ball: Dataset, quick_settings: Settings, cpu: Rasterizer
) -> None:
    def opened(name: str) -> Scene:
        return Scene.open(tmp_path / name, ball, quick_settings(), cpu, Monitor())

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
    settings = quick_settings(initial_iterations=80)
    scene = Scene.open(tmp_path / "scene", ball, settings, cpu, Monitor())
    first = ("9.png", "0.png", "1.png", "2.png")
    assert scene.add(first, Monitor()).registered == first
    blind = scene.train("full", Monitor())
    assert scene.add(["5.png", "7.png"], Monitor()).registered == ("5.png", "7.png")
    model = scene.train("full", Monitor())
    assert blind.iterations == model.iterations == 80
    assert quality_db(scene, model, ["6.png"]) > quality_db(scene, blind, ["6.png"])


def test_the_full_model_has_the_iterations_of_its_views_and_the_quick_one_a_share(
    tmp_path: Path, ball: Dataset, quick_settings: Settings, cpu: Rasterizer
) -> None:
    settings = quick_settings(initial_iterations=8, iterations_per_view=2, quick_share=0.25)
    scene = Scene.open(tmp_path / "scene", ball, settings, cpu, Monitor())
    stages: set[str] = set()
    monitor = Monitor(lambda progress: stages.add(progress.stage))
    for count, quick, full in ((2, 2, 8), (4, 2, 8), (6, 3, 12)):
        scene.add([f"{number}.png" for number in range(count)], Monitor())
        assert scene.train("quick", monitor).iterations == quick
        assert stages == {"quick-training"}
        assert scene.train("full", monitor).iterations == full
        assert stages == {"quick-training", "training"}
        stages.clear()


def test_only_what_visited_views_saw_becomes_a_gaussian(
    tmp_path: Path, ball: Dataset, quick_settings: Settings, cpu: Rasterizer
) -> None:
    scene = Scene.open(tmp_path / "scene", ball, quick_settings(), cpu, Monitor())
    visited = ["9.png", "0.png", "1.png", "2.png"]
    scene.add(visited, Monitor())
    centres = np.stack([ball.by_name[name].centre for name in visited])
    means = starts(scene)
    assert 100 < len(means) < 200
    assert ((means @ centres.T > 0).sum(axis=1) >= 2).all()
    scene.add(["5.png", "6.png"], Monitor())
    assert len(starts(scene)) == 200


def add_and_train(scene: Scene) -> SceneModel:
    """Add images and train three times; return the last quick model."""
    for names in (FIRST, ("8.png",), ("1.png", "3.png")):
        scene.add(names, Monitor())
        quick = scene.train("quick", Monitor())
    scene.train("full", Monitor())
    return quick


@pytest.fixture(scope="module")
def uninterrupted(
    tmp_path_factory: pytest.TempPathFactory, ball: Dataset, quick_settings: Settings, cpu: Rasterizer
) -> tuple[Scene, SceneModel]:
    """A scene that was never interrupted, and its quick model. Read-only."""
    folder = tmp_path_factory.mktemp("uninterrupted") / "scene"
    scene = Scene.open(folder, ball, quick_settings(), cpu, Monitor())
    return scene, add_and_train(scene)


@pytest.mark.parametrize(
    "stop",
    ["before add", "after add", "in quick training", "after quick training", "in training", "at the end"],
)
def test_a_killed_scene_comes_to_the_same_end(
    tmp_path: Path,
    ball: Dataset,
    quick_settings: Settings,
    cpu: Rasterizer,
    uninterrupted: tuple[Scene, SceneModel],
    stop: str,
) -> None:
    def opened() -> Scene:
        return Scene.open(tmp_path / "killed", ball, quick_settings(), cpu, Monitor())

    whole, quick = uninterrupted
    killed = opened()
    killed.add(FIRST, Monitor())
    killed.train("quick", Monitor())
    if stop != "before add":
        killed.add(["8.png"], Monitor())
    if stop == "in quick training":
        with pytest.raises(Cancelled):
            killed.train("quick", stopping_at(2))
    if stop in ("after quick training", "in training", "at the end"):
        killed.train("quick", Monitor())
    if stop == "in training":
        with pytest.raises(Cancelled):
            killed.train("full", stopping_at(12))
    if stop == "at the end":
        killed.train("full", Monitor())
    del killed
    resumed = opened()
    assert_same(quick, add_and_train(resumed))
    assert_same_scenes(whole, resumed)
    assert_same_scenes(whole, opened())


def stopping_at(iteration: int) -> Monitor:
    monitor = Monitor(lambda progress: monitor.cancel() if progress.done == iteration else None)
    return monitor


def test_nothing_is_done_twice(
    tmp_path: Path, ball: Dataset, quick_settings: Settings, cpu: Rasterizer
) -> None:
    def busy(progress: Progress) -> None:
        raise AssertionError(progress)

    scene = Scene.open(tmp_path / "scene", ball, quick_settings(), cpu, Monitor())
    scene.add(FIRST, Monitor())
    assert not scene.is_trained("full")
    model = scene.train("full", Monitor())
    again = scene.add([*FIRST, FIRST[0]], Monitor(busy))
    assert (again.registered, again.moved) == ((), 0)
    assert scene.is_trained("full")
    assert scene.train("full", Monitor(busy)) is model
    resumed = Scene.open(tmp_path / "scene", ball, quick_settings(), cpu, Monitor())
    assert resumed.is_trained("full")
    assert not resumed.is_trained("quick")
    assert_same(resumed.train("full", Monitor(busy)), model)


def test_views_that_share_no_point_start_from_guesses_in_front_of_them(
    tmp_path: Path, ball: Dataset, quick_settings: Settings, cpu: Rasterizer
) -> None:
    settings = quick_settings(initial_iterations=60)
    scene = Scene.open(tmp_path / "scene", ball, settings, cpu, Monitor())
    update = scene.add(["0.png", "5.png"], Monitor())
    assert [warning.code for warning in update.warnings] == [FindingCode.FEW_STARTS]
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
    scene = Scene.open(tmp_path / "scene", ball, quick_settings(training=capped), cpu, Monitor())
    scene.add(["0.png", "1.png", "2.png", "9.png", "5.png", "6.png"], Monitor())
    assert len(starts(scene)) == 120


def test_a_folder_belongs_to_one_dataset_and_its_settings(
    tmp_path: Path, ball: Dataset, quick_settings: Settings, cpu: Rasterizer
) -> None:
    Scene.open(tmp_path / "scene", ball, quick_settings(), cpu, Monitor())
    with pytest.raises(InvalidInputError, match=r"another scene: seed was \d+ and is \d+"):
        Scene.open(tmp_path / "scene", ball, quick_settings(seed=1), cpu, Monitor())
    fewer = replace(ball, views=ball.views[1:])
    with pytest.raises(InvalidInputError, match="another dataset"):
        Scene.open(tmp_path / "scene", fewer, quick_settings(), cpu, Monitor())
    (tmp_path / "scene" / "scene.json").write_text("{")
    with pytest.raises(StorageError, match=r"scene\.json"):
        Scene.open(tmp_path / "scene", ball, quick_settings(), cpu, Monitor())


def test_names_that_the_dataset_has_not_change_nothing(
    tmp_path: Path, ball: Dataset, quick_settings: Settings, cpu: Rasterizer
) -> None:
    scene = Scene.open(tmp_path / "scene", ball, quick_settings(), cpu, Monitor())
    with pytest.raises(InvalidInputError, match=r"no view 11\.png"):
        scene.add(["0.png", "11.png"], Monitor())
    assert scene.visited == ()
