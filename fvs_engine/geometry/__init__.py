"""Cameras, rotations, transforms and alignment, in float64 numpy."""

from fvs_engine.geometry.alignment import AlignmentReport, alignment_report, robust_umeyama, umeyama
from fvs_engine.geometry.cameras import CAMERA_MODELS, Camera, DistortedCamera, PinholeCamera
from fvs_engine.geometry.transforms import RigidTransform, SimilarityTransform

__all__ = [
    "CAMERA_MODELS",
    "AlignmentReport",
    "Camera",
    "DistortedCamera",
    "PinholeCamera",
    "RigidTransform",
    "SimilarityTransform",
    "alignment_report",
    "robust_umeyama",
    "umeyama",
]
