"""The native jobs that localise images in a model without changing it."""

from dataclasses import dataclass

import numpy as np
import pycolmap

from fvs_engine.sfm.colmap.database import VerifiedPair, image_ids, read_keypoints, read_verified_pairs
from fvs_engine.sfm.colmap.model import rigid_from_pycolmap, rigid_to_pycolmap
from fvs_engine.sfm.jobs import CopyFeatures, Localisation, LocalisedImage, LocaliseImages, Report
from fvs_engine.sfm.native.known_points import points_seen
from fvs_engine.sfm.native.pose_check import PoseCheck
from fvs_engine.sfm.native.pose_search import best_pose
from fvs_engine.sfm.native.prior_pose import PoseProblem
from fvs_engine.sfm.native.robust_adjustment import error_sigma_px
from fvs_engine.sfm.native.thresholds import POSES
from fvs_engine.sfm.verification.pair_check import MIN_PAIR_MATCHES


def copy_features(request: CopyFeatures, _report: Report) -> None:
    """See ``CopyFeatures``; keypoints come last: an image that has them is complete, also after a kill."""
    numbers = image_ids(request.source), image_ids(request.target)
    with (
        pycolmap.Database.open(request.source) as read,
        pycolmap.Database.open(request.target) as written,
    ):
        for name in request.names:
            old, new = numbers[0][name], numbers[1][name]
            if not written.exists_descriptors(new):
                written.write_descriptors(new, read.read_descriptors(old))
            if not written.exists_keypoints(new):
                written.write_keypoints(new, read.read_keypoints(old))


def localise(request: LocaliseImages, report: Report) -> Localisation:
    """See ``LocaliseImages``."""
    database, neighbours = request.database, request.neighbours
    model = pycolmap.Reconstruction(request.model_dir)
    ids = image_ids(database)
    names = {image_id: name for name, image_id in ids.items()}
    wanted = {frozenset((ids[name], ids[other])) for name in neighbours for other in neighbours[name]}
    pairs = [
        pair
        for pair in read_verified_pairs(database, MIN_PAIR_MATCHES)
        if frozenset((pair.first, pair.second)) in wanted
    ]
    keypoints = read_keypoints(database, {i for pair in pairs for i in (pair.first, pair.second)})
    in_model = {image.name: image_id for image_id, image in model.images.items()}
    # The database has image ids of its own; they are relocalised by those of the model.
    number = {i: in_model[names[i]] for i in keypoints if names[i] in in_model}
    guests = {name: max(in_model.values()) + 1 + k for k, name in enumerate(sorted(neighbours))}
    number |= {ids[name]: guest for name, guest in guests.items()}
    translated = [VerifiedPair(number[pair.first], number[pair.second], pair.matches) for pair in pairs]
    features = {number[i]: xy for i, xy in keypoints.items()}
    cameras = {}
    with pycolmap.Database.open(database) as opened:
        for name in neighbours:
            cameras[name] = opened.read_camera(opened.read_image(ids[name]).camera_id)
    check = PoseCheck(translated, features, request.min_image_support, request.priors)
    search = _Search(model, check, max(error_sigma_px(model), POSES.min_sigma_px), request.seed)
    localised: dict[str, LocalisedImage] = {}
    for done, (name, guest) in enumerate(guests.items(), start=1):
        sibling = request.siblings.get(name)
        known = None if sibling is None else model.image(in_model[sibling]).camera
        found = search.add(pycolmap.Image(name=name, image_id=guest), cameras[name], known)
        if found and check.contradiction(model, guest) is None:
            image = model.image(guest)
            camera = model.camera(image.camera_id)
            localised[name] = LocalisedImage(
                model=camera.model_name,
                width=camera.width,
                height=camera.height,
                params=tuple(camera.params),
                camera_from_model=image.cam_from_world().matrix().tolist(),
            )
        if found:
            model.deregister_frame(model.image(guest).frame_id)
        report(done)
    return Localisation(images=localised)


@dataclass(frozen=True, eq=False)
class _Search:
    """Search for the poses of images by their matches with points of ``model``, which are those of ``check``.

    ``sigma_px`` is the standard deviation of right matches.
    """

    model: pycolmap.Reconstruction
    check: PoseCheck
    sigma_px: float
    seed: int

    def add(self, image: pycolmap.Image, camera: pycolmap.Camera, sibling: pycolmap.Camera | None) -> bool:
        """Add an image to the model with the pose that its matches give; returns whether they give one.

        ``sibling`` is the camera in the model that took the image, if any; else it is ``camera``, whose
        focal length is estimated.
        """
        model, guest = self.model, image.image_id
        own = [pair for pair in self.check.pairs if guest in (pair.first, pair.second)]
        seen = points_seen(model, guest, own)
        if len(seen) < POSES.min_points:
            return False
        if sibling is None:
            camera = pycolmap.Camera(camera.todict() | {"camera_id": max(model.cameras) + 1})
        else:
            camera = sibling
        mapper = pycolmap.IncrementalMapperOptions()
        estimation = pycolmap.AbsolutePoseEstimationOptions()
        estimation.estimate_focal_length = sibling is None and not camera.has_prior_focal_length
        estimation.ransac.max_error = mapper.abs_pose_max_error
        estimation.ransac.min_inlier_ratio = mapper.abs_pose_min_inlier_ratio
        estimation.ransac.random_seed = self.seed
        refinement = pycolmap.AbsolutePoseRefinementOptions()
        refinement.refine_focal_length = refinement.refine_extra_params = sibling is None
        pixels = np.stack([self.check.keypoints[guest][feature] for feature, _ in seen])
        points = np.stack([model.point3D(point).xyz for _, point in seen])
        answer = pycolmap.estimate_and_refine_absolute_pose(pixels, points, camera, estimation, refinement)
        if answer is None or answer["num_inliers"] < POSES.min_points:
            return False
        if sibling is None:
            model.add_camera_with_trivial_rig(camera)
        image.camera_id = camera.camera_id
        start = rigid_from_pycolmap(answer["cam_from_world"])
        pose = best_pose(start, PoseProblem(points, pixels, camera, self.sigma_px), self.seed)
        model.add_image_with_trivial_frame(image, rigid_to_pycolmap(pose))
        return True
