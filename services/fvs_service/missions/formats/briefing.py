"""A picture of the flight, as SVG, to brief a pilot: a map, the profile of heights, and a table of the legs.

Times are estimates (``times``).
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import accumulate, pairwise

from fvs_schema.fence import Place
from fvs_schema.missions import Finish
from fvs_schema.scenes import AltitudeDatum
from fvs_service.missions.flight import Mission, Waypoint
from fvs_service.missions.formats.xml import text
from fvs_service.missions.times import LANDING_S, at_view_s, flying_s, length_m

_DEGREE_M = 111_195.0
_WIDTH, _MARGIN = 900.0, 30.0
_MAP, _PROFILE, _ROW = 460.0, 150.0, 17.0
_HEAD = 96.0
_ARROW = 26.0
_DOWN_DEG = -80.0
"""Below this pitch the heading of a view says little, and the arrow is a ring."""
_MOST_HEIGHTS = 40
"""Of more views the map has numbers alone."""
_LARGER_FENCE = 3.0
_LEAST_M = 10.0
_STYLE = (
    "text{font:12px system-ui,sans-serif;fill:#111}.title{font-size:19px;font-weight:600}"
    ".small{font-size:10px;fill:#444}.number{font-weight:600;fill:#fff;text-anchor:middle}"
    ".right{text-anchor:end}.head{font-weight:600}.way{fill:none;stroke:#1f5fbf;stroke-width:2}"
    ".home{stroke-dasharray:6 4}.fence{fill:none;stroke:#b36b00;stroke-width:2;stroke-dasharray:9 5}"
    ".view{fill:#1f5fbf}.pass{fill:#fff;stroke:#1f5fbf;stroke-width:1.5}.looks{fill:none;stroke:#c22;"
    "stroke-width:2}.tip{fill:#c22}.frame{fill:none;stroke:#999}.limit{stroke:#c22;stroke-dasharray:3 3}"
    ".ground{fill:#d8cfc0;stroke:#8a7a60}.takeoff{fill:#0a7a3a}"
)


@dataclass(frozen=True)
class _Stop:
    """A point of the way, with the number of its view, the way flown up to it, and when it is reached."""

    point: Waypoint
    label: str
    number: int | None
    length_m: float
    leg_m: float
    at_s: float
    leg_s: float


def write(mission: Mission) -> bytes:
    """The picture, as wide as a page."""
    stops = _stops(mission)
    rows = list(_rows(mission, stops))
    height = _HEAD + _MAP + _PROFILE + 70.0 + _ROW * (len(rows) + 1)
    content = "".join(
        (
            f"<style>{_STYLE}</style>",
            f'<rect width="{_WIDTH:g}" height="{height:g}" fill="#fff"/>',
            *_head(mission, stops),
            f'<svg x="{_MARGIN:g}" y="{_HEAD:g}" width="{_WIDTH - 2 * _MARGIN:g}" height="{_MAP:g}">',
            *_map(mission, stops),
            "</svg>",
            *_profile(mission, stops, _HEAD + _MAP + 20.0),
            *rows,
        )
    )
    size = f'viewBox="0 0 {_WIDTH:g} {height:g}" width="{_WIDTH:g}" height="{height:g}"'
    return f'<svg xmlns="http://www.w3.org/2000/svg" {size}>{content}</svg>\n'.encode()


def _stops(mission: Mission) -> list[_Stop]:
    speed, hold_s = mission.options.speed_m_s, mission.options.hold_s
    steps_m = [0.0, *(length_m(pair) for pair in pairwise(mission.way))]
    steps_s = [0.0, *(flying_s(pair, speed) for pair in pairwise(mission.way))]
    waits = [0.0 if point.name is None else at_view_s(hold_s) for point in mission.way]
    # A view counts when its photograph is taken.
    legs_s = [step + wait for step, wait in zip(steps_s, waits, strict=True)]
    if mission.home is not None and mission.options.finish is Finish.RETURN:
        legs_s[-1] += LANDING_S
    numbers = list(accumulate(point.name is not None for point in mission.way))
    return [
        _Stop(
            *(point, _label(mission, index), number if point.name else None),
            *(so_far_m, step_m, at_s, leg_s),
        )
        for index, (point, number, so_far_m, step_m, at_s, leg_s) in enumerate(
            zip(
                *(mission.way, numbers, accumulate(steps_m), steps_m, accumulate(legs_s), legs_s),
                strict=True,
            )
        )
    ]


def _label(mission: Mission, index: int) -> str:
    point = mission.way[index]
    if point.name is not None:
        return point.name if len(point.name) <= 26 else f"{point.name[:25]}…"
    if mission.home is None or point.place != (mission.home.latitude_deg, mission.home.longitude_deg):
        return "pass"
    return "home" if index in (0, len(mission.way) - 1) else "above home"


def _head(mission: Mission, stops: Sequence[_Stop]) -> Iterator[str]:
    options = mission.options
    yield _text(_MARGIN, 34.0, mission.name, "title")
    count = len(mission.views)
    total = f"{count} {'view' if count == 1 else 'views'}, {mission.length_m:,.0f} m"
    total += f", about {_clock(mission.duration_s)} min"
    yield _text(_MARGIN, 54.0, f"{total} at {options.speed_m_s:g} m/s, {options.hold_s:g} s at a view")
    home = "home is not known: the vehicle is in the air"
    if mission.home is not None:
        home = f"home {mission.home.latitude_deg:.6f}, {mission.home.longitude_deg:.6f}"
        home += f"; at the end: {options.finish.value}"
    heights = [stop.point.altitude_m for stop in stops if stop.number is not None]
    span = f"views at {min(heights):.1f} to {max(heights):.1f} m above {_above(mission)}"
    yield _text(_MARGIN, 70.0, f"{home}; {span}")
    names = {
        "lowest": options.lowest_height_m,
        "highest": options.highest_height_m,
        "between views": options.transit_height_m,
    }
    limits = [f"{name} {value:g} m" for name, value in names.items() if value is not None]
    if limits and any(stop.point.above_ground_m is not None for stop in stops):
        limits[-1] += " above the ground"
    limits.append("no geofence" if options.fence is None else "geofence: dashed")
    if options.battery_s is not None:
        limits.append(
            f"one battery {_clock(options.battery_s)} min, landing with {options.battery_reserve:.0%}"
        )
    yield _text(_MARGIN, 86.0, "; ".join(limits))


def _map(mission: Mission, stops: Sequence[_Stop]) -> Iterator[str]:
    fence = () if mission.options.fence is None else mission.options.fence.corners
    project = _Projection([stop.point.place for stop in stops], fence)
    if fence:
        corners = " ".join(_pair(project(corner)) for corner in fence)
        yield f'<polygon class="fence" points="{corners}"/>'
    for before, after in pairwise(stops):
        of_home = before.label in _OF_HOME or after.label in _OF_HOME
        (a, b), (c, d) = project(before.point.place), project(after.point.place)
        kind = "way home" if of_home else "way"
        yield f'<line class="{kind}" x1="{a:.1f}" y1="{b:.1f}" x2="{c:.1f}" y2="{d:.1f}"/>'
    few = len(mission.views) <= _MOST_HEIGHTS
    for stop in sorted(stops, key=lambda stop: stop.number or 0):
        at = project(stop.point.place)
        if stop.number is None:
            kind = "takeoff" if stop.label in _OF_HOME else "pass"
            yield f'<circle class="{kind}" cx="{at[0]:.1f}" cy="{at[1]:.1f}" r="4"/>'
            continue
        yield from _looks(stop.point, at)
        yield f'<circle class="view" cx="{at[0]:.1f}" cy="{at[1]:.1f}" r="9"/>'
        yield _text(at[0], at[1] + 4.0, str(stop.number), "number")
        if few:
            yield _text(at[0] + 11.0, at[1] + 15.0, f"{stop.point.altitude_m:.0f} m", "small")
    if mission.home is not None:
        u, v = project((mission.home.latitude_deg, mission.home.longitude_deg))
        yield f'<circle class="takeoff" cx="{u:.1f}" cy="{v:.1f}" r="9"/>' + _text(u, v + 4.0, "H", "number")
    width = _WIDTH - 2 * _MARGIN
    yield f'<rect class="frame" x="0.5" y="0.5" width="{width - 1:g}" height="{_MAP - 1:g}"/>'
    bar_m = 10.0 ** math.floor(math.log10(150.0 / project.scale))
    bar_m *= max(step for step in (1, 2, 5) if bar_m * step * project.scale <= 150.0)
    yield f'<path d="M12 {_MAP - 14:g}h{bar_m * project.scale:.1f}" stroke="#111" stroke-width="3"/>'
    yield _text(12.0, _MAP - 20.0, f"{bar_m:g} m", "small")
    yield f'<path d="M{width - 20:g} 46v-28l-6 10m6 -10l6 10" fill="none" stroke="#111" stroke-width="2"/>'
    yield _text(width - 24.0, 60.0, "N")


_OF_HOME = ("home", "above home")


def _looks(view: Waypoint, at: tuple[float, float]) -> Iterator[str]:
    """Where a view looks: an arrow, shorter the steeper, or a ring when it looks down."""
    u, v = at
    if view.pitch_deg <= _DOWN_DEG:
        yield f'<circle class="looks" cx="{u:.1f}" cy="{v:.1f}" r="13"/>'
        return
    yaw = math.radians(view.yaw_deg)
    x, y = math.sin(yaw), -math.cos(yaw)
    reach = 12.0 + _ARROW * math.cos(math.radians(view.pitch_deg))
    tip = (u + reach * x, v + reach * y)
    left = (tip[0] - 8.0 * x - 5.0 * y, tip[1] - 8.0 * y + 5.0 * x)
    right = (tip[0] - 8.0 * x + 5.0 * y, tip[1] - 8.0 * y - 5.0 * x)
    yield f'<line class="looks" x1="{u:.1f}" y1="{v:.1f}" x2="{tip[0]:.1f}" y2="{tip[1]:.1f}"/>'
    yield f'<polygon class="tip" points="{" ".join(map(_pair, (tip, left, right)))}"/>'


class _Projection:
    """Places on the map: all of the way, and of the fence unless that is so large that the way were small."""

    def __init__(self, places: Sequence[Place], fence: Sequence[Place]) -> None:
        self._origin = places[0]
        self._east = _DEGREE_M * max(0.01, math.cos(math.radians(places[0][0])))
        self.scale, self._middle = self._fitted(places)
        scale, middle = self._fitted([*places, *fence])
        if scale * _LARGER_FENCE >= self.scale:
            self.scale, self._middle = scale, middle

    def __call__(self, place: Place) -> tuple[float, float]:
        east_m, north_m = self._flat(place)
        u = (_WIDTH - 2 * _MARGIN) / 2.0 + self.scale * (east_m - self._middle[0])
        return u, _MAP / 2.0 - self.scale * (north_m - self._middle[1])

    def _fitted(self, places: Sequence[Place]) -> tuple[float, tuple[float, float]]:
        """The px of a metre with which places fill the map, and their middle."""
        east, north = zip(*map(self._flat, places), strict=True)
        wide, high = max(east) - min(east), max(north) - min(north)
        scale = min(
            (_WIDTH - 2 * _MARGIN - 100.0) / max(wide, _LEAST_M), (_MAP - 100.0) / max(high, _LEAST_M)
        )
        return scale, ((max(east) + min(east)) / 2.0, (max(north) + min(north)) / 2.0)

    def _flat(self, place: Place) -> tuple[float, float]:
        east_deg = (place[1] - self._origin[1] + 180.0) % 360.0 - 180.0
        return east_deg * self._east, (place[0] - self._origin[0]) * _DEGREE_M


def _profile(mission: Mission, stops: Sequence[_Stop], top: float) -> Iterator[str]:
    """Heights over the way that was flown, with the ground where it is known."""
    ground = [
        (stop.length_m, stop.point.altitude_m - stop.point.above_ground_m)
        for stop in stops
        if stop.point.above_ground_m is not None
    ]
    levels = [stop.point.altitude_m for stop in stops] + [height_m for _, height_m in ground]
    limits = []
    if mission.datum is AltitudeDatum.TAKEOFF:
        levels.append(0.0)
        if not ground:
            given = (mission.options.lowest_height_m, mission.options.highest_height_m)
            limits = [one for one in given if one is not None and one <= 2.0 * max(levels)]
            levels += limits
    low_m, high_m = min(levels), max(*levels, min(levels) + 1.0)
    long_m = max(stops[-1].length_m, 1.0)
    left, width = _MARGIN + 40.0, _WIDTH - 2 * _MARGIN - 40.0

    def at(length_m: float, level_m: float) -> tuple[float, float]:
        return left + width * length_m / long_m, top + _PROFILE * (1.0 - (level_m - low_m) / (high_m - low_m))

    if len(ground) > 1:
        line = [at(*one) for one in ground]
        edge = [(line[-1][0], top + _PROFILE), (line[0][0], top + _PROFILE)]
        yield f'<polygon class="ground" points="{" ".join(map(_pair, (*line, *edge)))}"/>'
    for limit_m in limits:
        _, v = at(0.0, limit_m)
        yield f'<path class="limit" d="M{left:g} {v:.1f}h{width:g}"/>'
    way = " ".join(_pair(at(stop.length_m, stop.point.altitude_m)) for stop in stops)
    yield f'<polyline class="way" points="{way}"/>'
    for stop in stops:
        if stop.number is not None:
            u, v = at(stop.length_m, stop.point.altitude_m)
            yield f'<circle class="view" cx="{u:.1f}" cy="{v:.1f}" r="3"/>'
            yield _text(u - 3.0, v - 6.0, str(stop.number), "small")
    yield f'<rect class="frame" x="{left:g}" y="{top:g}" width="{width:g}" height="{_PROFILE:g}"/>'
    yield _text(left - 4.0, top + 10.0, f"{high_m:.0f} m", "small right")
    yield _text(left - 4.0, top + _PROFILE, f"{low_m:.0f} m".replace("-", "−"), "small right")
    caption = f"heights above {_above(mission)}, over the way of {long_m:,.0f} m"
    yield _text(left, top + _PROFILE + 14.0, caption, "small")


def _rows(mission: Mission, stops: Sequence[_Stop]) -> Iterator[str]:
    grounded = any(stop.point.above_ground_m is not None for stop in stops)
    names = ["no.", "to", f"above {_above(mission)}", "above ground", "way", "min", "since start"]
    names += ["heading", "gimbal"]
    columns = [60.0, 72.0, 350.0, 455.0, 530.0, 600.0, 690.0, 770.0, 860.0]
    top = _HEAD + _MAP + _PROFILE + 62.0

    def row(line: int, cells: Sequence[str], kind: str = "") -> str:
        y = top + _ROW * line
        return "".join(
            _text(x, y, cell, kind if index == 1 else f"{kind} right".strip())
            for index, (x, cell) in enumerate(zip(columns, cells, strict=True))
        )

    if not grounded:
        names[3] = ""
    yield row(0, names, "head")
    for line, stop in enumerate(stops, start=1):
        point, view = stop.point, stop.number is not None
        above_m = point.above_ground_m
        yield row(
            line,
            [
                str(stop.number) if view else "",
                stop.label,
                f"{point.altitude_m:.1f} m",
                "" if above_m is None else f"{above_m:.1f} m",
                f"{stop.leg_m:,.0f} m" if line > 1 else "",
                _clock(stop.leg_s) if line > 1 else "",
                _clock(stop.at_s),
                f"{point.yaw_deg % 360.0:.0f}°" if view else "",
                f"{point.pitch_deg:.0f}°".replace("-", "−") if view else "",
            ],
        )


def _above(mission: Mission) -> str:
    return "home" if mission.datum is AltitudeDatum.TAKEOFF else mission.datum.in_words


def _text(x: float, y: float, content: str, kind: str = "") -> str:
    of_kind = f' class="{kind}"' if kind else ""
    return f'<text x="{x:.1f}" y="{y:.1f}"{of_kind}>{text(content)}</text>' if content else ""


def _pair(at: tuple[float, float]) -> str:
    return f"{at[0]:.1f},{at[1]:.1f}"


def _clock(seconds: float) -> str:
    whole = round(seconds)
    return f"{whole // 60}:{whole % 60:02d}"
