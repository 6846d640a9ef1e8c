"""COLMAP models, read, written and converted to the engine's own types."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pycolmap
from numpy.typing import NDArray

from fvs_engine.errors import InvalidInputError, StorageError
from fvs_engine.geometry import PinholeCamera, RigidTransform, SimilarityTransform
from fvs_engine.geometry.cameras import CAMERA_MODELS, Camera, DistortedCamera
from fvs_engine.sfm.colmap.binary_model import read_cameras, read_names, read_points, read_posed_images
from fvs_engine.sfm.colmap.files import damaged_file, with_plain_text
from fvs_engine.sfm.reconstruction import PointCloud, Reconstruction
from fvs_engine.views import AnyView, View

MODEL_FILES = ("cameras", "images", "points3D")
"""The three files of a COLMAP model, all ``.bin`` or all ``.txt``."""

_HINT = "Export the model again, or delete the folder to have it computed again."


def has_colmap_model(folder: Path) -> bool:
    """Whether ``folder`` holds a whole COLMAP model, binary or text."""
    return any(
        all((folder / f"{stem}{suffix}").is_file() for stem in MODEL_FILES) for suffix in (".bin", ".txt")
    )


def read_colmap(folder: Path) -> Reconstruction:
    """Read the COLMAP model (binary or text) in ``folder``.

    Raises ``StorageError`` when there is none or it is damaged, ``InvalidInputError`` for a camera model that
    the engine does not know.
    """
    if not all((folder / f"{stem}.bin").is_file() for stem in MODEL_FILES):
        return from_pycolmap(open_colmap(folder))
    _require_sound(folder)
    try:
        cameras, images = read_cameras(folder), list(read_posed_images(folder))
        xyz, colors, errors_px = read_points(folder)
        of_images = [cameras[image.camera_id] for image in images]
    except (KeyError, ValueError) as error:  # numbers that fit the format and nothing else
        raise _unreadable(folder) from error
    converted = {camera.camera_id: camera_from_pycolmap(camera) for camera in of_images}
    views = (
        View(image.name, converted[image.camera_id], rigid_from_pycolmap(image.camera_from_model))
        for image in images
    )
    ordered = tuple(sorted(views, key=lambda view: view.name))
    return Reconstruction(ordered, PointCloud(xyz, colors), errors_px)


def write_colmap(reconstruction: Reconstruction, folder: Path) -> None:
    """Write a binary COLMAP model into ``folder``, without observations (tracks)."""
    folder.mkdir(parents=True, exist_ok=True)
    to_pycolmap(reconstruction.views, points=reconstruction.points).write_binary(folder)


def open_colmap(folder: Path) -> pycolmap.Reconstruction:
    """Read the model in ``folder`` into pycolmap, with its tracks.

    Raises ``StorageError`` when there is none or it is damaged, ``InvalidInputError`` for a camera model in
    text that COLMAP does not know.
    """
    _require_sound(folder)
    try:
        with with_plain_text(folder) as plain:
            _require_known_cameras(plain)
            model = pycolmap.Reconstruction(plain)
    except InvalidInputError:
        raise
    except Exception as error:  # pycolmap passes on any C++ exception
        raise _unreadable(folder) from error
    try:
        for image in model.images.values():
            image.name  # noqa: B018 - it may not be UTF-8
    except UnicodeDecodeError:
        for image_id, name in read_names(folder).items():
            model.images[image_id].name = name
    return model


def _require_known_cameras(folder: Path) -> None:
    text = folder / "cameras.txt"
    if (folder / "cameras.bin").is_file() or not text.is_file():
        return
    for line in text.read_text(encoding="utf-8").splitlines():
        _, model, *_ = (*line.split(), "", "")
        if model and not line.startswith("#") and model not in pycolmap.CameraModelId.__members__:
            raise _unknown_type(model)


def _unknown_type(model: str) -> InvalidInputError:
    return InvalidInputError(
        f"The model has a camera of type {model}, which the engine does not know.",
        hint=f"Convert it to one of {', '.join(CAMERA_MODELS)}.",
    )


def _unreadable(folder: Path) -> StorageError:
    return StorageError(
        f"The COLMAP model in {folder} cannot be read: it is damaged or cut short.", hint=_HINT, path=folder
    )


def _require_sound(folder: Path) -> None:
    """Raise ``StorageError`` when there is no model in ``folder``, or a file of it is not whole."""
    if not has_colmap_model(folder):
        raise StorageError(
            f"{folder} holds no COLMAP model.",
            hint="A model is the three files cameras, images and points3D, as .bin or .txt.",
            path=folder,
        )
    damaged = damaged_file(folder)
    if damaged is not None:
        raise StorageError(f"{damaged} is damaged or cut short.", hint=_HINT, path=damaged)


def from_pycolmap(model: pycolmap.Reconstruction) -> Reconstruction:
    """Convert the registered images and the points of a pycolmap reconstruction."""
    posed = sorted((image for image in model.images.values() if image.has_pose), key=lambda image: image.name)
    used = {image.camera_id for image in posed}
    cameras = {camera_id: camera_from_pycolmap(model.cameras[camera_id]) for camera_id in used}
    points = list(model.points3D.values())
    return Reconstruction(
        views=tuple(
            View(image.name, cameras[image.camera_id], rigid_from_pycolmap(image.cam_from_world()))
            for image in posed
        ),
        points=PointCloud(
            np.array([point.xyz for point in points], dtype=np.float64).reshape(-1, 3),
            np.array([point.color for point in points], dtype=np.uint8).reshape(-1, 3),
        ),
        point_errors_px=np.array([point.error for point in points], dtype=np.float64),
    )


def to_pycolmap(
    views: Sequence[AnyView],
    *,
    points: PointCloud | None = None,
    image_ids: Mapping[str, int] | None = None,
) -> pycolmap.Reconstruction:
    """A pycolmap reconstruction with ``views``, and with ``points`` without tracks.

    Images are numbered from 1, or by ``image_ids`` (a database's).
    """
    model = pycolmap.Reconstruction()
    camera_ids: dict[Camera, int] = {}
    numbers = image_ids or {view.name: number for number, view in enumerate(views, start=1)}
    for view in views:
        if view.camera not in camera_ids:
            camera_ids[view.camera] = len(camera_ids) + 1
            camera = camera_to_pycolmap(view.camera, camera_ids[view.camera])
            model.add_camera_with_trivial_rig(camera)
        image = pycolmap.Image(name=view.name, camera_id=camera_ids[view.camera], image_id=numbers[view.name])
        model.add_image_with_trivial_frame(image, rigid_to_pycolmap(view.camera_from_model))
    if points is not None:
        for xyz, color in zip(points.xyz, points.colors, strict=True):
            model.add_point3D(xyz, pycolmap.Track(), color)
    return model


def camera_from_pycolmap(camera: pycolmap.Camera) -> Camera:
    """Convert a camera; raises ``InvalidInputError`` for a camera model that the engine does not know."""
    params = tuple(float(value) for value in camera.params)
    if camera.model_name not in CAMERA_MODELS:
        raise _unknown_type(camera.model_name)
    found = DistortedCamera(camera.model_name, camera.width, camera.height, params)
    if found.is_pinhole:
        return PinholeCamera(found.width, found.height, found.fx, found.fy, found.cx, found.cy)
    return found


def camera_to_pycolmap(camera: Camera, camera_id: int) -> pycolmap.Camera:
    """Convert a camera to pycolmap's."""
    if isinstance(camera, PinholeCamera):
        model = "PINHOLE"
        params: tuple[float, ...] = (camera.fx, camera.fy, camera.cx, camera.cy)
    else:
        model, params = camera.model, camera.params
    return pycolmap.Camera(
        model=model, width=camera.width, height=camera.height, params=np.array(params), camera_id=camera_id
    )


def rigid_from_pycolmap(transform: pycolmap.Rigid3d) -> RigidTransform:
    """Convert a rigid transform."""
    return RigidTransform(transform.rotation.matrix(), np.asarray(transform.translation))


def rigid_to_pycolmap(transform: RigidTransform) -> pycolmap.Rigid3d:
    """Convert a rigid transform to pycolmap's."""
    return pycolmap.Rigid3d(pycolmap.Rotation3d(transform.rotation), transform.translation)


def camera_poses(model: pycolmap.Reconstruction) -> dict[str, RigidTransform]:
    """Name → model_from_camera of the registered images."""
    return {
        image.name: rigid_from_pycolmap(image.cam_from_world()).inverse()
        for image in model.images.values()
        if image.has_pose
    }


def camera_centres(model: pycolmap.Reconstruction) -> dict[str, NDArray[np.float64]]:
    """Name → camera centre [3] of the registered images."""
    return {
        image.name: np.asarray(image.projection_center()) for image in model.images.values() if image.has_pose
    }


def move(model: pycolmap.Reconstruction, transform: SimilarityTransform) -> None:
    """Apply a transform to all cameras and points of ``model``."""
    model.transform(
        pycolmap.Sim3d(transform.scale, pycolmap.Rotation3d(transform.rotation), transform.translation)
    )
