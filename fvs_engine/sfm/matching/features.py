"""Stage one: cameras, shared by images of equal size and focal length, and SIFT features of every image.

What the mask of an image leaves out has none.
"""

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import pycolmap
from PIL import Image

from fvs_engine.errors import InvalidInputError, ReconstructionError
from fvs_engine.images.focal import focal_length_px
from fvs_engine.images.masks import read_mask, write_mask
from fvs_engine.images.metadata import read_priors
from fvs_engine.sfm.colmap.database import (
    Geodetic,
    add_positions,
    count_rows,
    feature_counts,
    image_cameras,
)
from fvs_engine.sfm.jobs import ExtractFeatures, ImportImages
from fvs_engine.sfm.settings import FeatureSettings, FocalPrior, SfmSettings
from fvs_engine.sfm.stages import Stages
from fvs_schema.findings import Finding, FindingCode
from fvs_schema.stages import Stage

_SAME_FOCAL = 1.02
"""Focal lengths within this ratio belong to one camera: focusing changes it a little, zooming more."""

_MIN_FEATURES = 50
"""Below, an image can hardly be registered."""

_HEADERS = 10_000
"""Images whose size and focal length are remembered."""


def extract_features(stages: Stages, names: Sequence[str]) -> None:
    """Write cameras, images and features into the database; images that have theirs are skipped.

    ``names`` are all images of the set, whose number decides the size that features are extracted from.

    Raises ``ReconstructionError`` when fewer than two images have features.
    """
    add_features(stages, names)
    _require_texture(stages, names)


def add_features(stages: Stages, names: Sequence[str], settings: FeatureSettings | None = None) -> None:
    """Extract features as ``extract_features`` does, but accept sets in which no image has any.

    ``settings`` are by default those for a set of these images.
    """
    database = stages.folder.database
    with stages.timed("features"):
        import_images(stages, names)
        done = set(feature_counts(database))
        settings = settings or stages.settings.features(len(names))
        missing = [name for name in names if name not in done]
        for (upsampled, masked), some in _by_kind(stages, missing, settings):
            request = ExtractFeatures(
                database=database,
                image_dir=stages.image_dir,
                names=tuple(some),
                max_image_size_px=settings.max_image_size_px,
                upsampled=upsampled,
                max_features=settings.max_features,
                mask_dir=stages.folder.masks if masked else None,
                threads=stages.settings.threads,
            )
            _extract(stages, request, names, [name for name in names if name in done])
    stages.monitor.report(Stage.FEATURES, len(names), len(names))


def _extract(stages: Stages, request: ExtractFeatures, names: Sequence[str], harmless: Sequence[str]) -> None:
    """Extract features of some of ``names``; those that are ``harmless`` are known to crash nothing."""
    stages.native_over(
        request.names,
        lambda some: request.model_copy(update={"names": tuple(some)}),
        controls=harmless,
        on_tick=lambda: stages.monitor.report(
            Stage.FEATURES, count_rows(request.database, "keypoints"), len(names)
        ),
    )


def _by_kind(
    stages: Stages, names: Sequence[str], settings: FeatureSettings
) -> list[tuple[tuple[bool, bool], list[str]]]:
    """The images by whether they are upsampled, and whether they have a mask, which is written for COLMAP."""
    kinds: dict[tuple[bool, bool], list[str]] = {}
    for name in names:
        width, height, _ = _header(stages.image_dir / name)
        side_px = min(max(width, height), settings.max_image_size_px)
        mask = read_mask(stages.image_dir, name)
        if mask is not None:
            write_mask(mask, stages.folder.masks / f"{name}.png")
        kinds.setdefault((side_px < settings.upsample_below_px, mask is not None), []).append(name)
    return sorted(kinds.items(), reverse=True)


@dataclass(frozen=True, eq=False)
class CameraGroup:
    """Images of one size and focal length, which share a camera.

    ``focal_prior_px`` is the focal length prior where the EXIF of the group's first image has none.
    """

    width: int
    height: int
    names: tuple[str, ...]
    focal_prior_px: float | None


def camera_groups(image_dir: Path, names: Sequence[str], prior: FocalPrior | None) -> list[CameraGroup]:
    """Group images by size and focal length: that of their EXIF, else the prior."""
    members: dict[tuple[int, int, int | None], list[str]] = {}
    priors: dict[tuple[int, int, int | None], float | None] = {}
    for name in names:
        width, height, focal_px = _header(image_dir / name)
        prior_px = prior.at(width) if prior is not None and focal_px is None else None
        focal_px = focal_px or prior_px
        focal_class = None if focal_px is None else round(math.log(focal_px) / math.log(_SAME_FOCAL))
        key = (width, height, focal_class)
        members.setdefault(key, []).append(name)
        priors.setdefault(key, prior_px)
    return [
        CameraGroup(width, height, tuple(group), priors[width, height, focal_class])
        for (width, height, focal_class), group in members.items()
    ]


def _header(file: Path) -> tuple[int, int, float | None]:
    """Width, height, and the focal length in px by the EXIF of an image."""
    status = file.stat()
    return _read_header(file, status.st_mtime_ns, status.st_size)


@lru_cache(maxsize=_HEADERS)
def _read_header(file: Path, _changed_ns: int, _size_bytes: int) -> tuple[int, int, float | None]:
    """``_header`` of a file that changed last at that time: each update needs those of all images."""
    with Image.open(file) as image:
        width, height = image.size
        return width, height, focal_length_px(image.getexif(), width, height)


def import_images(stages: Stages, names: Sequence[str]) -> None:
    """Write images into the database, each with the camera of its group among ``names`` and its position."""
    database = stages.folder.database
    known = image_cameras(database)
    if not all(name in known for name in names):
        _import_unknown(stages, names, known)
    add_positions(database, lambda name: _position(stages.image_dir / name))


def _import_unknown(stages: Stages, names: Sequence[str], known: Collection[str]) -> None:
    database = stages.folder.database
    for group in camera_groups(stages.image_dir, names, stages.settings.focal_prior):
        missing = [name for name in group.names if name not in known]
        if not missing:
            continue
        model, params = _intrinsics(stages.settings, group)

        def request(
            some: Sequence[str], group: CameraGroup = group, model: str = model, params: str = params
        ) -> ImportImages:
            # A group that was interrupted, or that grew, continues with the camera it has.
            cameras = image_cameras(database)
            return ImportImages(
                database=database,
                image_dir=stages.image_dir,
                names=tuple(some),
                model=model,
                params=params,
                camera_id=next((cameras[name] for name in group.names if name in cameras), -1),
            )

        stages.native_over(missing, request, controls=[name for name in names if name in known])


def _position(file: Path) -> Geodetic:
    with file.open("rb") as content:
        priors = read_priors(content)
    return priors.latitude_deg, priors.longitude_deg, priors.altitude_m


def _intrinsics(settings: SfmSettings, group: CameraGroup) -> tuple[str, str]:
    """COLMAP's camera model and parameters for a group; no parameters where COLMAP takes EXIF or its default.

    COLMAP marks the focal length of given parameters as a prior.
    """
    known, width, height = settings.intrinsics, group.width, group.height
    if known is None:
        if group.focal_prior_px is None:
            return settings.first_camera_model, ""
        camera = pycolmap.Camera.create_from_model_name(
            1, settings.first_camera_model, group.focal_prior_px, width, height
        )
        return settings.first_camera_model, ", ".join(repr(float(value)) for value in camera.params)
    if abs(known.width_px * height / (known.height_px * width) - 1.0) > 0.01:
        raise InvalidInputError(
            f"The given intrinsics are for {known.width_px}×{known.height_px} px, but there are images of "
            f"{width}×{height} px, which is another shape.",
            hint="Leave out the images of another shape, or the intrinsics.",
        )
    return known.model, ", ".join(repr(value) for value in known.camera().resized(width, height).params)


def _require_texture(stages: Stages, names: Sequence[str]) -> None:
    counts = feature_counts(stages.folder.database)
    unreadable = [name for name in names if name not in counts]
    poor = [name for name in names if name in counts and counts[name] < _MIN_FEATURES]
    usable = len(names) - len(unreadable) - len(poor)
    if usable < 2:
        lacking = (unreadable + poor)[0]
        raise ReconstructionError(
            f"{len(names) - usable} of {len(names)} images have no texture, such as {lacking}.",
            hint="Photograph something with structure, in focus and in light; a bare wall has no features.",
        )
    if unreadable:
        stages.warnings.append(Finding.of(FindingCode.NO_FEATURES, unreadable))
    if poor:
        stages.warnings.append(Finding.of(FindingCode.FEW_FEATURES, poor))
