"""Where a scene's model stands in its world, by what its images told of where they were taken."""

from collections.abc import Mapping

import numpy as np

from fvs_engine.geometry import RigidTransform, quaternion_from_matrix
from fvs_engine.geometry.alignment.world import georeference
from fvs_engine.geometry.geodetic import GeodeticPosition, camera_at, enu_from_geodetic
from fvs_service.images.model import Image, Prior
from fvs_service.scenes.model import Alignment, AlignmentStatus, Origin, Scene
from fvs_service.scenes.poses import place_of


def align(
    scene: Scene, images: Mapping[str, Image], model_from_camera: Mapping[str, RigidTransform]
) -> Alignment:
    """Align the registered cameras (digest → model_from_camera) with the priors of their images.

    Too few positions, or positions that fix nothing, leave the model's frame as the world.
    """
    known = [
        (camera, position, _attitude(image.prior))
        for digest, camera in model_from_camera.items()
        if (image := images.get(digest)) is not None
        and image.prior is not None
        and (position := place_told(image.prior, scene.origin)) is not None
    ]
    if not known:
        return Alignment()
    found = georeference(
        [camera for camera, _, _ in known],
        np.stack([position for _, position, _ in known]),
        [attitude for _, _, attitude in known],
    )
    if found is None:
        return Alignment(positions=len(known))
    similarity = found.world_from_model
    return Alignment(
        status=AlignmentStatus.ILL_CONDITIONED if found.ill_conditioned else AlignmentStatus.ALIGNED,
        scale=similarity.scale,
        rotation_wxyz=tuple(quaternion_from_matrix(similarity.rotation).tolist()),
        translation=tuple(similarity.translation.tolist()),
        rms_m=found.rms,
        inliers=found.inliers,
        positions=len(known),
    )


def place_told(prior: Prior, origin: Origin | None) -> np.ndarray | None:
    """The place [3] in the scene's world that a prior tells, None when it tells none that fits there."""
    if prior.x_m is not None and prior.y_m is not None and prior.z_m is not None:
        return np.array([prior.x_m, prior.y_m, prior.z_m])
    if (
        prior.latitude_deg is None
        or prior.longitude_deg is None
        or prior.altitude_m is None
        or origin is None
        or prior.altitude_datum is not origin.altitude_datum
    ):
        return None
    place = GeodeticPosition(prior.latitude_deg, prior.longitude_deg, prior.altitude_m)
    return enu_from_geodetic(place, place_of(origin))


def _attitude(prior: Prior | None) -> np.ndarray | None:
    if prior is None or prior.yaw_deg is None or prior.pitch_deg is None:
        return None
    return camera_at(np.zeros(3), prior.yaw_deg, prior.pitch_deg, prior.roll_deg or 0.0).rotation
