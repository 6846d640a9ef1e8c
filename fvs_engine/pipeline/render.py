"""Rendering of a trained model to PNG files: its views, candidates, or a path through the views."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from PIL import Image

from fvs_engine.choices import ViewGroup
from fvs_engine.errors import InvalidInputError
from fvs_engine.files.storage import storage_errors
from fvs_engine.geometry import smooth_path
from fvs_engine.monitor import Monitor
from fvs_engine.pipeline.candidates import candidates_of
from fvs_engine.pipeline.model import FolderModel, open_model
from fvs_engine.splat.raster import create_rasterizer
from fvs_engine.splat.render import to_pixels
from fvs_engine.views import PinholeView
from fvs_schema.stages import Stage


def render_views(
    root: Path,
    *,
    group: ViewGroup = "held-out",
    candidates_file: Path | None = None,
    frames: int = 120,
    out: Path | None = None,
    backend: str = "auto",
    monitor: Monitor | None = None,
) -> tuple[Path, ...]:
    """Render views of the model in ``root`` and return the PNG files, in order.

    A candidates file replaces ``group``; ``frames`` is the length of a path. The files go to
    ``out``, or to ``renders/<group>`` in ``root``. Raises ``InvalidInputError`` when there is nothing to
    render or the folder holds no model, ``StorageError`` when ``out`` cannot be written.
    """
    monitor = monitor or Monitor()
    model = open_model(root)
    if candidates_file is not None:
        wanted: Sequence[PinholeView] = candidates_of(model, candidates_file)
        folder = out or model.workspace.renders / "candidates"
    else:
        wanted = _members(model, group, frames)
        folder = out or model.workspace.renders / f"{group}-views"
    if not wanted:
        raise InvalidInputError(
            f"{root} has no {group} views.",
            hint="Choose another group with --views, or --candidates.",
            path=root,
        )
    rasterizer = create_rasterizer(backend, monitor)
    model = replace(model, gaussians=model.gaussians.to(rasterizer.device))
    paths = []
    for done, view in enumerate(wanted, start=1):
        pixels = to_pixels(model.render(view, rasterizer))
        # Views are named after files; the names of candidates can be anything.
        name = view.name if candidates_file is None else _file_name(view.name)
        path = folder / f"{name}.png"
        with storage_errors(path):
            path.parent.mkdir(parents=True, exist_ok=True)
            Image.fromarray(pixels).save(path)
        paths.append(path)
        monitor.report(Stage.RENDER, done, len(wanted))
        monitor.check()
    return tuple(paths)


def _members(model: FolderModel, group: ViewGroup, frames: int) -> Sequence[PinholeView]:
    if group == "path":
        keys = [view.camera_from_model.inverse() for view in model.views]
        camera = model.camera
        return [
            PinholeView(f"{index:05d}", camera, model_from_camera.inverse())
            for index, model_from_camera in enumerate(smooth_path(keys, frames))
        ]
    return {
        "held-out": model.held_out,
        "training": model.views,
        "all": model.registered,
    }[group]


def _file_name(name: str) -> str:
    """A candidate's name as a safe file name; different names give different files."""
    return "".join(
        letter if letter.isalnum() or letter in "._-– " else f"%{ord(letter):02X}" for letter in name
    )
