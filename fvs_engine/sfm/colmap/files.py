"""Check that COLMAP's files are complete and in UTF-8, before pycolmap reads them.

pycolmap does not check the counts in a file: beyond the end of a truncated one it reads garbage, and may
allocate gigabytes before it fails, or never return. Source: COLMAP's
``doc/format.rst`` and ``reconstruction_io_binary.cc``.
"""

import contextlib
import struct
import tempfile
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

import pycolmap

from fvs_engine.images.names import decoded_name
from fvs_schema.text_files import decoded_text

_COUNT = struct.Struct("<Q")
_CAMERA_HEAD = struct.Struct("<IiQQ")  # id, model, width, height
_PARAMETER_BYTES = 8
_IMAGE_HEAD_BYTES = 4 + 7 * 8 + 4  # id, quaternion and translation, camera id
_OBSERVATION_BYTES = 8 + 8 + 8  # x, y, point id
_POINT_HEAD_BYTES = 8 + 3 * 8 + 3 + 8  # id, position, colour, error
_TRACK_ELEMENT_BYTES = 4 + 4  # image id, observation index
_RIG_HEAD = struct.Struct("<II")  # id, number of sensors
_SENSOR_BYTES = 4 + 4  # type, id
_POSE_BYTES = 7 * 8  # quaternion and translation
_FRAME_HEAD_BYTES = 4 + 4 + _POSE_BYTES  # id, rig id, pose
_NUMBER = struct.Struct("<I")
_DATA_BYTES = 4 + 4 + 8  # sensor, data id
_DAMAGES = (struct.error, ValueError, OverflowError)
"""Errors by which a walk says that a field extends beyond the end."""


def damaged_file(folder: Path) -> Path | None:
    """The first of the model's binary files in ``folder`` that is cut short or goes on too long, or None."""
    for name in _WALKS:
        file = folder / name
        if file.is_file() and not _is_whole(file):
            return file
    return None


@contextlib.contextmanager
def with_plain_text(folder: Path) -> Iterator[Path]:
    """A folder with the model of ``folder`` whose text files are UTF-8 without a byte order mark.

    That is ``folder`` itself, or a temporary copy. Names that are not Unicode are as ``decoded_name`` says.
    """
    contents = {}
    if not (folder / "images.bin").is_file():
        files = (folder / Path(name).with_suffix(".txt") for name in _WALKS)
        contents = {file.name: file.read_bytes() for file in files if file.is_file()}
    plain = {name: _text(content).encode() for name, content in contents.items()}
    if plain == contents:
        yield folder
        return
    with tempfile.TemporaryDirectory() as copy:
        for name, content in plain.items():
            Path(copy, name).write_bytes(content)
        yield Path(copy)


def _text(content: bytes) -> str:
    try:
        return decoded_text(content)
    except UnicodeDecodeError:
        return decoded_name(content)


def record_offsets(content: bytes, name: str) -> list[int]:
    """Where the records of the binary file ``name`` begin; raises one of ``_DAMAGES`` if it is damaged."""
    after = _WALKS[name]
    (count,) = _COUNT.unpack_from(content)
    offset, offsets = _COUNT.size, []
    for _ in range(count):
        offsets.append(offset)
        offset = after(content, offset)
    if offset != len(content):
        raise ValueError("does not end after its last record")
    return offsets


def camera_parameters(model: int) -> int:
    """The number of parameters of COLMAP's camera model of that number."""
    return len(pycolmap.Camera.create_from_model_id(1, pycolmap.CameraModelId(model), 1.0, 1, 1).params)


def _is_whole(file: Path) -> bool:
    """Whether the file ends after the number of records that its header declares."""
    try:
        record_offsets(file.read_bytes(), file.name)
    except _DAMAGES:
        return False
    return True


def _after_camera(content: bytes, offset: int) -> int:
    _, model, _, _ = _CAMERA_HEAD.unpack_from(content, offset)
    return offset + _CAMERA_HEAD.size + camera_parameters(model) * _PARAMETER_BYTES


def _after_image(content: bytes, offset: int) -> int:
    end_of_name = content.index(b"\0", offset + _IMAGE_HEAD_BYTES) + 1
    (observations,) = _COUNT.unpack_from(content, end_of_name)
    return end_of_name + _COUNT.size + int(observations) * _OBSERVATION_BYTES


def _after_point(content: bytes, offset: int) -> int:
    (track,) = _COUNT.unpack_from(content, offset + _POINT_HEAD_BYTES)
    return offset + _POINT_HEAD_BYTES + _COUNT.size + int(track) * _TRACK_ELEMENT_BYTES


def _after_rig(content: bytes, offset: int) -> int:
    _, sensors = _RIG_HEAD.unpack_from(content, offset)
    offset += _RIG_HEAD.size + (_SENSOR_BYTES if sensors else 0)
    for _ in range(sensors - 1):
        has_pose = content[offset + _SENSOR_BYTES : offset + _SENSOR_BYTES + 1]
        if not has_pose:
            raise ValueError("cut short")
        offset += _SENSOR_BYTES + 1 + (_POSE_BYTES if has_pose != b"\0" else 0)
    return offset


def _after_frame(content: bytes, offset: int) -> int:
    (count,) = _NUMBER.unpack_from(content, offset + _FRAME_HEAD_BYTES)
    return offset + _FRAME_HEAD_BYTES + _NUMBER.size + int(count) * _DATA_BYTES


_WALKS: Mapping[str, Callable[[bytes, int], int]] = {
    "cameras.bin": _after_camera,
    "images.bin": _after_image,
    "points3D.bin": _after_point,
    "rigs.bin": _after_rig,
    "frames.bin": _after_frame,
}
"""Name → the offset after the record at an offset."""
