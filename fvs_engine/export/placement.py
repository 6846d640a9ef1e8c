"""Where a model is on Earth, and the record of it that goes beside exported files."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from fvs_engine.errors import InvalidInputError
from fvs_engine.export.crs import ProjectedCrs
from fvs_engine.geometry import (
    RigidTransform,
    SimilarityTransform,
    matrix_from_quaternion,
    quaternion_from_matrix,
)
from fvs_engine.geometry.geodetic import GeodeticPosition, ecef_from_enu, geodetic_coordinates
from fvs_engine.records import Record
from fvs_schema.scenes import Alignment, AltitudeDatum, Origin

Array = NDArray[np.float64]

_FAR_M = 1_000.0
"""Distance at which float32 still has steps of a sixteenth of a millimetre."""


@dataclass(frozen=True, eq=False)
class Placement:
    """The ``origin`` of the world frame (ENU, metres), and the model's ``alignment`` with it.

    ``geoid_height_m``: the geoid above the ellipsoid at the origin, where it is known.
    """

    origin: Origin
    alignment: Alignment
    geoid_height_m: float | None = None

    @cached_property
    def world_from_model(self) -> SimilarityTransform:
        """The similarity from the model to the world frame."""
        rotation = matrix_from_quaternion(self.alignment.rotation_wxyz)
        return SimilarityTransform(self.alignment.scale, rotation, np.array(self.alignment.translation))

    @cached_property
    def position(self) -> GeodeticPosition:
        """The origin, its altitude above its datum."""
        return GeodeticPosition(self.origin.latitude_deg, self.origin.longitude_deg, self.origin.altitude_m)

    @property
    def ecef_from_world(self) -> RigidTransform:
        """WGS 84's Earth-centred frame from the world frame, as if altitudes were above the ellipsoid."""
        return ecef_from_enu(self.position)

    def geodetic(self, positions_m: Array) -> Array:
        """Latitudes, longitudes and altitudes [N, 3] of positions in the world frame [N, 3]."""
        return geodetic_coordinates(positions_m, self.position)

    def near(self, middle_m: Array) -> "Placement":
        """The same place, with its origin in the scene.

        An origin far from the scene's middle (``middle_m`` [3], world frame) would leave float32 no
        millimetres.
        """
        if float(np.linalg.norm(middle_m)) <= _FAR_M:
            return self
        latitude, longitude, altitude = self.geodetic(middle_m[None])[0].tolist()
        new_from_old = (
            ecef_from_enu(GeodeticPosition(latitude, longitude, altitude)).inverse() @ self.ecef_from_world
        )
        turn = SimilarityTransform(1.0, new_from_old.rotation, new_from_old.translation)
        world_from_model = turn @ self.world_from_model
        origin = {"latitude_deg": latitude, "longitude_deg": longitude, "altitude_m": altitude}
        alignment = {
            "rotation_wxyz": tuple(quaternion_from_matrix(world_from_model.rotation).tolist()),
            "translation": tuple(world_from_model.translation.tolist()),
        }
        return replace(
            self,
            origin=self.origin.model_copy(update=origin),
            alignment=self.alignment.model_copy(update=alignment),
        )

    def on_ellipsoid(self, geoid_height_m: float) -> "Placement":
        """The same place, its altitudes above the ellipsoid instead of above sea level.

        Raises ``InvalidInputError`` when they are above something else.
        """
        if self.origin.altitude_datum is not AltitudeDatum.SEA_LEVEL:
            raise InvalidInputError(
                f"The scene's altitudes are above {self.origin.altitude_datum.in_words}.",
                hint="A geoid is for altitudes above sea level: leave it out.",
            )
        altitude_m = self.origin.altitude_m + geoid_height_m
        origin = self.origin.model_copy(
            update={"altitude_m": altitude_m, "altitude_datum": AltitudeDatum.ELLIPSOID}
        )
        return replace(self, origin=origin, geoid_height_m=geoid_height_m)


class CrsRecord(Record):
    """The CRS of a georeference, and the origin in it.

    To lay the world frame into the CRS: multiply by ``scale_factor``, turn by ``convergence_deg`` (grid north
    lies so far east of true north), and add ``easting_m``, ``northing_m``. ``accuracy_m``: that of the
    transformation from WGS 84; None where it is not known.
    """

    epsg: int
    name: str
    easting_m: float
    northing_m: float
    convergence_deg: float
    scale_factor: float
    accuracy_m: float | None


class GeoreferenceRecord(Record):
    """``georeference.json``: the frame of exported files, and how to place it.

    In the world frame coordinates are metres east, north and up of ``origin``; ``alignment`` is
    world_from_model, and ``ecef_from_world`` [4, 4] takes them to the Earth-centred frame of WGS 84 (EPSG
    4978). In the model frame there is nothing to say.
    """

    version: Literal[1] = 1
    frame: Literal["world"] = "world"
    origin: Origin
    geoid_height_m: float | None
    alignment: Alignment
    ecef_from_world: tuple[tuple[float, ...], ...]
    crs: CrsRecord

    @staticmethod
    def of(placement: Placement, crs: ProjectedCrs) -> "GeoreferenceRecord":
        """The record of a placement and the CRS that was chosen."""
        easting, northing, _ = crs.coordinates(placement.geodetic(np.zeros((1, 3))))[0].tolist()
        convergence_deg, scale_factor = crs.convergence_and_scale(placement.position)
        return GeoreferenceRecord(
            origin=placement.origin,
            geoid_height_m=placement.geoid_height_m,
            alignment=placement.alignment,
            ecef_from_world=tuple(map(tuple, placement.ecef_from_world.matrix.tolist())),
            crs=CrsRecord(
                epsg=crs.epsg,
                name=crs.name,
                easting_m=easting,
                northing_m=northing,
                convergence_deg=convergence_deg,
                scale_factor=scale_factor,
                accuracy_m=crs.accuracy_m(placement.position),
            ),
        )
