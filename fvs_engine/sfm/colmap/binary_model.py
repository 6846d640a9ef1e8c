"""Reading COLMAP's binary files without tracks and observations.

Pycolmap makes an object of each of these, of which there are a hundred times as many as of points and images.
The files must be whole (see ``files``). Source: COLMAP's ``doc/format.rst``.
"""

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pycolmap
from numpy.typing import NDArray

from fvs_engine.images.names import decoded_name
from fvs_engine.sfm.colmap.files import camera_parameters, record_offsets

_CAMERA = struct.Struct("<IiQQ")  # id, model, width, height
_IMAGE = struct.Struct("<I7dI")  # id, quaternion (w first), translation, camera id
_POINT = np.dtype(
    [("id", "<u8"), ("xyz", "<f8", 3), ("color", "u1", 3), ("error", "<f8")]
)  # its track follows


@dataclass(frozen=True, eq=False)
class PosedImage:
    """An image's name, camera and pose."""

    name: str
    camera_id: int
    camera_from_model: pycolmap.Rigid3d


def read_cameras(folder: Path) -> dict[int, pycolmap.Camera]:
    """Id → camera of the model in ``folder``; raises ``ValueError`` when two have one id."""
    content, cameras = (folder / "cameras.bin").read_bytes(), {}
    for offset in record_offsets(content, "cameras.bin"):
        camera_id, model, width, height = _CAMERA.unpack_from(content, offset)
        if camera_id in cameras:
            raise ValueError(f"two cameras have the id {camera_id}")
        cameras[camera_id] = pycolmap.Camera(
            model=pycolmap.CameraModelId(model),
            width=width,
            height=height,
            params=np.frombuffer(content, "<f8", camera_parameters(model), offset + _CAMERA.size),
            camera_id=camera_id,
        )
    return cameras


def read_posed_images(folder: Path) -> Iterator[PosedImage]:
    """The images of the model in ``folder``; COLMAP writes those that have a pose.

    Raises ``ValueError`` when two have one id.
    """
    content, ids = (folder / "images.bin").read_bytes(), set[int]()
    for offset in record_offsets(content, "images.bin"):
        image_id, w, x, y, z, *translation, camera_id = _IMAGE.unpack_from(content, offset)
        if image_id in ids:
            raise ValueError(f"two images have the id {image_id}")
        ids.add(image_id)
        rotation = pycolmap.Rotation3d(np.array([x, y, z, w]))
        pose = pycolmap.Rigid3d(rotation, np.array(translation))
        yield PosedImage(_name(content, offset), camera_id, pose)


def read_names(folder: Path) -> dict[int, str]:
    """Id → name of the images of the model in ``folder``, whatever their character set (``decoded_name``)."""
    content = (folder / "images.bin").read_bytes()
    offsets = record_offsets(content, "images.bin")
    return {_IMAGE.unpack_from(content, offset)[0]: _name(content, offset) for offset in offsets}


def _name(content: bytes, offset: int) -> str:
    start = offset + _IMAGE.size
    return decoded_name(content[start : content.index(b"\0", start)])


def read_points(folder: Path) -> tuple[NDArray[np.float64], NDArray[np.uint8], NDArray[np.float64]]:
    """Positions [P, 3], colours [P, 3] and mean reprojection errors [P] in px of the model's points."""
    content = (folder / "points3D.bin").read_bytes()
    starts = record_offsets(content, "points3D.bin")
    heads = b"".join(content[start : start + _POINT.itemsize] for start in starts)
    points = np.frombuffer(heads, dtype=_POINT)
    return points["xyz"].copy(), points["color"].copy(), points["error"].copy()
