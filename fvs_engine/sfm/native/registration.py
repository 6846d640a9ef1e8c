"""The native job that registers images in an existing model."""

from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pycolmap

from fvs_engine.errors import InvalidInputError
from fvs_engine.geometry import RigidTransform
from fvs_engine.geometry.alignment.cameras import align_poses
from fvs_engine.sfm.colmap.model import camera_poses, move
from fvs_engine.sfm.jobs import RegisterImages, Registration, Report
from fvs_engine.sfm.native.mapper_options import mapper_options
from fvs_engine.sfm.native.match_cache import load_all, load_around, set_cameras
from fvs_engine.sfm.native.points_of_others import Rays
from fvs_engine.sfm.native.pose_check import PoseCheck
from fvs_engine.sfm.native.pose_review import PoseReview
from fvs_engine.sfm.native.pose_uncertainty import position_share, why_uncertain
from fvs_engine.sfm.native.prior_adjustment import adjust_with_priors
from fvs_engine.sfm.native.prior_pose import expected_poses
from fvs_engine.sfm.native.robust_adjustment import (
    RobustAdjustment,
    error_sigma_px,
    estimated_lenses,
    is_likely,
    use_robust_loss,
)
from fvs_engine.sfm.native.thresholds import POSES
from fvs_engine.sfm.pose_priors import PosePriors
from fvs_engine.sfm.verification.prior_frame import believed_frame
from fvs_schema.findings import Finding


@dataclass(frozen=True)
class Adjustments:
    """When global bundle adjustment is due: how much the model grew since the last one."""

    every: float
    images: int
    points: int

    def due(self, model: pycolmap.Reconstruction) -> bool:
        """Whether images or points grew by the share ``every``."""
        grown = 1.0 + self.every
        return bool(
            model.num_reg_images() >= grown * self.images or model.num_points3D() >= grown * self.points
        )


def register(request: RegisterImages, report: Report) -> Registration:
    """See ``RegisterImages``."""
    pycolmap.set_random_seed(request.seed)
    model, names = pycolmap.Reconstruction(request.model_dir), request.names
    old_points = set(model.point3D_ids())
    growth = Growth.begin(model, request)
    adjustments = Adjustments(request.adjust_every, request.adjusted_images, request.adjusted_points)
    for number in growth.register(names):
        report(number)
        if adjustments.due(model):
            growth.adjust_all()
            adjustments = Adjustments(request.adjust_every, model.num_reg_images(), model.num_points3D())
    growth.review_new()
    growth.mapper.end_reconstruction(False)
    growth.check_new()
    posed = {image.name: image.image_id for image in model.images.values() if image.has_pose}
    registered = [name for name in growth.registered if name in posed]
    color_points(model, request.image_dir, old_points, {posed[name] for name in registered})
    model.update_point_3d_errors()
    model.write_binary(request.out_dir)
    loose = growth.check.loosely_linked(model) if registered else frozenset()
    return Registration(
        registered=registered,
        loose=[name for name in registered if name in loose],
        unscaled=growth.check.unscaled(model, registered) if registered else (),
        conflicting=growth.check.conflicting(model, registered),
        posed=sorted(posed),
        rejected=growth.rejected,
        adjusted_images=min(adjustments.images, model.num_reg_images()),
        adjusted_points=adjustments.points,
        match_support=growth.match_support() if growth.adjusted else None,
    )


class Growth:
    """COLMAP's incremental mapper on an existing model, to which images of a ``request`` are added.

    ``cache`` has the matches around the new images, which suffices until all are adjusted.
    """

    def __init__(
        self,
        model: pycolmap.Reconstruction,
        request: RegisterImages,
        cache: pycolmap.DatabaseCache,
        check: PoseCheck,
    ) -> None:
        self.model = model
        self._database = request.database
        self._names = {image.name for image in model.images.values()} | set(request.names)
        self._lens = request.lens
        self.registered: list[str] = []
        self.rejected: dict[str, Finding] = {}
        self.check = check
        self.adjusted = False
        """Whether global bundle adjustment has run."""
        self._rejections: Counter[str] = Counter()
        self._rejected_now: set[str] = set()
        self._cache = cache
        self._options = options = mapper_options(request)
        options.triangulation.ignore_two_view_tracks = not request.two_view_points
        self.mapper = self._begin()
        # The intrinsics of a known camera do not change for one more image; those of a new camera do.
        self._local = options.get_mapper()
        self._local.constant_cameras = {image.camera_id for image in model.images.values() if image.has_pose}

    @staticmethod
    def begin(model: pycolmap.Reconstruction, request: RegisterImages) -> "Growth":
        """The growth by the images of a request, with the matches around them."""
        names = {image.name for image in model.images.values()} | set(request.names)
        cache = load_around(request.database, names, request.names, model)
        check = PoseCheck.read(
            request.database, request.min_image_support, request.priors, around=request.names
        )
        return Growth(model, request, cache, check)

    def match_support(self) -> float | None:
        """Share of all verified matches that the model explains; None without matches."""
        return PoseCheck.read(self._database, self.check.min_image_support, PosePriors()).match_support(
            self.model
        )

    def register(self, names: Sequence[str]) -> Iterator[int]:
        """Register as many as possible, in COLMAP's order; yields their number after each one."""
        while self._register_next(set(names)):
            yield len(self.registered)

    def _register_next(self, names: set[str]) -> bool:
        for structure_less in (False, True):
            for image_id in self.mapper.find_next_images(self._local, structure_less):
                name = self.model.image(image_id).name
                if (
                    name not in names
                    or name in self._rejected_now
                    or self._rejections[name] >= POSES.max_rejections
                ):
                    continue
                if self._register_one(image_id, structure_less):
                    self._rejected_now.clear()  # the model has grown: their poses may be better now
                    return True
        return False

    def review_new(self) -> None:
        """Review the poses of the new images and of those that match them; adjust all if one changed.

        The new images may show which pose of an older one is right.
        """
        before = camera_poses(self.model)
        new = {image.image_id for image in self.model.images.values() if image.name in self.registered}
        pairs = ((pair.first, pair.second) for pair in self.check.pairs)
        near = new.union(*(pair for pair in pairs if not new.isdisjoint(pair)))
        if self._review(before, near):
            self._adjust_robustly(before)
            self.adjusted = True

    def adjust_all(self) -> None:
        """Adjust all cameras and points, also to priors, and align the result with the model before.

        Poses that hang on few points are reviewed first.
        """
        if not self.adjusted:
            self.mapper.end_reconstruction(False)
            self._cache = load_all(self._database, self._names, self.model)
            self.mapper = self._begin()
            self.adjusted = True
        before = camera_poses(self.model)
        self._review(before, self.model.reg_image_ids())
        options = self._options
        adjustment = options.get_global_bundle_adjustment()
        # Squared errors would move a reviewed pose back to the old minimum.
        use_robust_loss(adjustment, error_sigma_px(self.model))
        lenses = estimated_lenses(self.model) if self._lens else {}
        self.mapper.iterative_global_refinement(
            options.ba_global_max_refinements,
            options.ba_global_max_refinement_change,
            options.get_mapper(),
            adjustment,
            options.get_triangulation(),
            False,
        )
        for camera_id, params in lenses.items():
            if not is_likely(self.model.camera(camera_id)):
                self.model.camera(camera_id).params = params
        self._adjust_robustly(before)

    def _review(self, poses: Mapping[str, RigidTransform], image_ids: Collection[int]) -> list[str]:
        """Review the poses of these images, see ``PoseReview.of``; ``poses`` are those of the model."""
        priors = self.check.priors
        review = PoseReview(
            self.model,
            self.mapper.observation_manager,
            self._database,
            self._options.random_seed,
            lambda names: expected_poses(names, priors, believed_frame(priors, poses)),
            lambda image_id: self.check.contradiction(self.model, image_id) is not None,
        )
        return review.of(image_ids)

    def _adjust_robustly(self, before: Mapping[str, RigidTransform]) -> None:
        """Adjust all cameras and points, also to priors, and align them with the poses ``before``."""
        options = self._options
        adjustment = RobustAdjustment(
            self.model,
            refine=options.ba_refine_focal_length,
            lens=self._lens,
            threads=options.num_threads,
        )
        if not adjust_with_priors(adjustment, self.check.priors, options.random_seed):
            adjustment.solve()
        set_cameras(self._cache, self.model)  # the next mapper begins with them
        self.mapper.filter_points(options.get_mapper())
        self.mapper.filter_frames(options.get_mapper())
        try:
            move(self.model, align_poses(camera_poses(self.model), before).transform)
        except InvalidInputError:  # all centres coincide: the adjustment itself keeps the frame
            return

    def _register_one(self, image_id: int, structure_less: bool) -> bool:
        """Register one image and triangulate its points, unless the check rejects its pose."""
        image = self.model.image(image_id)
        camera = self.model.camera(image.camera_id)
        params = list(camera.params)
        find = (
            self.mapper.register_next_structure_less_image
            if structure_less
            else self.mapper.register_next_image
        )
        if not find(self._local, image_id):
            return False
        contradiction = self.check.contradiction(self.model, image_id)
        if contradiction is not None:
            self._reject(image, contradiction)
            camera.params = params
            self.mapper.end_reconstruction(False)  # the old mapper still counts the image; a new one does not
            self.mapper = self._begin()
            return False
        triangulation = self._options.get_triangulation()
        self.mapper.triangulate_image(triangulation, image_id)
        self.mapper.iterative_local_refinement(
            self._options.ba_local_max_refinements,
            self._options.ba_local_max_refinement_change,
            self._local,
            self._options.get_local_bundle_adjustment(),
            triangulation,
            image_id,
        )
        self.rejected.pop(image.name, None)
        self.registered.append(image.name)
        return True

    def check_new(self) -> None:
        """Reject new poses that something contradicts after all adjustments, and uncertain ones."""
        for image in self._new_images():
            contradiction = self.check.contradiction(self.model, image.image_id)
            if contradiction is not None:
                self._reject(image, contradiction)
        rays, shares = Rays(self.model), dict[str, float]()
        while True:
            # The least certain first: others may hang on its points, and have too few without them.
            images = {image.name: image for image in self._new_images()}
            found = {name: position_share(self.model, image, rays) for name, image in images.items()}
            judged = {name: share for name, share in found.items() if share is not None}
            shares = {name: judged.get(name, np.inf) for name in images if name in judged or name in shares}
            worst = max(shares, key=lambda name: shares[name], default=None)
            if worst is None or shares[worst] <= POSES.max_position_share:
                return
            self._reject(images[worst], why_uncertain(worst, shares[worst]))

    def _new_images(self) -> list[pycolmap.Image]:
        """The images registered by this job that still have a pose."""
        images = (self.model.find_image_with_name(name) for name in self.registered)
        return [image for image in images if image is not None and image.has_pose]

    def _reject(self, image: pycolmap.Image, reason: Finding) -> None:
        self.rejected[image.name] = reason
        self._rejections[image.name] += 1
        self._rejected_now.add(image.name)
        self.model.deregister_frame(image.frame_id)

    def _begin(self) -> pycolmap.IncrementalMapper:
        mapper = pycolmap.IncrementalMapper(self._cache)
        mapper.begin_reconstruction(self.model)
        return mapper


def color_points(
    model: pycolmap.Reconstruction, image_dir: Path, old_points: Collection[int], new: Collection[int]
) -> None:
    """Colour points other than ``old_points``, each from a ``new`` image that shows it, else from the first.

    Reading an image takes 30 ms, and nearly all new points are in new images.
    """
    images = set()
    for point_id in model.point3D_ids():
        if point_id not in old_points:
            track = [element.image_id for element in model.point3D(point_id).track.elements]
            images.add(next((image_id for image_id in track if image_id in new), track[0]))
    for image_id in sorted(images):
        model.extract_colors_for_image(image_id, image_dir)
