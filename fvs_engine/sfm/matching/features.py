"""Stage one: cameras shared by what looks like one camera, and SIFT features of every image."""

import math
from collections.abc import Sequence
from pathlib import Path

from PIL import Image

from fvs_engine.errors import InvalidInputError, ReconstructionError
from fvs_engine.images.focal import focal_length_px
from fvs_engine.sfm.colmap.database import count_rows, feature_counts, image_cameras
from fvs_engine.sfm.settings import SfmSettings
from fvs_engine.sfm.stages import Stages

_SAME_FOCAL = 1.02
"""Focal lengths within this ratio belong to one camera: autofocus breathes, a zoom does not."""

_MIN_FEATURES = 50
"""Below, an image can hardly be registered."""

CameraKey = tuple[int, int, int | None]
"""Width and height in px, and the focal length's class: images that agree in it share a camera."""


def extract_features(stages: Stages, image_dir: Path, names: Sequence[str]) -> None:
    """Fill the database with cameras, images and features; images that have theirs are skipped.

    Raises ``ReconstructionError`` when fewer than two images have features.
    """
    add_features(stages, image_dir, names)
    _require_texture(stages, names)


def add_features(stages: Stages, image_dir: Path, names: Sequence[str]) -> None:
    """The same for images that may all turn out to have none."""
    database = stages.folder.database
    with stages.timed("features"):
        import_images(stages, image_dir, names)
        done = set(feature_counts(database))
        todo = [name for name in names if name not in done]
        if todo:
            stages.native(
                "extract",
                {
                    "database": str(database),
                    "image_dir": str(image_dir),
                    "names": todo,
                    "max_image_size": stages.settings.max_image_size_px,
                    "max_features": stages.settings.max_features,
                    "threads": stages.settings.threads,
                },
                on_tick=lambda: stages.monitor.report(
                    "features", count_rows(database, "keypoints"), len(names)
                ),
            )
    stages.monitor.report("features", len(names), len(names))


def camera_groups(image_dir: Path, names: Sequence[str]) -> dict[CameraKey, list[str]]:
    """Group images by size and EXIF focal length."""
    groups: dict[CameraKey, list[str]] = {}
    for name in names:
        with Image.open(image_dir / name) as image:
            width, height = image.size
            focal_px = focal_length_px(image.getexif(), width, height)
        focal_class = None if focal_px is None else round(math.log(focal_px) / math.log(_SAME_FOCAL))
        groups.setdefault((width, height, focal_class), []).append(name)
    return groups


def import_images(stages: Stages, image_dir: Path, names: Sequence[str]) -> None:
    """Give images a row in the database, with the camera of those among ``names`` that look like theirs."""
    database = stages.folder.database
    known = image_cameras(database)
    if all(name in known for name in names):
        return
    for (width, height, _), members in camera_groups(image_dir, names).items():
        missing = [name for name in members if name not in known]
        if not missing:
            continue
        # A group that was interrupted, or that grew, goes on with the camera it has.
        camera_id = next((known[name] for name in members if name in known), -1)
        model, params = _intrinsics(stages.settings, width, height)
        stages.native(
            "import_images",
            {
                "database": str(database),
                "image_dir": str(image_dir),
                "names": missing,
                "model": model,
                "params": params,
                "camera_id": camera_id,
            },
        )


def _intrinsics(settings: SfmSettings, width: int, height: int) -> tuple[str, str]:
    """COLMAP's model name and parameter list for images of this size; no list when they are not known."""
    known = settings.intrinsics
    if known is None:
        return settings.camera_model, ""
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
            f"{len(names) - usable} of {len(names)} images show no texture to hold on to, such as {lacking}.",
            hint="Photograph something with structure, in focus and in light; a bare wall has no features.",
        )
    if unreadable:
        stages.warnings.append(f"No features could be read from {', '.join(unreadable)}.")
    if poor:
        stages.warnings.append(f"Almost no texture in {', '.join(poor)}.")
