"""Height models for a client: their errors are the client's."""

import math
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from os import PathLike

from fvs_client.errors import FvsError
from fvs_schema import height_model
from fvs_schema.error_codes import ErrorCode
from fvs_schema.fence import Place
from fvs_schema.poses import FramePose, VehiclePose
from fvs_schema.scenes import Origin
from fvs_schema.terrain import Terrain

_DEGREE_M = 111_195.0


class HeightModelError(FvsError):
    """A file is no height model, or has no heights where they are needed."""

    code = ErrorCode.USAGE


class HeightModel(height_model.HeightModel):
    """A height model in a file that GDAL reads, in any CRS; to be closed, or used in a ``with``.

    Its heights are above sea level, or above the ellipsoid where its CRS is geographic in three dimensions.
    Raises ``HeightModelError`` for a file that is none, and without rasterio.
    """

    def __init__(self, path: str | PathLike[str]) -> None:
        with _errors():
            super().__init__(path)

    def around(self, places: Iterable[Place], margin_m: float = 0.0) -> Terrain:
        """The heights at places and ``margin_m`` around them, as fine as the file or a terrain can have them.

        Raises ``HeightModelError`` where the file has no height anywhere around them.
        """
        with _errors():
            return super().around(places, margin_m)


def places_of(poses: Iterable[FramePose | VehiclePose], origin: Origin | None) -> list[Place]:
    """Latitudes and longitudes of poses in a scene with this origin, to a metre in a kilometre.

    Raises ``HeightModelError`` for poses of which it is not known where on Earth they are.
    """
    places = []
    for pose in poses:
        if isinstance(pose, VehiclePose):
            places.append((pose.latitude_deg, pose.longitude_deg))
        elif origin is not None and pose.frame == "world":
            east_m, north_m, _ = pose.position
            around_m = _DEGREE_M * math.cos(math.radians(origin.latitude_deg))
            longitude_deg = origin.longitude_deg + east_m / around_m
            places.append(
                (origin.latitude_deg + north_m / _DEGREE_M, (longitude_deg + 180.0) % 360.0 - 180.0)
            )
        else:
            raise HeightModelError(
                "A terrain needs views with latitude and longitude, or in the world frame of a georeferenced "
                "scene.",
                hint="Leave the terrain out, or give geodetic poses.",
            )
    return places


@contextmanager
def _errors() -> Iterator[None]:
    try:
        yield
    except height_model.HeightModelError as error:
        raise HeightModelError(error.message, hint=error.hint) from error
