"""A trained model of a scene."""

from dataclasses import dataclass
from pathlib import Path

import torch

from fvs_engine.splat.gaussians import Gaussians
from fvs_engine.splat.trainer import Trainer, read_gaussians


@dataclass(frozen=True, eq=False)
class SceneModel:
    """Gaussians after ``iterations`` of training, to be rendered with harmonics up to ``sh_degree``."""

    gaussians: Gaussians
    sh_degree: int
    iterations: int

    @classmethod
    def of(cls, trainer: Trainer) -> "SceneModel":
        """The model of a finished training; it shares the trainer's tensors."""
        tensors = {name: tensor.detach() for name, tensor in trainer.gaussians.tensors().items()}
        return cls(Gaussians(**tensors), trainer.sh_degree, trainer.iteration)

    @classmethod
    def read(cls, checkpoint: Path, device: torch.device) -> "SceneModel":
        """The model of a finished training's checkpoint; raises ``StorageError`` when it cannot be read."""
        gaussians, sh_degree, iterations = read_gaussians(checkpoint)
        return cls(gaussians.to(device), sh_degree, iterations)
