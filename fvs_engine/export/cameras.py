"""Cameras for other programs: the ``cameras.json`` of the 3DGS release, and a COLMAP model."""

import json
from collections.abc import Sequence
from pathlib import Path

from fvs_engine.files.atomic import write_text_atomically
from fvs_engine.geometry import SimilarityTransform
from fvs_engine.sfm.colmap.model import move, open_colmap
from fvs_engine.views import PinholeView


def write_cameras(path: Path, views: Sequence[PinholeView], frame_from_model: SimilarityTransform) -> None:
    """Write a list of cameras as splat viewers read it: centre, rotation frame_from_camera, focal lengths.

    Principal points, which 3DGS takes for the middle of the image, come as ``cx`` and ``cy``. Raises
    ``StorageError`` when the file cannot be written.
    """
    cameras = []
    for number, view in enumerate(views):
        frame_from_camera = frame_from_model.move_camera(view.camera_from_model.inverse())
        camera = view.camera
        cameras.append(
            {
                "id": number,
                "img_name": view.name,
                "width": camera.width,
                "height": camera.height,
                "position": frame_from_camera.translation.tolist(),
                "rotation": frame_from_camera.rotation.tolist(),
                "fx": camera.fx,
                "fy": camera.fy,
                "cx": camera.cx,
                "cy": camera.cy,
            }
        )
    write_text_atomically(path, json.dumps(cameras, indent=1) + "\n")


def write_moved_colmap(folder: Path, model: Path, frame_from_model: SimilarityTransform) -> None:
    """Write the COLMAP model in the folder ``model`` to ``folder``, moved, with its points and tracks.

    Raises ``StorageError`` when the model cannot be read or a file cannot be written.
    """
    reconstruction = open_colmap(model)
    move(reconstruction, frame_from_model)
    folder.mkdir(parents=True, exist_ok=True)
    reconstruction.write_binary(folder)
