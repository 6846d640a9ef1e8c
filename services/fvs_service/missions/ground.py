"""The ground under a flight: a terrain, at the altitudes of a scene."""

from collections.abc import Iterator, Sequence
from itertools import pairwise

from fvs_schema.error_codes import FieldError
from fvs_schema.fence import Place
from fvs_schema.missions import MissionOptions
from fvs_schema.scenes import AltitudeDatum
from fvs_schema.terrain import Terrain
from fvs_service.errors import InvalidRequestError
from fvs_service.missions.altitudes import Altitudes
from fvs_service.missions.flight import Waypoint


class Ground:
    """Altitudes of the ground, above the scene's datum; home, at ``home_m``, is on it.

    They are counted from home: the altitudes of photographs and those of a terrain often differ by metres,
    by the same everywhere in a scene.
    """

    def __init__(
        self, terrain: Terrain, options: MissionOptions, datum: AltitudeDatum, home_m: float | None
    ) -> None:
        """Raise ``InvalidRequestError`` without a home that the terrain covers, or without its altitude.

        That is ``home_m``, or else the terrain's, where it can be converted to the scene's ``datum``.
        """
        if options.home is None:
            raise InvalidRequestError(
                "With a terrain, home must be known.",
                hint="Give home_latitude_deg and home_longitude_deg, where the vehicle takes off.",
                errors=[FieldError("home_latitude_deg", "it is missing")],
            )
        at_home_m = terrain.height_m(options.home)
        if at_home_m is None:
            raise InvalidRequestError(
                f"The terrain has no height at home, {described(options.home)}.",
                hint="Give a terrain that covers home and the views, without holes there.",
                errors=[FieldError("terrain", "it has no height at home")],
            )
        home_m = Altitudes.of(datum, home_m, None).home_m
        if home_m is None:
            offset_m = Altitudes(terrain.altitude_datum, None, options.geoid_height_m).offset(datum)
            if offset_m is None:
                raise InvalidRequestError(
                    f"Heights of the terrain are above {terrain.altitude_datum.in_words}, "
                    f"the scene's altitudes above {datum.in_words}.",
                    hint="Give home_altitude_m, above the datum of the scene's altitudes, or geoid_height_m.",
                    errors=[FieldError("home_altitude_m", "it is missing")],
                )
            home_m = at_home_m + offset_m
        self._terrain, self._offset_m = terrain, home_m - at_home_m
        self.home_m = home_m

    def altitude_m(self, place: Place) -> float | None:
        """The altitude of the ground; None where the terrain has no height."""
        height_m = self._terrain.height_m(place)
        return None if height_m is None else height_m + self._offset_m

    def highest_m(self, places: Sequence[Place]) -> float:
        """The altitude of the highest ground on the straight ways from place to place.

        It looks no farther than to where the terrain has no height, which ``heights_over`` reports.
        """
        highest_m = float("-inf")
        for place in self._along(places):
            ground_m = self.altitude_m(place)
            if ground_m is None:
                break
            highest_m = max(highest_m, ground_m)
        return highest_m

    def heights_over(self, way: Sequence[Waypoint]) -> Iterator[tuple[float | None, Place]]:
        """The heights above the ground on a straight way through waypoints, and where that is.

        The last one is None where the terrain has no height.
        """
        for start, end in pairwise(way):
            for share, place in self._terrain.along(start.place, end.place):
                ground_m = self.altitude_m(place)
                if ground_m is None:
                    yield None, place
                    return
                yield start.altitude_m + share * (end.altitude_m - start.altitude_m) - ground_m, place

    def _along(self, places: Sequence[Place]) -> Iterator[Place]:
        if len(places) == 1:
            yield places[0]
        for start, end in pairwise(places):
            yield from (place for _, place in self._terrain.along(start, end))


def described(place: Place) -> str:
    """A latitude and longitude in a message, to a decimetre."""
    return f"{place[0]:.6f}, {place[1]:.6f}"
