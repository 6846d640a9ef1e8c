"""The verified matches that COLMAP's incremental mapper works on."""

from collections.abc import Collection
from pathlib import Path

import pycolmap

from fvs_engine.sfm.colmap.database import delete_database, image_ids, verified_ids
from fvs_engine.sfm.colmap.part_database import Part, matches_around, write_part
from fvs_engine.sfm.verification.pair_check import MIN_PAIR_MATCHES


def load_all(
    database: Path, names: Collection[str], model: pycolmap.Reconstruction
) -> pycolmap.DatabaseCache:
    """The images ``names`` and all verified matches between them, with the cameras of ``model``."""
    options = pycolmap.DatabaseCacheOptions()
    options.min_num_matches = MIN_PAIR_MATCHES
    options.image_names = set(names)
    # Some images of a model may have no loaded matches.
    options.load_all_images = True
    options.ignore_watermarks = True  # as everything else does that reads verified matches
    with pycolmap.Database.open(database) as opened:
        cache = pycolmap.DatabaseCache.create(opened, options)
    set_cameras(cache, model)
    return cache


def set_cameras(cache: pycolmap.DatabaseCache, model: pycolmap.Reconstruction) -> None:
    """Give ``cache`` the cameras of ``model``.

    A database has the camera models that mapping starts from. COLMAP fails where they differ.
    """
    for camera_id, camera in model.cameras.items():
        if cache.exists_camera(camera_id):
            cached = cache.camera(camera_id)
            cached.model, cached.params = camera.model, camera.params


def load_around(
    database: Path, names: Collection[str], new: Collection[str], model: pycolmap.Reconstruction
) -> pycolmap.DatabaseCache:
    """The images ``names``, and the verified matches between ``new`` ones and those that they match.

    COLMAP would read the matches of all images, and its mapper would process them all, although a new image
    needs few of them: with 200 images that takes longer than registering one.
    """
    ids = image_ids(database)
    images = {ids[name] for name in names if name in ids}
    # COLMAP fails at a pair of an image that it does not have.
    pairs = [pair for pair in verified_ids(database, MIN_PAIR_MATCHES) if images.issuperset(pair)]
    centre = {ids[name] for name in new if name in ids}
    near = centre.union(*(pair for pair in pairs if not centre.isdisjoint(pair)))
    inside = [pair for pair in pairs if near.issuperset(pair)]
    part = matches_around(database)
    try:
        write_part(part, database, Part(sorted(images), inside, ("keypoints",), ("two_view_geometries",)))
        return load_all(part, names, model)
    finally:
        delete_database(part)
