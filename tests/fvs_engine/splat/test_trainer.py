from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from fvs_engine.errors import Cancelled, InvalidInputError, StorageError, TrainingError
from fvs_engine.monitor import Monitor, Progress
from fvs_engine.splat.gaussians import Gaussians
from fvs_engine.splat.metrics import psnr
from fvs_engine.splat.raster.interface import Rasterizer
from fvs_engine.splat.raster.selection import create_rasterizer
from fvs_engine.splat.settings import Densification, LearningRates, TrainingSettings
from fvs_engine.splat.trainer import Trainer
from fvs_engine.splat.views import TrainingView, scene_extent

Views = tuple[TrainingView, ...]
Start = Callable[[int], Gaussians]

SETTINGS = TrainingSettings(
    iterations=120,
    sh_degree=1,
    sh_degree_interval=20,
    densification=Densification(
        first_iteration=10, last_iteration=90, interval=10, opacity_reset_interval=40
    ),
)


@pytest.fixture
def cpu() -> Rasterizer:
    return create_rasterizer("cpu")


def assert_equal(a: Trainer, b: Trainer) -> None:
    assert a.iteration == b.iteration
    for name, tensor in a.gaussians.tensors().items():
        assert torch.equal(tensor, b.gaussians.tensors()[name]), name
        assert torch.equal(a.optimiser.second[name], b.optimiser.second[name]), name


def quality_db(trainer: Trainer) -> float:
    with torch.no_grad():
        renders = [
            trainer.rasterizer.render(trainer.gaussians, v.camera, v.camera_from_model).color.numpy()
            for v in trainer.views
        ]
    return float(np.mean([psnr(r, v.image / 255) for r, v in zip(renders, trainer.views, strict=True)]))


def test_training_recovers_the_scene(scene_views: Views, start: Start, cpu: Rasterizer) -> None:
    trainer = Trainer(scene_views, start(0), TrainingSettings(sh_degree=0).with_iterations(400), cpu)
    before = quality_db(trainer)
    trainer.train(400, Monitor())
    assert len(trainer.gaussians) > 75
    assert quality_db(trainer) > before + 4


def test_kernels_train_as_the_reference_does(scene_views: Views, start: Start, cpu: Rasterizer) -> None:
    trainers = [Trainer(scene_views, start(1), SETTINGS, r) for r in (cpu, create_rasterizer("reference"))]
    for trainer in trainers:
        trainer.train(9, Monitor())
    assert quality_db(trainers[0]) == pytest.approx(quality_db(trainers[1]), abs=0.01)


def test_equal_seeds_give_equal_bits_and_others_do_not(
    scene_views: Views, start: Start, cpu: Rasterizer
) -> None:
    trainers = [Trainer(scene_views, start(1), SETTINGS, cpu, seed=s) for s in (3, 3, 4)]
    for trainer in trainers:
        trainer.train(60, Monitor())
    assert_equal(trainers[0], trainers[1])
    assert len(trainers[0].gaussians) != 75
    assert not torch.equal(trainers[0].gaussians.sh_dc[:10], trainers[2].gaussians.sh_dc[:10])


def test_a_run_that_is_resumed_again_and_again_equals_an_uninterrupted_one(
    scene_views: Views, start: Start, cpu: Rasterizer, tmp_path: Path
) -> None:
    whole = Trainer(scene_views, start(1), SETTINGS, cpu)
    whole.train(100, Monitor())
    resumed = Trainer(scene_views, start(1), SETTINGS, cpu)
    for stop in (7, 40, 43, 85):
        resumed.train(stop, Monitor())
        resumed.save(tmp_path / "checkpoint.safetensors")
        resumed = Trainer.resume(tmp_path / "checkpoint.safetensors", scene_views, cpu)
        assert resumed.settings == SETTINGS
    resumed.train(100, Monitor())
    assert_equal(whole, resumed)


def test_every_view_once_per_epoch(scene_views: Views, start: Start, cpu: Rasterizer) -> None:
    seen: list[TrainingView] = []

    class Watching:
        name, device, steps_on_device = cpu.name, cpu.device, False

        def render(self, gaussians, camera, camera_from_model, **options):  # type: ignore[no-untyped-def]
            seen.append(next(v for v in scene_views if v.camera_from_model is camera_from_model))
            return cpu.render(gaussians, camera, camera_from_model, **options)

    Trainer(scene_views, start(0), SETTINGS.model_copy(update={"sh_degree": 0}), Watching()).train(
        24, Monitor()
    )
    epochs = [[v.name for v in seen[i : i + 8]] for i in (0, 8, 16)]
    assert all(len(set(epoch)) == 8 for epoch in epochs)
    assert epochs[0] != epochs[1]


def test_a_model_in_a_unit_so_large_that_nothing_is_rendered_is_refused(
    scene_views: Views, start: Start, cpu: Rasterizer
) -> None:
    def scaled(view: TrainingView, factor: float) -> TrainingView:
        pose = view.camera_from_model
        return replace(view, camera_from_model=replace(pose, translation=factor * pose.translation))

    gaussians = start(1)
    gaussians.means *= 1e-3
    with pytest.raises(TrainingError, match="unit of length is too large"):
        Trainer([scaled(view, 1e-3) for view in scene_views], gaussians, SETTINGS, cpu)


def test_progress_and_cancellation(scene_views: Views, start: Start, cpu: Rasterizer, tmp_path: Path) -> None:
    reports: list[Progress] = []

    def stop_after_five(progress: Progress) -> None:
        reports.append(progress)
        if progress.done == 5:
            monitor.cancel()

    monitor = Monitor(stop_after_five)
    trainer = Trainer(scene_views, start(1), SETTINGS, cpu)
    with pytest.raises(Cancelled):
        trainer.train(50, monitor)
    assert trainer.iteration == 5
    assert [p.done for p in reports] == [1, 2, 3, 4, 5]
    assert reports[-1].total == 50
    assert {"loss", "gaussians", "iterations_per_s"} <= set(reports[-1].detail)
    trainer.save(tmp_path / "c.safetensors")
    resumed = Trainer.resume(tmp_path / "c.safetensors", scene_views, cpu)
    resumed.train(20, Monitor())
    trainer.train(20, Monitor())
    assert_equal(trainer, resumed)


def test_divergence_keeps_the_last_good_checkpoint(
    scene_views: Views, start: Start, cpu: Rasterizer, tmp_path: Path
) -> None:
    path = tmp_path / "c.safetensors"
    trainer = Trainer(scene_views, start(1), SETTINGS, cpu)
    trainer.train(3, Monitor())
    trainer.save(path)
    good = path.read_bytes()
    with torch.no_grad():
        trainer.gaussians.sh_dc.fill_(float("inf"))
    with pytest.raises(TrainingError, match="diverged at iteration 3") as caught:
        trainer.train(10, Monitor())
    assert "another seed" in caught.value.hint
    with pytest.raises(TrainingError, match="sh_dc"):
        trainer.save(path)
    assert path.read_bytes() == good
    assert Trainer.resume(path, scene_views, cpu).iteration == 3


def test_checkpoints_that_cannot_be_used(
    scene_views: Views, start: Start, cpu: Rasterizer, tmp_path: Path
) -> None:
    path = tmp_path / "c.safetensors"
    trainer = Trainer(scene_views, start(1), SETTINGS, cpu)
    trainer.save(path)
    with pytest.raises(InvalidInputError, match="8 views"):
        Trainer.resume(path, scene_views[:4], cpu)
    with pytest.raises(StorageError, match="cannot be written"):
        trainer.save(tmp_path / "absent" / "c.safetensors")
    path.write_bytes(path.read_bytes()[:500])
    with pytest.raises(StorageError, match=r"c\.safetensors"):
        Trainer.resume(path, scene_views, cpu)
    with pytest.raises(StorageError):
        Trainer.resume(tmp_path / "none", scene_views, cpu)


def test_what_cannot_be_trained_is_refused(scene_views: Views, start: Start, cpu: Rasterizer) -> None:
    with pytest.raises(TrainingError, match="no view"):
        Trainer((), start(1), SETTINGS, cpu)
    with pytest.raises(InvalidInputError, match="degree"):
        Trainer(scene_views, start(0), SETTINGS, cpu)
    view = scene_views[0]
    with pytest.raises(InvalidInputError, match=r"0\.png"):
        TrainingView(view.name, view.camera, view.camera_from_model, view.image[:-1])


def test_the_cap_holds(scene_views: Views, start: Start, cpu: Rasterizer) -> None:
    settings = SETTINGS.model_copy(
        update={"max_gaussians": 90, "learning_rates": LearningRates(), "sh_degree": 0}
    )
    trainer = Trainer(scene_views, start(0), settings, cpu)
    trainer.train(60, Monitor())
    assert len(start(0)) < len(trainer.gaussians) <= 90


def test_extent_is_the_cameras_spread_or_the_distance_to_the_points(scene_views: Views) -> None:
    assert scene_extent(scene_views, np.zeros((1, 3), np.float32)) == pytest.approx(1.1 * 4.0)
    points = np.zeros((5, 3), np.float32)
    assert scene_extent(scene_views[:1], points) == pytest.approx(4.0)


def _masked(view: TrainingView, seed: int) -> TrainingView:
    """The view with a mask, and with noise where it does not count."""
    hidden = np.zeros((40, 48), dtype=bool)
    hidden[5:30, 10:35] = True
    noise = np.random.default_rng(seed).integers(0, 256, view.image.shape, dtype=np.uint8)
    image = np.where(hidden[..., None], noise, view.image)
    return replace(view, image=image, mask=~hidden)


def test_what_a_mask_leaves_out_has_no_influence(scene_views: Views, start: Start, cpu: Rasterizer) -> None:
    sets = [[_masked(view, seed) for view in scene_views[:3]] + list(scene_views[3:]) for seed in (1, 2)]
    trainers = [Trainer(views, start(1), SETTINGS, cpu) for views in sets]
    for trainer in trainers:
        trainer.train(60, Monitor())
    assert_equal(*trainers)
    # At half the size the filter mixes photograph and noise in the pixels beside the mask.
    halves = [_masked(scene_views[0], seed).reduced(2) for seed in (1, 2)]
    assert all(half.mask is not None and half.mask.shape == half.image.shape[:2] for half in halves)


def test_gaussians_that_only_masked_pixels_show_are_not_seen(
    scene_views: Views, start: Start, cpu: Rasterizer
) -> None:
    mask = np.zeros((40, 48), dtype=bool)
    mask[:, 40:] = True
    trainer = Trainer(
        [replace(scene_views[0], mask=mask)], start(0), SETTINGS.model_copy(update={"sh_degree": 0}), cpu
    )
    before = {name: tensor.detach().clone() for name, tensor in trainer.gaussians.tensors().items()}
    trainer.train(5, Monitor())
    with torch.no_grad():
        view = scene_views[0]
        right = cpu.render(trainer.gaussians, view.camera, view.camera_from_model).radii_px.numpy()
        right += view.camera.project(view.camera_from_model.apply(before["means"].numpy()))[:, 0]
    hidden = torch.from_numpy(right < 39)
    assert 5 < int(hidden.sum()) < 75
    assert int((trainer.statistics.views > 0).sum()) > 5
    assert not trainer.statistics.views[hidden].any()
    for name, tensor in trainer.gaussians.tensors().items():
        assert torch.equal(tensor[hidden], before[name][hidden]), name
