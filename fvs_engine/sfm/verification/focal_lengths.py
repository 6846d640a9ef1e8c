"""Focal lengths that no usual lens has, or that are far from those in EXIF.

They are refined with the model, and some scenes do not determine them: a wall seen head-on, a few images that
hardly overlap. Every match still fits such a model, whose depths are wrong.
"""

from collections.abc import Mapping

import pycolmap

from fvs_engine.sfm.verification.thresholds import PRIORS


def unlikely_focal_lengths(model: pycolmap.Reconstruction, priors: Mapping[int, float]) -> tuple[float, ...]:
    """The unlikely ones of the focal lengths in px, sorted; ``priors`` are those in px by camera id.

    Without a prior, a focal length is compared with those of usual lenses.
    """
    cameras = {image.camera_id for image in model.images.values() if image.has_pose}
    return tuple(
        sorted(focal for focal in (_unlikely(model.cameras[i], priors.get(i)) for i in cameras) if focal)
    )


def _unlikely(camera: pycolmap.Camera, prior: float | None) -> float | None:
    """The camera's focal length when it is unlikely."""
    focal = float(camera.mean_focal_length())
    least, most = (
        (share * max(camera.width, camera.height) for share in PRIORS.focal_shares)
        if prior is None
        else (prior / PRIORS.max_focal_change, prior * PRIORS.max_focal_change)
    )
    return None if least <= focal <= most else focal
