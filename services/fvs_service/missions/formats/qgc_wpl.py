"""MAVLink waypoints as text, ``QGC WPL 110``: https://mavlink.io/en/file_formats/#mission_plain_text_file.

The first item is home, as ArduPilot's ground stations have it; the vehicle has its own once it is armed.
"""

from fvs_service.missions.flight import Mission
from fvs_service.missions.formats.mavlink_items import Command, Frame, Item, items_of


def write(mission: Mission) -> bytes:
    """The mission as a waypoint file."""
    lines = ["QGC WPL 110"]
    for number, item in enumerate((_home(mission), *items_of(mission))):
        numbers = (f"{parameter:.8f}" for parameter in item.parameters)
        fields = (number, int(number == 0), int(item.frame), int(item.command), *numbers, 1)
        lines.append("\t".join(map(str, fields)))
    return ("\r\n".join(lines) + "\r\n").encode()


def _home(mission: Mission) -> Item:
    first, home = mission.waypoints[0], mission.home
    place = (*first.place, 0.0)
    if home is not None:
        place = (home.latitude_deg, home.longitude_deg, home.sea_level_m or 0.0)
    return Item(Command.NAV_WAYPOINT, Frame.GLOBAL, (0.0, 0.0, 0.0, 0.0, *place))
