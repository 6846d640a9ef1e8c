from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from fvs_engine.errors import InvalidInputError
from fvs_engine.geometry import RigidTransform
from fvs_engine.monitor import Monitor
from fvs_engine.splat.gaussians import Gaussians
from fvs_engine.splat.raster.interface import Rasterizer, Rendering
from fvs_engine.splat.raster.selection import create_rasterizer
from fvs_engine.splat.settings import Densification, TrainingSettings
from fvs_engine.splat.trainer import Trainer
from fvs_engine.splat.views import TrainingView, scene_extent

Views = tuple[TrainingView, ...]
Start = Callable[[int], Gaussians]

SETTINGS = TrainingSettings(
    iterations=120,
    sh_degree=0,
    densification=Densification(first_iteration=10, last_iteration=90, interval=10, phase=5),
)


class Watching:
    """A rasteriser that notes the names of what it renders."""

    def __init__(self, views: Sequence[TrainingView]) -> None:
        self._inner = create_rasterizer("cpu")
        self._views = views
        self.name, self.device = self._inner.name, self._inner.device
        self.seen: list[str] = []

    def render(self, gaussians, camera, camera_from_model, **options) -> Rendering:  # type: ignore[no-untyped-def]
        self.seen += [v.name for v in self._views if v.camera_from_model is camera_from_model]
        return self._inner.render(gaussians, camera, camera_from_model, **options)


@pytest.fixture
def cpu() -> Rasterizer:
    return create_rasterizer("cpu")


def grow(trainer: Trainer, views: Sequence[TrainingView], gaussians: Gaussians) -> None:
    trainer.add_views(views)
    trainer.add_gaussians(gaussians)


def test_added_views_come_next_and_then_in_every_epoch(scene_views: Views, start: Start) -> None:
    watching = Watching(scene_views)
    trainer = Trainer(scene_views[:4], start(0), SETTINGS, watching)
    trainer.train(6, Monitor())
    trainer.add_views(scene_views[4:6])
    trainer.train(16, Monitor())
    names = [view.name for view in scene_views]
    assert sorted(watching.seen[:4]) == names[:4]
    assert watching.seen[6:8] == names[4:6]
    assert sorted(watching.seen[4:6] + watching.seen[8:10]) == names[:4]
    assert sorted(watching.seen[10:16]) == names[:6]


def test_old_gaussians_keep_their_moments_and_new_ones_start_from_rest(
    scene_views: Views, start: Start, cpu: Rasterizer
) -> None:
    trainer = Trainer(scene_views, start(0), SETTINGS, cpu)
    trainer.train(8, Monitor())
    before, first = trainer.gaussians.means.detach().clone(), trainer.optimiser.first["means"].clone()
    pulled = trainer.statistics.total.clone()
    assert first.abs().sum() > 0
    assert pulled.sum() > 0
    added = start(0)
    trainer.add_gaussians(added)
    count = len(before)
    assert torch.equal(trainer.gaussians.means[:count], before)
    assert torch.equal(trainer.gaussians.means[count:], added.means)
    assert torch.equal(trainer.optimiser.first["means"][:count], first)
    assert not trainer.optimiser.first["means"][count:].any()
    assert torch.equal(trainer.statistics.total[:count], pulled)
    assert not trainer.statistics.total[count:].any()
    trainer.train(9, Monitor())
    assert not torch.equal(trainer.gaussians.means[count:], added.means)


@pytest.mark.parametrize("stop", [22, 31, 44])
def test_a_grown_run_resumes_bit_by_bit(
    scene_views: Views, start: Start, cpu: Rasterizer, tmp_path: Path, stop: int
) -> None:
    path = tmp_path / "checkpoint.safetensors"
    runs = []
    for interrupted in (False, True):
        trainer = Trainer(scene_views[:5], start(0), SETTINGS, cpu, seed=2)
        trainer.train(21, Monitor())
        grow(trainer, scene_views[5:7], start(0))
        if interrupted:
            trainer.train(stop, Monitor())
            trainer.save(path, owner_state={"note": [1, 2]}, owner_tensors={"places": torch.ones(2, 3)})
            trainer = Trainer.resume(path, scene_views[:7], cpu)
        trainer.train(50, Monitor())
        grow(trainer, scene_views[7:], start(0))
        trainer.train(64, Monitor())
        runs.append(trainer)
    assert runs[0].extent == runs[1].extent
    for name, tensor in runs[0].gaussians.tensors().items():
        assert torch.equal(tensor, runs[1].gaussians.tensors()[name]), name
        assert torch.equal(runs[0].optimiser.second[name], runs[1].optimiser.second[name]), name


def test_the_extent_glides_to_what_the_cameras_ask_for(
    scene_views: Views, start: Start, cpu: Rasterizer
) -> None:
    far = replace(
        scene_views[-1],
        camera_from_model=RigidTransform(
            scene_views[-1].camera_from_model.rotation, np.array([0.0, 0.0, 40.0])
        ),
    )
    trainer = Trainer(scene_views[:-1], start(0), SETTINGS, cpu)
    before = trainer.extent
    trainer.train(5, Monitor())
    assert trainer.extent == before
    trainer.add_views([far])
    goal = scene_extent(trainer.views, np.zeros((1, 3), np.float32))
    assert goal > 5 * before
    extents = []
    for iteration in range(6, 16):
        trainer.train(iteration, Monitor())
        extents.append(trainer.extent)
    steps = np.diff(np.log([before, *extents]))
    assert (steps > 0).all()
    assert steps.max() < 0.011 * np.log(goal / before)
    assert extents[-1] == pytest.approx(before * (goal / before) ** (1 - 0.99**10))


def test_updated_views_are_rendered_from_where_they_moved_and_held_to_their_new_image(
    scene_views: Views, start: Start, cpu: Rasterizer
) -> None:
    black = replace(scene_views[0], image=np.zeros_like(scene_views[0].image))
    trainer = Trainer(scene_views[:1], start(0), SETTINGS, cpu)
    trainer.update_views([black])
    trainer.train(60, Monitor())
    with torch.no_grad():
        color = cpu.render(trainer.gaussians, black.camera, black.camera_from_model).color
    assert color.mean() < 0.25 * scene_views[0].image.mean() / 255

    watching = Watching(scene_views)
    moved = Trainer(scene_views[:1], start(0), SETTINGS, watching)
    moved.update_views([replace(scene_views[0], camera_from_model=scene_views[3].camera_from_model)])
    moved.train(1, Monitor())
    assert watching.seen == [scene_views[3].name]


def test_dropped_views_are_not_seen_again(scene_views: Views, start: Start) -> None:
    watching = Watching(scene_views)
    trainer = Trainer(scene_views, start(0), SETTINGS, watching)
    trainer.train(3, Monitor())
    before = watching.seen.copy()
    trainer.drop_views([scene_views[0].name, scene_views[5].name])
    rest = {view.name for view in scene_views} - {scene_views[0].name, scene_views[5].name}
    assert {view.name for view in trainer.views} == rest
    unseen = rest.difference(before)
    trainer.train(3 + len(unseen), Monitor())
    assert set(watching.seen[3:]) == unseen
    trainer.train(3 + len(unseen) + 12, Monitor())
    assert sorted(watching.seen[-12:]) == sorted([*rest, *rest])


def test_growth_that_makes_no_sense_is_refused(scene_views: Views, start: Start, cpu: Rasterizer) -> None:
    trainer = Trainer(scene_views[:4], start(0), SETTINGS, cpu)
    with pytest.raises(InvalidInputError, match=r"twice: 3\.png"):
        trainer.add_views([scene_views[3]])
    with pytest.raises(InvalidInputError, match="twice"):
        trainer.add_views([scene_views[5], scene_views[5]])
    with pytest.raises(InvalidInputError, match=r"no view 6\.png"):
        trainer.update_views([scene_views[6]])
    with pytest.raises(InvalidInputError, match="no view at all"):
        trainer.drop_views([view.name for view in scene_views])
    with pytest.raises(InvalidInputError, match="degree 1"):
        trainer.add_gaussians(start(1))
    assert len(trainer.views) == 4
    assert len(trainer.gaussians) == len(start(0))


def test_densification_keeps_its_phase(scene_views: Views, start: Start, cpu: Rasterizer) -> None:
    trainer = Trainer(scene_views, start(0), SETTINGS, cpu)
    counts = []
    for iteration in range(1, 41):
        trainer.train(iteration, Monitor())
        counts.append(len(trainer.gaussians))
    changed = {i + 1 for i in range(1, 40) if counts[i] != counts[i - 1]}
    assert changed
    assert changed <= {15, 25, 35}
