"""Bundle adjustment of a whole model: robust to wrong matches, and with the lens that photographs have.

COLMAP's mappers minimise squared reprojection errors and remove what is more than 4 px off. Wrong matches
that are 2 px off stay, and so does a principal point in the middle of the image. Where only two images join
two parts of a scene, both bend it by several percent (docs/design/poses.md).
"""

import math
from collections import defaultdict
from collections.abc import Callable, Sequence

import numpy as np
import pycolmap
from numpy.typing import NDArray

from fvs_engine.sfm.native.thresholds import ADJUSTMENT

_LENS = "RADIAL"

MEDIAN_LENGTH = 1.177
"""Median length of a normal vector in the plane, in standard deviations of its coordinates."""


class RobustAdjustment:
    """Options and configuration of a robust bundle adjustment of all images of ``model``.

    Without ``refine`` intrinsics do not change. With ``lens``, cameras of ten images or more, which look in
    several directions, become ``RADIAL`` ones, whose principal point is estimated, too; the others keep their
    intrinsics then. So does a camera whose estimate no lens has: the images do not determine it.
    ``sigma_px`` is the standard deviation of the reprojection errors before the adjustment.
    """

    def __init__(self, model: pycolmap.Reconstruction, *, refine: bool, lens: bool, threads: int) -> None:
        self.model = model
        self.config = pycolmap.BundleAdjustmentConfig()
        directions = defaultdict(list)
        for image_id in model.reg_image_ids():
            self.config.add_image(image_id)
            image = model.image(image_id)
            directions[image.camera_id].append(image.viewing_direction())
        many = {camera_id for camera_id, found in directions.items() if _determine_a_lens(found)}
        whole = refine and lens and bool(many)
        self._before: dict[int, tuple[pycolmap.CameraModelId, list[float]]] = {}
        for camera_id in directions.keys() - many:
            if whole or (lens and camera_id in estimated_lenses(model)):
                self.config.set_constant_cam_intrinsics(camera_id)
        if whole:
            for camera_id in many:
                camera = model.camera(camera_id)
                self._before[camera_id] = camera.model, list(camera.params)
                _make_radial(camera)
        self.sigma_px = max(error_sigma_px(model), ADJUSTMENT.min_sigma_px)
        self.options = pycolmap.BundleAdjustmentOptions()
        self.options.print_summary = False
        self.options.refine_focal_length = self.options.refine_extra_params = refine
        self.options.refine_principal_point = whole
        use_robust_loss(self.options, self.sigma_px)
        self.options.ceres.solver_options.function_tolerance = ADJUSTMENT.tolerance
        self.options.ceres.solver_options.max_num_iterations = ADJUSTMENT.iterations
        self.options.ceres.solver_options.num_threads = threads

    def solve(self) -> None:
        """Adjust cameras and points."""
        self.config.fix_gauge(pycolmap.BundleAdjustmentGauge.TWO_CAMS_FROM_WORLD)
        self.run(lambda: pycolmap.create_default_bundle_adjuster(self.options, self.config, self.model))

    def run(self, adjuster: Callable[[], pycolmap.BundleAdjuster]) -> None:
        """Adjust with an ``adjuster`` of this model, by these options and this configuration."""
        start = pycolmap.Reconstruction(self.model)
        adjuster().solve()
        while unlikely := [i for i in self._before if not is_likely(self.model.camera(i))]:
            _reset(self.model, start)
            for camera_id in unlikely:
                camera = self.model.camera(camera_id)
                camera.model, camera.params = self._before.pop(camera_id)
                self.config.set_constant_cam_intrinsics(camera_id)
            adjuster().solve()
        self.model.update_point_3d_errors()


def error_sigma_px(model: pycolmap.Reconstruction) -> float:
    """Standard deviation of each coordinate of the reprojection errors, from their median length."""
    model.update_point_3d_errors()
    errors = [point.error for point in model.points3D.values()]
    return float(np.median(errors)) / MEDIAN_LENGTH if errors else ADJUSTMENT.min_sigma_px


def use_robust_loss(options: pycolmap.BundleAdjustmentOptions, sigma_px: float) -> None:
    """Have a bundle adjustment give less weight to what is far off, for errors of ``sigma_px``."""
    options.ceres.loss_function_type = pycolmap.LossFunctionType.CAUCHY
    options.ceres.loss_function_scale = ADJUSTMENT.cauchy * max(sigma_px, ADJUSTMENT.min_sigma_px)


def estimated_lenses(model: pycolmap.Reconstruction) -> dict[int, list[float]]:
    """The cameras whose lens was estimated, if ``lens`` was given: camera id → parameters."""
    return {i: list(camera.params) for i, camera in model.cameras.items() if camera.model_name == _LENS}


def is_likely(camera: pycolmap.Camera) -> bool:
    """Whether the intrinsics are within the limits of COLMAP's mapper, which removes all images of others."""
    limits = pycolmap.IncrementalMapperOptions()
    return not camera.has_bogus_params(
        limits.min_focal_length_ratio, limits.max_focal_length_ratio, limits.max_extra_param
    )


def remove_outliers(model: pycolmap.Reconstruction) -> None:
    """Remove observations with large errors and points seen from one direction, as COLMAP's mappers do.

    Not for a model that an ``IncrementalMapper`` has begun: that one counts its observations.
    """
    limits = pycolmap.IncrementalMapperOptions()
    pycolmap.ObservationManager(model).filter_all_points3D(
        limits.filter_max_reproj_error, limits.filter_min_tri_angle
    )
    model.update_point_3d_errors()


def _determine_a_lens(directions: Sequence[NDArray[np.float64]]) -> bool:
    """Whether images with these viewing directions (unit vectors) determine the lens of their camera."""
    spread = math.cos(math.radians(ADJUSTMENT.min_view_spread_deg))
    return len(directions) >= ADJUSTMENT.min_images_of_lens and bool(
        np.linalg.norm(np.mean(directions, axis=0)) < spread
    )


def _make_radial(camera: pycolmap.Camera) -> None:
    if camera.model_name == "SIMPLE_RADIAL":
        camera.model = getattr(pycolmap.CameraModelId, _LENS)
        camera.params = [*camera.params, 0.0]


def _reset(model: pycolmap.Reconstruction, start: pycolmap.Reconstruction) -> None:
    """Give ``model`` the poses, points and intrinsics of ``start``, a copy of it."""
    for camera_id, camera in start.cameras.items():
        model.camera(camera_id).params = camera.params
    for frame_id in start.reg_frame_ids():
        model.frame(frame_id).rig_from_world = start.frame(frame_id).rig_from_world
    for point_id, point in start.points3D.items():
        model.point3D(point_id).xyz = point.xyz
