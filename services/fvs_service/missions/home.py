"""The altitude of home, and what contradicts it: photographs' heights above takeoff, the model's ground.

Altitudes in photographs are often off by tens of metres. Then one from a map does not fit, and all heights
above home are as wrong.
"""

from collections.abc import Sequence

from fvs_schema.error_codes import FieldError
from fvs_schema.fence import Place
from fvs_schema.missions import MissionOptions
from fvs_schema.scenes import Alignment, AlignmentSource, AltitudeDatum
from fvs_schema.terrain import Terrain
from fvs_service.errors import InvalidRequestError

_AGREES_M = 5.0
"""Maps, barometers and sparse points are as good."""
_IN_THE_AIR_M = 10.0
"""Home is never so far above the ground of the model: sparse points have no roofs and edges."""
_STEPS = (-2, -1, 0, 1, 2)
"""Of the ground's grid, around home."""
_GIVE_TAKEOFF = "home_above_takeoff_m: 0 to take off where they did, else how much higher home is."


def given_home_m(options: MissionOptions, takeoff_m: float | None) -> float | None:
    """The altitude of home that the options give.

    Raises ``InvalidRequestError`` for one above a takeoff that is not known.
    """
    if options.home_above_takeoff_m is None:
        return options.home_altitude_m
    if takeoff_m is None:
        raise InvalidRequestError(
            "The photographs of the model do not say how high above takeoff they were taken.",
            hint="Give home_altitude_m instead, above the datum of the scene's altitudes.",
            errors=[FieldError("home_above_takeoff_m", "the takeoff is not known")],
        )
    return takeoff_m + options.home_above_takeoff_m


def require_plausible(
    options: MissionOptions, home_m: float | None, alignment: Alignment, ground: Terrain | None
) -> None:
    """Raise ``InvalidRequestError`` for a home with which a mission would not fly as high as its views are.

    ``home_m`` and the model's ``ground`` are above the datum of the scene's altitudes. Home may be where the
    photographs' flight took off, or on the ground of the model; where neither is known it may be anywhere.
    """
    if home_m is None or options.home_above_takeoff_m is not None:
        return
    known = () if ground is None or options.home is None else _around(options.home, ground)
    if known and min(known) - _AGREES_M <= home_m <= max(known) + _AGREES_M:
        return
    if alignment.takeoff_altitude_m is not None:
        _require_takeoff(home_m, alignment.takeoff_altitude_m)
    elif known:
        _require_ground(home_m, max(known))


def require_related(options: MissionOptions, datum: AltitudeDatum, alignment: Alignment) -> None:
    """Raise ``InvalidRequestError`` for a file to fly above a ``datum`` to which nothing relates the views.

    Altitudes of vehicles that write heights above takeoff are from a barometer, or above an ellipsoid or sea
    level that they do not name. Control points relate them.
    """
    takeoff_m = alignment.takeoff_altitude_m
    if datum is AltitudeDatum.TAKEOFF or takeoff_m is None or not options.format.of_gimbals:
        return
    if alignment.source is AlignmentSource.POSITIONS:
        raise InvalidRequestError(
            f"The photographs do not say how high above {datum.in_words} they were taken: their altitudes "
            "may be off by tens of metres.",
            hint=f"Their flight took off at {takeoff_m:.1f} m. Leave altitude_datum out, and give "
            f"{_GIVE_TAKEOFF}",
            errors=[FieldError("home_above_takeoff_m", "altitudes are above takeoff alone")],
        )


def _require_takeoff(home_m: float, takeoff_m: float) -> None:
    low_m = home_m - takeoff_m
    if abs(low_m) > _AGREES_M:
        raise InvalidRequestError(
            f"Home at {home_m:.1f} m contradicts the photographs: by their heights above takeoff, their "
            f"flight took off at {takeoff_m:.1f} m. If home is there, the mission would fly "
            f"{abs(low_m):.1f} m too {'low' if low_m > 0 else 'high'}.",
            hint=f"Instead of home_altitude_m, give {_GIVE_TAKEOFF}",
            errors=[FieldError("home_altitude_m", f"the photographs' flight took off at {takeoff_m:.1f} m")],
        )


def _require_ground(home_m: float, ground_m: float) -> None:
    if home_m - ground_m > _IN_THE_AIR_M:
        raise InvalidRequestError(
            f"Home at {home_m:.1f} m is {home_m - ground_m:.1f} m above the ground of the model, which is at "
            f"{ground_m:.1f} m there: the mission would fly as much too low.",
            hint="Give home_altitude_m above the datum of the photographs' altitudes: they are often off by "
            "tens of metres, and one from a map does not fit.",
            errors=[FieldError("home_altitude_m", f"the ground of the model is at {ground_m:.1f} m")],
        )


def _around(home: Place, ground: Terrain) -> Sequence[float]:
    """The heights of the ground around home, as far as they are known: at an edge it is smooth."""
    heights = (
        ground.height_m(
            (home[0] + north * ground.latitude_step_deg, home[1] + east * ground.longitude_step_deg)
        )
        for north in _STEPS
        for east in _STEPS
    )
    return [height_m for height_m in heights if height_m is not None]
