"""A GPU whose memory runs out in mid-training: the error says what to do, and the checkpoint resumes."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import torch

from fvs_engine.errors import DeviceMemoryError
from fvs_engine.monitor import Monitor
from fvs_engine.splat.gaussians import Gaussians
from fvs_engine.splat.raster.cpu import CpuRasterizer
from fvs_engine.splat.session import open_trainer
from fvs_engine.splat.settings import TrainingSettings
from fvs_engine.splat.trainer import Trainer
from fvs_engine.splat.views import TrainingView

SETTINGS = TrainingSettings(sh_degree=0).with_iterations(12)


class SmallDevice(CpuRasterizer):
    """Has memory for so many renders."""

    def __init__(self, renders: int) -> None:
        super().__init__()
        self.left = renders

    def render(self, *args: Any, **options: Any) -> Any:
        self.left -= 1
        if self.left < 0:
            raise torch.OutOfMemoryError("CUDA out of memory. Tried to allocate 2.00 GiB.")
        return super().render(*args, **options)


def test_training_resumes_from_the_checkpoint_before_the_memory_ran_out(
    scene_views: tuple[TrainingView, ...], start: Callable[[int], Gaussians], tmp_path: Path
) -> None:
    checkpoint = tmp_path / "checkpoint.safetensors"
    trainer = Trainer(scene_views, start(0), SETTINGS, SmallDevice(9))
    trainer.train(6, Monitor())
    trainer.save(checkpoint)
    with pytest.raises(DeviceMemoryError, match="last checkpoint") as raised:
        trainer.train(12, Monitor())
    assert "fewer Gaussians or smaller images" in raised.value.hint
    resumed = open_trainer(checkpoint, scene_views, (None, None), SETTINGS, CpuRasterizer())  # type: ignore[arg-type]
    resumed.train(12, Monitor())
    whole = Trainer(scene_views, start(0), SETTINGS, CpuRasterizer())
    whole.train(12, Monitor())
    for name, tensor in whole.gaussians.tensors().items():
        assert torch.equal(tensor, resumed.gaussians.tensors()[name]), name
