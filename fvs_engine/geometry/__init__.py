"""Cameras, rotations, transforms and alignment, in float64 numpy."""

from fvs_engine.geometry.alignment.similarity import (
    AlignmentReport,
    alignment_report,
    robust_umeyama,
    umeyama,
)
from fvs_engine.geometry.cameras import CAMERA_MODELS, Camera, DistortedCamera, PinholeCamera
from fvs_engine.geometry.look_at import OPENGL_FROM_OPENCV, level_axes, look_at, look_at_from_each
from fvs_engine.geometry.paths import halfway_between_neighbours, smooth_path
from fvs_engine.geometry.rotations import angle_between, matrix_from_quaternion, quaternion_from_matrix
from fvs_engine.geometry.transforms import RigidTransform, SimilarityTransform

__all__ = [
    "CAMERA_MODELS",
    "OPENGL_FROM_OPENCV",
    "AlignmentReport",
    "Camera",
    "DistortedCamera",
    "PinholeCamera",
    "RigidTransform",
    "SimilarityTransform",
    "alignment_report",
    "angle_between",
    "halfway_between_neighbours",
    "level_axes",
    "look_at",
    "look_at_from_each",
    "matrix_from_quaternion",
    "quaternion_from_matrix",
    "robust_umeyama",
    "smooth_path",
    "umeyama",
]
