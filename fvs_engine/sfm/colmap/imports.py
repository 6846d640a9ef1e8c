"""Import of posed views: a COLMAP model, or a ``transforms.json`` of a NeRF dataset."""

import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np
from PIL import Image

from fvs_engine.errors import InvalidInputError
from fvs_engine.files.folders import require_folder
from fvs_engine.files.json_input import read_json
from fvs_engine.geometry import PinholeCamera, RigidTransform
from fvs_engine.geometry.cameras import Camera, DistortedCamera
from fvs_engine.geometry.look_at import OPENGL_FROM_OPENCV
from fvs_engine.images.names import match_files
from fvs_engine.sfm.colmap.model import from_pycolmap, has_colmap_model, open_colmap
from fvs_engine.sfm.reconstruction import Reconstruction
from fvs_engine.views import AnyView, View

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


def import_colmap(colmap_dir: Path, image_dir: Path | None = None) -> Reconstruction:
    """Read the posed images and the points of a COLMAP model (binary or text) in or below ``colmap_dir``.

    With ``image_dir`` the cameras are fitted to the photographs there (``fit_cameras``). Raises
    ``InvalidInputError`` when there is no model or nothing in it has a pose; ``StorageError`` when the model
    is damaged.
    """
    model = open_colmap(find_colmap_model(colmap_dir))
    if model.num_reg_images() == 0:
        raise InvalidInputError(f"No image of the model in {colmap_dir} has a pose.", path=colmap_dir)
    reconstruction = from_pycolmap(model)
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
    """The camera at the photograph's size; raises ``InvalidInputError`` unless that has its shape."""
    width, height = _image_size(photograph)
    if (camera.width, camera.height) == (width, height):
        return camera
    if abs(width * camera.height / (camera.width * height) - 1.0) > _MAX_SHAPE_CHANGE:
        raise InvalidInputError(
            f"{photograph.name} is {width}×{height} px, its camera {camera.width}×{camera.height} px.",
            hint="Give the photographs that the cameras were computed from, at any scale.",
        )
    return camera.resized(width, height)


def import_transforms_json(file: Path) -> Reconstruction:
    """Read the posed views of a ``transforms.json`` (camera-to-world, OpenGL axes); it has no points.

    Views are named by their ``file_path``, whether the image exists or not. Intrinsics may be in the file's
    head or in each frame; a size that is not given is the image's. Raises ``InvalidInputError`` for anything
    that is not such a file, for invalid rotations, and for numbers that are not finite.
    """
    head = _read_object(file)
    frames = head.get("frames")
    if not isinstance(frames, list) or not frames:
        raise InvalidInputError(
            f"{file} has no frames.",
            hint="Give a transforms.json as NeRF datasets have it, with a list of frames.",
            path=file,
        )
    views: dict[str, AnyView] = {}
    for number, frame in enumerate(frames):
        if not isinstance(frame, dict) or not isinstance(frame.get("file_path"), str):
            raise InvalidInputError(f"Frame {number} of {file} has no file_path.", path=file)
        plain = PurePosixPath(frame["file_path"].replace("\\", "/"))
        if not plain.name:
            raise InvalidInputError(
                f"The file_path of frame {number} of {file} is not the path of a file.", path=file
            )
        name, image = _locate(file, plain)
        if name in views:
            raise InvalidInputError(f"{file} has more than one frame for {name}.", path=file)
        camera = _camera(file, {**head, **frame}, image)
        views[name] = View(name, camera, _camera_from_model(file, name, frame))
    return Reconstruction.of_views(views.values())


def _read_object(file: Path) -> dict[str, Any]:
    head = read_json(file)
    if not isinstance(head, dict):
        raise InvalidInputError(
            f"{file} is not a transforms.json.", hint="It must be a JSON object.", path=file
        )
    return head


def _locate(file: Path, plain: PurePosixPath) -> tuple[str, Path | None]:
    """The view's name and its image, None if it does not exist; Blender omits the suffix ``.png``."""
    for candidate in (plain, plain.with_name(plain.name + ".png")):
        if (file.parent / candidate).is_file():
            return candidate.as_posix(), file.parent / candidate
    return plain.as_posix(), None


def _camera_from_model(file: Path, name: str, frame: Mapping[str, Any]) -> RigidTransform:
    try:
        matrix = np.asarray(frame.get("transform_matrix"), dtype=np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise InvalidInputError(
            f"The transform_matrix of {name} in {file} is not a matrix.", path=file
        ) from error
    if matrix.shape not in {(4, 4), (3, 4)}:
        raise InvalidInputError(f"The transform_matrix of {name} in {file} is not 4×4.", path=file)
    if not np.isfinite(matrix).all():
        raise InvalidInputError(
            f"The transform_matrix of {name} in {file} has a number that is not finite.", path=file
        )
    try:
        model_from_opengl_camera = RigidTransform(matrix[:3, :3], matrix[:3, 3])
    except InvalidInputError as error:
        raise InvalidInputError(
            f"The transform_matrix of {name} in {file}: {error.message}", path=file
        ) from error
    return (model_from_opengl_camera @ OPENGL_FROM_OPENCV).inverse()


def _image_size(path: Path) -> tuple[int, int]:
    try:
        with Image.open(path) as photograph:
            return photograph.size
    except OSError as error:  # Pillow's error for a file that is not an image derives from it
        raise InvalidInputError(
            f"{path} cannot be read as an image.", hint="Replace it, or leave it out of the model.", path=path
        ) from error


def _camera(file: Path, entry: Mapping[str, Any], image: Path | None) -> Camera:
    width, height = _number(file, entry, "w"), _number(file, entry, "h")
    if (width is None or height is None) and image is not None:
        width, height = _image_size(image)
    if width is None or height is None:
        raise InvalidInputError(f"{file} has no image size.", hint="Add w and h in px.", path=file)
    fx = _number(file, entry, "fl_x") or _focal(width, _number(file, entry, "camera_angle_x"))
    if fx is None:
        raise InvalidInputError(
            f"{file} has no focal length.", hint="Add fl_x (px) or camera_angle_x (rad).", path=file
        )
    fy = _number(file, entry, "fl_y") or _focal(height, _number(file, entry, "camera_angle_y")) or fx
    cx, cy = _number(file, entry, "cx"), _number(file, entry, "cy")
    centre = (width / 2 if cx is None else cx, height / 2 if cy is None else cy)
    lens = {key: _number(file, entry, key) or 0.0 for key in ("k1", "k2", "k3", "k4", "p1", "p2")}
    size = (round(width), round(height))
    if entry.get("camera_model") == "OPENCV_FISHEYE" or entry.get("is_fisheye"):
        fisheye = (fx, fy, *centre, lens["k1"], lens["k2"], lens["k3"], lens["k4"])
        return DistortedCamera("OPENCV_FISHEYE", *size, fisheye)
    if not any(lens.values()):
        return PinholeCamera(*size, fx, fy, *centre)
    if lens["k3"] or lens["k4"]:
        full = (lens["k1"], lens["k2"], lens["p1"], lens["p2"], lens["k3"], lens["k4"], 0.0, 0.0)
        return DistortedCamera("FULL_OPENCV", *size, (fx, fy, *centre, *full))
    opencv = (lens["k1"], lens["k2"], lens["p1"], lens["p2"])
    return DistortedCamera("OPENCV", *size, (fx, fy, *centre, *opencv))


def _focal(size: float, angle_rad: float | None) -> float | None:
    """From the field of view, None without one; raises ``InvalidInputError`` for an impossible angle."""
    if angle_rad is None:
        return None
    if not 0 < angle_rad < math.pi:
        raise InvalidInputError(f"A field of view of {angle_rad:g} rad is not between 0 and π.")
    return 0.5 * size / math.tan(0.5 * angle_rad)


def _number(file: Path, entry: Mapping[str, Any], key: str) -> float | None:
    value = entry.get(key)
    if value is None:
        return None
    try:
        if not isinstance(value, bool) and isinstance(value, int | float) and math.isfinite(value):
            return float(value)
    except OverflowError:  # an integer beyond the range of floats
        pass
    raise InvalidInputError(f"{key} in {file} is {str(value)[:40]}, not a finite number.", path=file)
