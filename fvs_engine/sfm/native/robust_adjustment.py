"""Bundle adjustment of a whole model: robust to wrong matches, and with the lens that photographs have.

COLMAP's mappers minimise squared reprojection errors and remove what is more than 4 px off. Wrong matches
that are 2 px off stay, and so does a principal point in the middle of the image. Where only two images join
two parts of a scene, both bend it by several percent (ADR 45).
"""

from collections import Counter

import numpy as np
import pycolmap

MIN_IMAGES_OF_LENS = 10
"""Number of images of a camera from which its principal point and second radial coefficient are estimated."""

_CAUCHY = 2.385
"""Scale of Cauchy's loss in standard deviations, for 95 % of the efficiency of least squares."""

_MEDIAN_LENGTH = 1.177
"""Median length of a normal vector in the plane, in standard deviations of its coordinates."""

_MIN_SIGMA_PX = 0.2
"""Minimum standard deviation of reprojection errors that is assumed."""

_TOLERANCE, _ITERATIONS = 1e-5, 50
"""Relative change of the cost at which the adjustment ends, and the maximum number of its iterations."""


class RobustAdjustment:
    """Options and configuration of a robust bundle adjustment of all images of ``model``.

    Without ``refine`` intrinsics do not change. With ``lens``, cameras of ten images or more become
    ``RADIAL`` ones, whose principal point is estimated, too; the others keep their intrinsics then.
    ``sigma_px`` is the standard deviation of the reprojection errors before the adjustment.
    """

    def __init__(self, model: pycolmap.Reconstruction, *, refine: bool, lens: bool, threads: int) -> None:
        self.model = model
        self.config = pycolmap.BundleAdjustmentConfig()
        images: Counter[int] = Counter()
        for image_id in model.reg_image_ids():
            self.config.add_image(image_id)
            images[model.image(image_id).camera_id] += 1
        many = {camera for camera, count in images.items() if count >= MIN_IMAGES_OF_LENS}
        whole = refine and lens and bool(many)
        if whole:
            for camera_id in images.keys() - many:
                self.config.set_constant_cam_intrinsics(camera_id)
            for camera_id in many:
                _make_radial(model.camera(camera_id))
        self.sigma_px = max(_error_sigma_px(model), _MIN_SIGMA_PX)
        self.options = pycolmap.BundleAdjustmentOptions()
        self.options.print_summary = False
        self.options.refine_focal_length = self.options.refine_extra_params = refine
        self.options.refine_principal_point = whole
        self.options.ceres.loss_function_type = pycolmap.LossFunctionType.CAUCHY
        self.options.ceres.loss_function_scale = _CAUCHY * self.sigma_px
        self.options.ceres.solver_options.function_tolerance = _TOLERANCE
        self.options.ceres.solver_options.max_num_iterations = _ITERATIONS
        self.options.ceres.solver_options.num_threads = threads

    def solve(self) -> None:
        """Adjust cameras and points."""
        self.config.fix_gauge(pycolmap.BundleAdjustmentGauge.TWO_CAMS_FROM_WORLD)
        pycolmap.create_default_bundle_adjuster(self.options, self.config, self.model).solve()
        self.model.update_point_3d_errors()


def remove_outliers(model: pycolmap.Reconstruction) -> None:
    """Remove observations with large errors and points seen from one direction, as COLMAP's mappers do.

    Not for a model that an ``IncrementalMapper`` has begun: that one counts its observations.
    """
    limits = pycolmap.IncrementalMapperOptions()
    pycolmap.ObservationManager(model).filter_all_points3D(
        limits.filter_max_reproj_error, limits.filter_min_tri_angle
    )
    model.update_point_3d_errors()


def _make_radial(camera: pycolmap.Camera) -> None:
    if camera.model_name == "SIMPLE_RADIAL":
        camera.model = pycolmap.CameraModelId.RADIAL
        camera.params = [*camera.params, 0.0]


def _error_sigma_px(model: pycolmap.Reconstruction) -> float:
    """Standard deviation of each coordinate of the reprojection errors, from their median length."""
    model.update_point_3d_errors()
    errors = [point.error for point in model.points3D.values()]
    return float(np.median(errors)) / _MEDIAN_LENGTH if errors else _MIN_SIGMA_PX
