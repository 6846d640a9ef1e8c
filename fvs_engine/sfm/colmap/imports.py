"""Import of a COLMAP model, and the fit of imported cameras to their photographs."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pycolmap
from numpy.typing import NDArray

from fvs_engine.errors import InvalidInputError
from fvs_engine.files.folders import require_folder
from fvs_engine.geometry import SimilarityTransform
from fvs_engine.geometry.cameras import Camera
from fvs_engine.images.names import match_files
from fvs_engine.images.pixels import stored_size
from fvs_engine.sfm.colmap.model import (
    camera_centres,
    from_pycolmap,
    has_colmap_model,
    move,
    open_colmap,
    rigid_from_pycolmap,
)
from fvs_engine.sfm.reconstruction import Reconstruction, near_origin

_MAX_SHAPE_CHANGE = 0.01
"""Resizing rounds to whole pixels, which changes the ratio of the sides a little."""


def find_colmap_model(folder: Path) -> Path:
    """The folder that holds the model: ``folder``, or ``sparse/0``, ``sparse`` or ``0`` in it.

    Raises ``InvalidInputError`` when there is none.
    """
    hint = "Give the folder with cameras, images and points3D (.bin or .txt), or the one above it."
    require_folder(folder, hint)
    for candidate in (folder, folder / "sparse" / "0", folder / "sparse", folder / "0"):
        if has_colmap_model(candidate):
            return candidate
    raise InvalidInputError(f"{folder} holds no COLMAP model.", hint=hint, path=folder)


def open_near(folder: Path) -> tuple[pycolmap.Reconstruction, NDArray[np.float64]]:
    """The COLMAP model in or below ``folder`` with its tracks, moved by ``near_origin``; and that origin [3].

    Raises ``InvalidInputError`` when there is no model, nothing in it has a pose, or a pose cannot be used,
    ``StorageError`` when the model is damaged.
    """
    source = find_colmap_model(folder)
    model = open_colmap(source)
    if model.num_reg_images() == 0:
        raise InvalidInputError(
            f"No image of the model in {source} has a pose.",
            hint="Give the model of a finished mapping.",
            path=source,
        )
    for image in model.images.values():
        if not image.has_pose:
            continue
        try:
            rigid_from_pycolmap(image.cam_from_world())
        except InvalidInputError as error:
            raise InvalidInputError(
                f"The pose of {image.name} in {source} cannot be used: {error.message}",
                hint="Leave that image out of the model, or export it again.",
                path=source,
            ) from error
    origin = near_origin(np.stack(list(camera_centres(model).values())))
    if origin.any():
        move(model, SimilarityTransform(1.0, np.eye(3), -origin))
    return model, origin


def import_colmap(colmap_dir: Path, image_dir: Path | None = None) -> Reconstruction:
    """Read the posed images and the points of a COLMAP model (binary or text) in or below ``colmap_dir``.

    With ``image_dir`` the cameras are fitted to the photographs there (``fit_cameras``). Raises what
    ``open_near`` raises.
    """
    model, origin = open_near(colmap_dir)
    reconstruction = replace(from_pycolmap(model), origin=origin)
    return reconstruction if image_dir is None else fit_cameras(reconstruction, image_dir)


def fit_cameras(reconstruction: Reconstruction, image_dir: Path) -> Reconstruction:
    """Scale the cameras to their images in ``image_dir``, which may have been resized since.

    ``images.names.match_files`` finds the images; a view without one keeps its camera. Raises
    ``InvalidInputError`` when a name is ambiguous, and when an image cannot be read or has another shape than
    its camera.
    """
    found = match_files([view.name for view in reconstruction.views], image_dir).found
    views = []
    for view in reconstruction.views:
        name = found.get(view.name)
        fitted = view.camera if name is None else fit_camera(view.camera, image_dir / name)
        views.append(replace(view, camera=fitted))
    return replace(reconstruction, views=tuple(views))


def fit_camera(camera: Camera, photograph: Path) -> Camera:
    """The camera at the size of the photograph's stored pixels.

    Raises ``InvalidInputError`` unless they have its shape.
    """
    width, height = stored_size(photograph)
    if (camera.width, camera.height) == (width, height):
        return camera
    if not has_shape(camera, width, height):
        turned = has_shape(camera, height, width)
        raise InvalidInputError(
            f"{photograph.name} is {width}×{height} px, its camera {camera.width}×{camera.height} px.",
            hint="Turn its pixels as its camera has them, and remove the orientation from its EXIF."
            if turned
            else "Give the photographs that the cameras were computed from, at any scale.",
        )
    return camera.resized(width, height)


def has_shape(camera: Camera, width: int, height: int) -> bool:
    """Whether the camera's image has the ratio of these sides."""
    return abs(width * camera.height / (camera.width * height) - 1.0) <= _MAX_SHAPE_CHANGE
