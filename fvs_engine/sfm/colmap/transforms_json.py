"""Import of a ``transforms.json``, as NeRF datasets have it: camera to world, OpenGL axes."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np

from fvs_engine.errors import InvalidInputError
from fvs_engine.files.json_input import read_json
from fvs_engine.geometry import PinholeCamera, RigidTransform
from fvs_engine.geometry.cameras import Camera, DistortedCamera
from fvs_engine.geometry.look_at import OPENGL_FROM_OPENCV
from fvs_engine.images.names import match_files
from fvs_engine.images.pixels import stored_size
from fvs_engine.sfm.reconstruction import Reconstruction, near_origin
from fvs_engine.views import View

_PERSPECTIVE = (
    "OPENCV",
    "PINHOLE",
    "SIMPLE_PINHOLE",
    "SIMPLE_RADIAL",
    "RADIAL",
    "FULL_OPENCV",
    "PERSPECTIVE",
)
_FISHEYE = ("OPENCV_FISHEYE", "FISHEYE", "SIMPLE_FISHEYE", "RADIAL_FISHEYE", "SIMPLE_RADIAL_FISHEYE")
_OTHER_LENSES = ("ftheta_p0", "latlong", "equirectangular", "orthographic", "distortion_params")
"""Fields by which files declare lenses that are not read, without a ``camera_model``."""


@dataclass(frozen=True, eq=False)
class _Frame:
    """A frame, over the file's head; ``image`` is its image beside the file, None if there is none."""

    name: str
    fields: Mapping[str, Any]
    image: Path | None
    model_from_camera: RigidTransform


def import_transforms_json(file: Path, image_dir: Path | None = None) -> Reconstruction:
    """Read the posed views of a ``transforms.json``; it has no points.

    Views are named by their ``file_path``, whether the image exists or not. Intrinsics may be in the file's
    head or in each frame; a size that is not given is that of the stored pixels of the image, which is beside
    the file or in ``image_dir``. Raises ``InvalidInputError`` for anything that is not such a file, for
    lenses that are not supported, for invalid rotations, and for numbers that are not finite.
    """
    frames = _frames(file)
    origin = near_origin(np.stack([frame.model_from_camera.translation for frame in frames]))
    elsewhere: Mapping[str, str] = {}
    sought = [frame.name for frame in frames if frame.image is None and _size(file, frame.fields) is None]
    if sought and image_dir is not None:
        masks = read_transforms_masks(file).values()
        elsewhere = match_files(sought, image_dir, {mask.resolve() for mask in masks if mask}).found
    views = []
    for frame in frames:
        image = frame.image
        if image is None and image_dir is not None and frame.name in elsewhere:
            image = image_dir / elsewhere[frame.name]
        pose = frame.model_from_camera
        near = RigidTransform(pose.rotation, pose.translation - origin)
        views.append(View(frame.name, _camera(file, frame.fields, image), near.inverse()))
    return Reconstruction.of_views(views, origin)


def read_transforms_poses(file: Path) -> dict[str, RigidTransform]:
    """Name → model_from_camera of the frames of a ``transforms.json``; raises ``InvalidInputError``."""
    return {frame.name: frame.model_from_camera for frame in _frames(file)}


def read_transforms_masks(file: Path) -> dict[str, Path | None]:
    """Name → mask of the frames, None without one; empty if no frame has one.

    It is the ``mask_path`` that nerfstudio writes, of the frame or of the file's head, relative to the file.
    Raises ``InvalidInputError``, also for a mask that does not exist.
    """
    masks: dict[str, Path | None] = {}
    for frame in _frames(file):
        path = frame.fields.get("mask_path")
        if path is None:
            masks[frame.name] = None
            continue
        if not isinstance(path, str) or not path:
            raise InvalidInputError(f"The mask_path of {frame.name} in {file} is not a path.", path=file)
        mask = file.parent / path.replace("\\", "/")
        if not mask.is_file():
            raise InvalidInputError(
                f"{mask}, the mask of {frame.name} in {file}, does not exist.",
                hint="Add it, or remove the frame's mask_path. Paths are relative to the transforms.json.",
                path=mask,
            )
        masks[frame.name] = mask
    return masks if any(masks.values()) else {}


def _frames(file: Path) -> list[_Frame]:
    head = read_json(file)
    if not isinstance(head, dict):
        raise InvalidInputError(
            f"{file} is not a transforms.json.", hint="It must be a JSON object.", path=file
        )
    frames = head.get("frames")
    if not isinstance(frames, list) or not frames:
        raise InvalidInputError(
            f"{file} has no frames.",
            hint="Give a transforms.json as NeRF datasets have it, with a list of frames.",
            path=file,
        )
    found: dict[str, _Frame] = {}
    for number, frame in enumerate(frames):
        if not isinstance(frame, dict) or not isinstance(frame.get("file_path"), str):
            raise InvalidInputError(f"Frame {number} of {file} has no file_path.", path=file)
        plain = PurePosixPath(frame["file_path"].replace("\\", "/"))
        if not plain.name:
            raise InvalidInputError(
                f"The file_path of frame {number} of {file} is not the path of a file.", path=file
            )
        name, image = _locate(file, plain)
        if name in found:
            raise InvalidInputError(f"{file} has more than one frame for {name}.", path=file)
        found[name] = _Frame(name, {**head, **frame}, image, _model_from_camera(file, name, frame))
    return list(found.values())


def _locate(file: Path, plain: PurePosixPath) -> tuple[str, Path | None]:
    """The view's name and its image, None if it does not exist; Blender omits the suffix ``.png``."""
    for candidate in (plain, plain.with_name(plain.name + ".png")):
        if (file.parent / candidate).is_file():
            return candidate.as_posix(), file.parent / candidate
    return plain.as_posix(), None


def _model_from_camera(file: Path, name: str, frame: Mapping[str, Any]) -> RigidTransform:
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
    return model_from_opengl_camera @ OPENGL_FROM_OPENCV


def _size(file: Path, fields: Mapping[str, Any]) -> tuple[float, float] | None:
    width, height = _number(file, fields, "w"), _number(file, fields, "h")
    return None if width is None or height is None else (width, height)


def _camera(file: Path, fields: Mapping[str, Any], image: Path | None) -> Camera:
    is_fisheye = _is_fisheye(file, fields)
    size = _size(file, fields) or (None if image is None else stored_size(image))
    if size is None:
        raise InvalidInputError(
            f"{file} has no image size, and {fields['file_path']} is not found.",
            hint="Add w and h in px, or give the folder of its photographs.",
            path=file,
        )
    width, height = size
    fx = _number(file, fields, "fl_x") or _focal(width, _number(file, fields, "camera_angle_x"))
    if fx is None:
        raise InvalidInputError(
            f"{file} has no focal length.", hint="Add fl_x (px) or camera_angle_x (rad).", path=file
        )
    fy = _number(file, fields, "fl_y") or _focal(height, _number(file, fields, "camera_angle_y")) or fx
    cx, cy = _number(file, fields, "cx"), _number(file, fields, "cy")
    centre = (width / 2 if cx is None else cx, height / 2 if cy is None else cy)
    lens = {
        key: _number(file, fields, key) or 0.0 for key in ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")
    }
    pixels = (round(width), round(height))
    if is_fisheye:
        radial = (lens["k1"], lens["k2"], lens["k3"], lens["k4"])
        return DistortedCamera("OPENCV_FISHEYE", *pixels, (fx, fy, *centre, *radial))
    if not any(lens.values()):
        return PinholeCamera(*pixels, fx, fy, *centre)
    coefficients = tuple(lens.values())
    if any(coefficients[4:]):
        return DistortedCamera("FULL_OPENCV", *pixels, (fx, fy, *centre, *coefficients))
    return DistortedCamera("OPENCV", *pixels, (fx, fy, *centre, *coefficients[:4]))


def _is_fisheye(file: Path, fields: Mapping[str, Any]) -> bool:
    """Whether the lens is a fisheye, not a perspective one; raises ``InvalidInputError`` for any other."""
    model = fields.get("camera_model")
    if model is not None and str(model).upper() not in (*_PERSPECTIVE, *_FISHEYE):
        raise _unsupported(file, f"camera_model {str(model)[:40]}")
    for field in _OTHER_LENSES:
        value = fields.get(field)
        if any(value) if isinstance(value, list) else value:
            raise _unsupported(file, field)
    return bool(fields.get("is_fisheye")) or str(model).upper() in _FISHEYE


def _unsupported(file: Path, lens: str) -> InvalidInputError:
    return InvalidInputError(
        f"{file} has cameras with {lens}, which is not supported.",
        hint=f"Undistort the images to PINHOLE, or give one of {', '.join((*_PERSPECTIVE, *_FISHEYE))}.",
        path=file,
    )


def _focal(size: float, angle_rad: float | None) -> float | None:
    """From the field of view, None without one; raises ``InvalidInputError`` for an impossible angle."""
    if angle_rad is None:
        return None
    if not 0 < angle_rad < math.pi:
        raise InvalidInputError(f"A field of view of {angle_rad:g} rad is not between 0 and π.")
    return 0.5 * size / math.tan(0.5 * angle_rad)


def _number(file: Path, fields: Mapping[str, Any], key: str) -> float | None:
    value = fields.get(key)
    if value is None:
        return None
    try:
        if not isinstance(value, bool) and isinstance(value, int | float) and math.isfinite(value):
            return float(value)
    except OverflowError:  # an integer beyond the range of floats
        pass
    raise InvalidInputError(f"{key} in {file} is {str(value)[:40]}, not a finite number.", path=file)
