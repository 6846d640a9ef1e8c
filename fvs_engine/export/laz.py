"""Sparse points as LAZ: LAS 1.4 with the CRS and heights of a placement, to a millimetre."""

from pathlib import Path

import laspy
import numpy as np
from laspy.vlrs.known import WktCoordinateSystemVlr

from fvs_engine.export.crs import ProjectedCrs
from fvs_engine.export.placement import Placement
from fvs_engine.files.atomic import replacing
from fvs_engine.sfm.reconstruction import PointCloud

_STEP_M = 0.001
_POINT_FORMAT = 7
"""Colours; its CRS is WKT."""
_COLOR_STEPS = 257
"""16 bits per step of 8 bits."""


def write_laz(path: Path, points: PointCloud, placement: Placement, crs: ProjectedCrs) -> None:
    """Write points of the model frame in ``crs``, with altitudes above the origin's datum.

    Coordinates are whole millimetres from an offset in the header. Raises ``StorageError`` when the file
    cannot be written.
    """
    in_world = placement.world_from_model.apply(points.xyz)
    coordinates = crs.coordinates(placement.geodetic(in_world))
    header = laspy.LasHeader(version="1.4", point_format=_POINT_FORMAT)
    header.scales = np.full(3, _STEP_M)
    header.offsets = np.floor(coordinates.mean(axis=0)) if len(points) else np.zeros(3)
    header.vlrs.append(WktCoordinateSystemVlr(crs.wkt(placement.origin.altitude_datum)))
    header.global_encoding.wkt = True
    header.generating_software = "fvs"
    cloud = laspy.LasData(header)
    cloud.x, cloud.y, cloud.z = coordinates.T
    cloud.red, cloud.green, cloud.blue = points.colors.astype(np.uint16).T * _COLOR_STEPS
    with replacing(path) as temporary, temporary.open("wb") as file:
        cloud.write(file, do_compress=True, laz_backend=laspy.LazBackend.Lazrs)
