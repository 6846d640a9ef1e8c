"""A folder of simulated photographs, with their true poses in a ``transforms.json``."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from PIL import Image

from fvs_engine.errors import InvalidInputError, OutputExistsError, StorageError
from fvs_engine.files.atomic import replacing, write_text_atomically
from fvs_engine.geometry import OPENGL_FROM_OPENCV, DistortedCamera, RigidTransform
from fvs_engine.lab.simulate.camera import SimulatedCamera
from fvs_engine.lab.simulate.tracing import PackedWorld
from fvs_engine.lab.simulate.world import World
from fvs_engine.monitor import Monitor
from fvs_schema.stages import Stage

_JPEG_QUALITY = 95
_COEFFICIENTS = ("k1", "k2", "p1", "p2")
_EXIF_IFD, _FOCAL_LENGTH_35MM = 0x8769, 0xA405


def write_photographs(
    folder: Path,
    world: World,
    camera: SimulatedCamera,
    world_from_cameras: Sequence[RigidTransform],
    monitor: Monitor,
    seed: int = 0,
) -> list[Path]:
    """Photograph ``world`` from every pose into ``folder/images`` and write ``folder/transforms.json``.

    Files are JPEGs named in order, with the focal length in EXIF as phones write it; the true poses are in
    instant-ngp's conventions (OpenGL axes, ``k1 k2 p1 p2``). The same arguments give the same bytes, so that
    a call that was stopped can be repeated. Raises ``OutputExistsError`` when the folder holds photographs
    or poses of something else, ``StorageError`` when a file cannot be written and ``Cancelled`` between two.
    """
    images = folder / "images"
    names = [f"{index:04d}.jpg" for index in range(len(world_from_cameras))]
    truth = json.dumps(_transforms(camera, names, world_from_cameras), indent=1)
    _claim(folder, images, truth)
    packed = PackedWorld(world)
    exif = Image.Exif()
    exif.get_ifd(_EXIF_IFD)[_FOCAL_LENGTH_35MM] = round(36.0 * camera.camera.fx / camera.camera.width)
    paths = []
    for index, (name, world_from_camera) in enumerate(zip(names, world_from_cameras, strict=True)):
        monitor.check()
        path = images / name
        photograph = Image.fromarray(camera.photograph(packed, world_from_camera, seed * 1_000_003 + index))
        with replacing(path) as temporary:
            photograph.save(temporary, format="JPEG", quality=_JPEG_QUALITY, subsampling=0, exif=exif)
        paths.append(path)
        monitor.report(Stage.PHOTOGRAPHS, index + 1, len(world_from_cameras))
    return paths


def _claim(folder: Path, images: Path, truth: str) -> None:
    """Write the true poses into a folder that is empty or holds some of the same photographs."""
    poses = folder / "transforms.json"
    try:
        if poses.exists():
            taken = poses.read_bytes() != truth.encode()
        else:
            taken = images.exists() and any(images.iterdir())
        if not taken:
            images.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise StorageError(
            f"{folder} cannot be used: {error.strerror or error}.",
            hint="Choose an output folder that you may write to.",
            path=folder,
        ) from error
    if taken:
        raise OutputExistsError(
            f"{folder} holds other photographs or poses already.",
            hint="Choose another output folder; nothing was changed.",
            path=folder,
        )
    write_text_atomically(poses, truth)


def _transforms(
    camera: SimulatedCamera, names: Sequence[str], world_from_cameras: Sequence[RigidTransform]
) -> dict[str, Any]:
    lens = camera.camera
    coefficients = lens.named_params if isinstance(lens, DistortedCamera) else {}
    if set(coefficients) - {"f", "fx", "fy", "cx", "cy", *_COEFFICIENTS}:
        raise InvalidInputError("A transforms.json holds only the coefficients k1, k2, p1 and p2.")
    return {
        "w": lens.width,
        "h": lens.height,
        "fl_x": lens.fx,
        "fl_y": lens.fy,
        "cx": lens.cx,
        "cy": lens.cy,
        **{name: coefficients.get(name, 0.0) for name in _COEFFICIENTS},
        "frames": [
            {
                "file_path": f"images/{name}",
                "transform_matrix": (world_from_camera @ OPENGL_FROM_OPENCV).matrix.tolist(),
            }
            for name, world_from_camera in zip(names, world_from_cameras, strict=True)
        ],
    }
