"""Sparse points as PLY, which viewers of point clouds read: x y z in float32, red green blue in 8 bits."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from plyfile import PlyData, PlyElement

from fvs_engine.files.atomic import replacing
from fvs_engine.sfm.reconstruction import PointCloud

_XYZ, _RGB = ("x", "y", "z"), ("red", "green", "blue")
_VERTEX = np.dtype([*((name, "<f4") for name in _XYZ), *((name, "u1") for name in _RGB)])


def write_points(path: Path, points: PointCloud) -> None:
    """Write points in the frame that they have; raises ``StorageError`` when the file cannot be written."""
    vertices = np.empty(len(points), _VERTEX)
    for columns, names in ((points.xyz, _XYZ), (points.colors, _RGB)):
        for number, name in enumerate(names):
            vertices[name] = columns[:, number]
    with replacing(path) as temporary:
        PlyData([PlyElement.describe(vertices, "vertex")], byte_order="<").write(str(temporary))


def read_positions(path: Path) -> NDArray[np.float64]:
    """The positions [P, 3] of points that ``write_points`` wrote."""
    vertices = PlyData.read(str(path))["vertex"].data
    return np.stack([np.asarray(vertices[name], np.float64) for name in _XYZ], axis=1)
