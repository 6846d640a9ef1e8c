"""The native jobs of ALIKED: features of images, and verified matches between them.

They are stored in a separate database, with the image ids of the SIFT database: pairs of the two never mix.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pycolmap
from numpy.typing import NDArray
from PIL import Image

from fvs_engine.sfm.aliked.matching import match
from fvs_engine.sfm.colmap.database import image_ids
from fvs_engine.sfm.native.report import Report

if TYPE_CHECKING:
    from fvs_engine.sfm.aliked.features import AlikedFeatures

_HALF = 2
"""Bytes per descriptor element: half precision changes no match and halves the file."""


def extract_aliked(
    report: Report,
    *,
    database: str,
    target: str,
    image_dir: str,
    names: list[str],
    weights: str,
    threads: int | None,
) -> None:
    """Write features of images of ``database`` into ``target``; reports how many images have theirs."""
    # Imported in the fork only: the server stays small, and torch's threads would not survive the fork.
    import torch

    from fvs_engine.sfm.aliked.features import extract
    from fvs_engine.sfm.aliked.network import Aliked

    if threads is not None:
        torch.set_num_threads(threads)
    network = Aliked.load(Path(weights))
    with pycolmap.Database.open(database) as source, pycolmap.Database.open(target) as opened:
        for number, name in enumerate(names, start=1):
            image = source.read_image_with_name(name)
            if image is None:
                raise ValueError(f"the database has no image {name}")
            if not opened.exists_keypoints(image.image_id):
                with Image.open(Path(image_dir) / name) as pixels:
                    features = extract(network, pixels)
                _write(opened, image, source.read_camera(image.camera_id), features)
            report(number)


def _write(
    database: pycolmap.Database, image: pycolmap.Image, camera: pycolmap.Camera, features: "AlikedFeatures"
) -> None:
    if not database.exists_camera(camera.camera_id):
        database.write_camera(camera, use_camera_id=True)
    if not database.exists_image(image.image_id):
        copy = pycolmap.Image(name=image.name, camera_id=camera.camera_id, image_id=image.image_id)
        database.write_image(copy, use_image_id=True)
    halves = np.ascontiguousarray(features.descriptors, dtype=np.float16)
    stored = halves.view(np.uint8).reshape(len(halves), -1)
    database.write_descriptors(
        image.image_id, pycolmap.FeatureDescriptors(pycolmap.FeatureExtractorType.UNDEFINED, stored)
    )
    database.write_keypoints(image.image_id, features.keypoints)  # last: an image that has them is complete


def match_aliked(report: Report, *, database: str, pairs: Sequence[tuple[str, str]], seed: int) -> None:
    """Match and verify pairs of images; those that are done are skipped. Reports how many are done."""
    ids = image_ids(Path(database))
    options = pycolmap.TwoViewGeometryOptions()
    options.ransac.random_seed = seed
    with pycolmap.Database.open(database) as opened:
        features = _Features(opened)
        for number, pair in enumerate(pairs, start=1):
            first, second = sorted(ids[name] for name in pair)
            if not opened.exists_two_view_geometry(first, second):
                geometry = pycolmap.estimate_two_view_geometry(
                    features.camera(first),
                    features.keypoints(first),
                    features.camera(second),
                    features.keypoints(second),
                    match(features.descriptors(first), features.descriptors(second)),
                    options,
                )
                opened.write_two_view_geometry(first, second, geometry)
            report(number)


class _Features:
    """The features in a database, each read once."""

    def __init__(self, database: pycolmap.Database) -> None:
        self._database = database
        self._descriptors: dict[int, NDArray[np.float32]] = {}

    def camera(self, image_id: int) -> pycolmap.Camera:
        """The camera of an image."""
        return self._database.read_camera(self._database.read_image(image_id).camera_id)

    def keypoints(self, image_id: int) -> NDArray[np.float64]:
        """The positions [K, 2] in px."""
        return np.asarray(self._database.read_keypoints(image_id), dtype=np.float64)[:, :2]

    def descriptors(self, image_id: int) -> NDArray[np.float32]:
        """The unit vectors [K, 128]."""
        if image_id not in self._descriptors:
            stored = np.ascontiguousarray(self._database.read_descriptors(image_id).data)
            width = stored.shape[1] // _HALF if stored.size else 1
            halves = stored.view(np.float16).reshape(-1, width)
            self._descriptors[image_id] = halves.astype(np.float32)
        return self._descriptors[image_id]
