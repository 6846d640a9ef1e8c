"""The registered images that show most of what an image should show, by its pose prior."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from fvs_engine.geometry import Camera, RigidTransform
from fvs_engine.sfm.pose_priors import PosePriors
from fvs_engine.sfm.reconstruction import Reconstruction
from fvs_engine.sfm.verification.prior_frame import believed_frame, is_vague

Array = NDArray[np.float64]

_BY_OVERLAP = 8
"""Number of registered images, by overlap, that an image with a pose prior is matched with."""

_RAYS_DEG = 20.0
"""Angle between the rays to a point at which features match a third as often as from the same place."""

_MARGIN = 0.1
"""Margin around the frame, as a share of its size, that allows for errors of the prior."""

_MOST_POINTS = 5_000


def predicted_neighbours(
    names: Sequence[str], priors: PosePriors, current: Reconstruction
) -> dict[str, list[str]]:
    """For those of ``names`` that have a whole pose prior, the registered images that overlap them most.

    Vague priors do not count. Empty when the priors do not agree with the model.
    """
    poses = {view.name: view.camera_from_model.inverse() for view in current.views}
    frame = believed_frame(priors, poses)
    if frame is None or not frame.oriented:
        return {}
    model_from_world = frame.world_from_model.inverse()
    found = {}
    for name in names:
        prior = priors.by_name.get(name)
        world_from_camera = None if prior is None else prior.world_from_camera
        if prior is not None and world_from_camera is not None and not is_vague(prior, priors, frame):
            expected = model_from_world.move_camera(world_from_camera)
            # Most images of a scene have one camera; the prior is too coarse for the others to matter.
            found[name] = most_overlapping(expected, current.views[-1].camera, current, _BY_OVERLAP)
    return {name: others for name, others in found.items() if others}


def most_overlapping(
    model_from_camera: RigidTransform, camera: Camera, current: Reconstruction, count: int
) -> list[str]:
    """The ``count`` registered images that share most sparse points with a camera, in descending order.

    A point counts by exp(−(a / 20°)²), a the angle between the rays of the two cameras. Occlusion is ignored:
    there are no surfaces yet.
    """
    points = current.points.xyz[:: max(1, -(-len(current.points) // _MOST_POINTS))]
    seen = _in_frame(points, model_from_camera.inverse(), camera)
    points = points[seen]
    rays = _directions(points, model_from_camera.translation)
    shared = {}
    for view in current.views:
        both = _in_frame(points, view.camera_from_model, view.camera)
        cosines = (_directions(points[both], view.centre) * rays[both]).sum(axis=1)
        angles_deg = np.degrees(np.arccos(np.clip(cosines, -1.0, 1.0)))
        shared[view.name] = float(np.exp(-((angles_deg / _RAYS_DEG) ** 2)).sum())
    ordered = sorted(shared, key=lambda name: (-shared[name], name))
    return [name for name in ordered[:count] if shared[name] > 0]


def _in_frame(points: Array, camera_from_model: RigidTransform, camera: Camera) -> NDArray[np.bool_]:
    """Which points [P, 3] are in the frame, or nearly; lens distortion is ignored."""
    x, y, z = camera_from_model.apply(points).T
    depth = np.maximum(z, 1e-12)
    right, down = camera.fx * x / depth + camera.cx, camera.fy * y / depth + camera.cy
    beyond_x, beyond_y = _MARGIN * camera.width, _MARGIN * camera.height
    return np.asarray(
        (z > 0)
        & (right > -beyond_x)
        & (right < camera.width + beyond_x)
        & (down > -beyond_y)
        & (down < camera.height + beyond_y)
    )


def _directions(points: Array, centre: Array) -> Array:
    rays = points - centre
    return np.asarray(rays / np.maximum(np.linalg.norm(rays, axis=1, keepdims=True), 1e-12))
