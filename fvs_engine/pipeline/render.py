"""Rendering a trained model to PNG files: known views, candidates, or a path through the views."""

from collections.abc import Sequence
from enum import StrEnum
from pathlib import Path
from typing import Protocol

import numpy as np
import torch
from numpy.typing import NDArray
from PIL import Image

from fvs_engine.errors import InvalidInputError
from fvs_engine.files.storage import storage_errors
from fvs_engine.geometry import PinholeCamera, RigidTransform, smooth_path
from fvs_engine.monitor import Monitor
from fvs_engine.pipeline.candidates import read_candidates
from fvs_engine.pipeline.model import TrainedModel, open_model
from fvs_engine.score import Candidate
from fvs_engine.splat.gaussians import Gaussians
from fvs_engine.splat.raster import Rasterizer, create_rasterizer


class Posed(Protocol):
    """Anything with a camera and a place: a candidate, a training view."""

    @property
    def camera(self) -> PinholeCamera:
        """What it sees with."""
        ...

    @property
    def camera_from_model(self) -> RigidTransform:
        """Where it is."""
        ...


class ViewGroup(StrEnum):
    """Views of the model that can be asked for together."""

    HELD_OUT = "held-out"
    TRAINING = "training"
    ALL = "all"
    PATH = "path"
    """Not views but a smooth path through the training views in the order of their names."""


def render_views(
    root: Path,
    *,
    group: ViewGroup = ViewGroup.HELD_OUT,
    candidates_file: Path | None = None,
    frames: int = 120,
    out: Path | None = None,
    backend: str = "auto",
    monitor: Monitor | None = None,
) -> tuple[Path, ...]:
    """Render views of the model in ``root`` and return the PNG files, in order.

    A candidates file takes the place of ``group``; ``frames`` is the length of a path. The files go to
    ``out``, or to ``renders/<group>`` in ``root``. Raises ``InvalidInputError`` when there is nothing to
    render or the folder holds no model, ``StorageError`` when ``out`` cannot be written.
    """
    monitor = monitor or Monitor()
    model = open_model(root)
    if candidates_file is not None:
        wanted: Sequence[Candidate] = read_candidates(candidates_file, model.views, model.aliases)
        folder = out or model.workspace.renders / "candidates"
    else:
        wanted = _members(model, group, frames)
        folder = out or model.workspace.renders / f"{group.value}-views"
    if not wanted:
        raise InvalidInputError(
            f"{root} has no {group.value} views.", hint="Choose another group with --views, or --candidates."
        )
    rasterizer = create_rasterizer(backend, monitor)
    gaussians = model.gaussians.to(rasterizer.device)
    paths = []
    for done, view in enumerate(wanted, start=1):
        pixels = np.round(render_color(gaussians, view, rasterizer) * 255.0).astype(np.uint8)
        # The names of views are those of files already, the ids of candidates can be anything.
        name = view.id if candidates_file is None else _file_name(view.id)
        path = folder / f"{name}.png"
        with storage_errors(path):
            path.parent.mkdir(parents=True, exist_ok=True)
            Image.fromarray(pixels).save(path)
        paths.append(path)
        monitor.report("render", done, len(wanted))
        monitor.check()
    return tuple(paths)


def render_color(gaussians: Gaussians, view: Posed, rasterizer: Rasterizer) -> NDArray[np.float32]:
    """What a view sees of the model on black: [H, W, 3] in [0, 1]."""
    with torch.no_grad():
        rendering = rasterizer.render(gaussians, view.camera, view.camera_from_model)
    return np.asarray(rendering.color.clamp(0.0, 1.0).cpu().numpy(), dtype=np.float32)


def _members(model: TrainedModel, group: ViewGroup, frames: int) -> Sequence[Candidate]:
    if group is ViewGroup.PATH:
        keys = [view.camera_from_model.inverse() for view in model.training_views]
        camera = model.camera
        return [
            Candidate(f"{index:05d}", camera, model_from_camera.inverse())
            for index, model_from_camera in enumerate(smooth_path(keys, frames))
        ]
    views = {
        ViewGroup.HELD_OUT: model.held_out_views,
        ViewGroup.TRAINING: model.training_views,
        ViewGroup.ALL: model.views,
    }[group]
    return [Candidate(view.name, view.camera, view.camera_from_model) for view in views]


def _file_name(candidate_id: str) -> str:
    """An id as a file name that stays in its folder; different ids have different ones."""
    return "".join(
        letter if letter.isalnum() or letter in "._-– " else f"%{ord(letter):02X}" for letter in candidate_id
    )
