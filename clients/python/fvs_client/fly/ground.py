"""The ground under a survey, seen from home."""

from collections.abc import Iterator

from fvs_client.fly.errors import VehicleError
from fvs_schema.fence import Place
from fvs_schema.terrain import Terrain


class Ground:
    """Heights of the ground above ``home``; raises ``VehicleError`` where the terrain has none.

    They are differences, in which errors of the terrain's datum, and of the vehicle's altitude, cancel.
    """

    def __init__(self, terrain: Terrain, home: Place) -> None:
        self._terrain, self._home_m = terrain, 0.0
        self._home_m = self.height_m(home)

    def height_m(self, place: Place) -> float:
        """The height of the ground above home."""
        height_m = self._terrain.height_m(place)
        if height_m is None:
            raise VehicleError(
                f"The height model has no height at {described(place)}.",
                hint="Give one that covers home and the survey, without holes there.",
            )
        return height_m - self._home_m

    def over(self, start: Place, end: Place, heights_m: tuple[float, float]) -> Iterator[tuple[float, Place]]:
        """Heights above the ground on a straight way between two ``heights_m`` above home, and where."""
        for share, place in self._terrain.along(start, end):
            yield heights_m[0] + share * (heights_m[1] - heights_m[0]) - self.height_m(place), place


def described(place: Place) -> str:
    """A latitude and longitude in a message."""
    return f"{place[0]:.6f}, {place[1]:.6f}"
