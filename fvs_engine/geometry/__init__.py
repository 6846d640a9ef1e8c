"""Cameras, rotations, transforms and alignment, in float64 numpy."""

from fvs_engine.geometry.cameras import PinholeCamera
from fvs_engine.geometry.transforms import RigidTransform, SimilarityTransform

__all__ = ["PinholeCamera", "RigidTransform", "SimilarityTransform"]
