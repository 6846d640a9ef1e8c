"""The drawings of the documentation, as SVG: ``python docs/images/diagrams.py`` writes them beside this file.

A test holds the checked-in files to this script.
"""

import math
from collections.abc import Sequence
from pathlib import Path
from xml.sax.saxutils import escape

INK, GREY, LINE = "#1f2933", "#52606d", "#7b8794"
BLUE, GREEN, AMBER, PAPER = "#e3effd", "#e3f6ea", "#fdf1dc", "#f5f7fa"
ACCENT, X_AXIS, Y_AXIS, Z_AXIS = "#1d5fbf", "#c0392b", "#218c53", "#1d5fbf"
FONT = "system-ui, -apple-system, 'Segoe UI', Roboto, 'DejaVu Sans', sans-serif"

Point = tuple[float, float]


class Drawing:
    """An SVG of ``width`` × ``height`` px on white, so that it also reads on a dark page."""

    def __init__(self, width: int, height: int, title: str) -> None:
        self._parts = [
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" role="img" '
            f'font-family="{FONT}" font-size="14">',
            f"<title>{escape(title)}</title>",
            "<defs>",
            *(
                f'<marker id="{name}" viewBox="0 0 10 10" refX="9" refY="5" markerWidth="8" markerHeight="8" '
                f'orient="auto-start-reverse"><path d="M0 0 L10 5 L0 10 z" fill="{color}"/></marker>'
                for name, color in (
                    ("plain", GREY),
                    ("accent", ACCENT),
                    ("x", X_AXIS),
                    ("y", Y_AXIS),
                    ("z", Z_AXIS),
                )
            ),
            "</defs>",
            f'<rect width="{width}" height="{height}" rx="10" fill="#ffffff"/>',
        ]

    def text(
        self, x: float, y: float, *lines: str, anchor: str = "middle", size: int = 14, color: str = INK,
        weight: str = "normal", halo: bool = False,
    ) -> None:  # fmt: skip
        """Lines of text; ``y`` is the first one's baseline. A ``halo`` keeps lines behind it away."""
        around = ' stroke="#ffffff" stroke-width="4" paint-order="stroke"' if halo else ""
        for number, line in enumerate(lines):
            self._parts.append(
                f'<text x="{x:g}" y="{y + number * size * 1.3:g}" text-anchor="{anchor}" font-size="{size}" '
                f'fill="{color}" font-weight="{weight}"{around}>{escape(line)}</text>'
            )

    def box(
        self, x: float, y: float, width: float, height: float, title: str = "", *lines: str,
        fill: str = BLUE, dashed: bool = False,
    ) -> None:  # fmt: skip
        """A rounded box with a bold title and lines below it, from its top."""
        dash = ' stroke-dasharray="6 4"' if dashed else ""
        self._parts.append(
            f'<rect x="{x:g}" y="{y:g}" width="{width:g}" height="{height:g}" rx="8" fill="{fill}" '
            f'stroke="{LINE}"{dash}/>'
        )
        if title:
            self.text(x + width / 2, y + 24, title, weight="600", size=15)
        self.text(x + width / 2, y + 45, *lines, size=12, color=GREY)

    def arrow(
        self, *points: Point, mark: str = "plain", both: bool = False, dashed: bool = False,
        width: float = 1.6,
    ) -> None:  # fmt: skip
        """A line through ``points`` with a head at its end, or at both ends."""
        color = {"plain": GREY, "accent": ACCENT, "x": X_AXIS, "y": Y_AXIS, "z": Z_AXIS}[mark]
        dash = ' stroke-dasharray="5 4"' if dashed else ""
        start = f' marker-start="url(#{mark})"' if both else ""
        self._parts.append(
            f'<polyline points="{_points(points)}" fill="none" stroke="{color}" stroke-width="{width:g}"'
            f'{dash}{start} marker-end="url(#{mark})"/>'
        )

    def polygon(self, points: Sequence[Point], fill: str = "none", color: str = LINE) -> None:
        """A closed outline."""
        self._parts.append(
            f'<polygon points="{_points(points)}" fill="{fill}" fill-opacity="0.6" stroke="{color}"/>'
        )

    def dot(self, point: Point, radius: float = 4, color: str = INK) -> None:
        """A filled circle."""
        self._parts.append(f'<circle cx="{point[0]:.1f}" cy="{point[1]:.1f}" r="{radius:g}" fill="{color}"/>')

    def svg(self) -> str:
        """The whole file."""
        return "\n".join([*self._parts, "</svg>", ""])


def _points(points: Sequence[Point]) -> str:
    return " ".join(f"{x:.1f},{y:.1f}" for x, y in points)


def architecture() -> str:
    """Processes, and what flows between them."""
    d = Drawing(1000, 640, "The processes of the service and what flows between them")
    d.box(20, 60, 170, 330, "Clients", fill=PAPER)
    d.text(105, 115, "drone or companion", "computer: fvs-client", size=13)
    d.text(105, 205, "mission planner:", "REST, gRPC, fvs_client", size=13)
    d.text(105, 295, "engineer: fvs-client,", "curl, Python", size=13)

    d.box(290, 40, 690, 370, fill="#ffffff", dashed=True)
    d.text(306, 62, "fvs serve", anchor="start", weight="600", size=15)
    d.text(396, 62, "a supervisor that starts these processes, and restarts one that dies", anchor="start",
           size=13, color=GREY)  # fmt: skip

    d.box(310, 85, 185, 300, "gateway", "REST, gRPC, events", "no torch, no pycolmap", fill=BLUE)
    d.box(325, 285, 155, 82, "inspectors", "decode every upload,", "within limits", fill="#ffffff")
    d.box(770, 85, 190, 105, "runner", "one per active scene:", "keeps models loaded,", "trains and ranks",
          fill=GREEN)  # fmt: skip
    d.box(
        585,
        275,
        145,
        110,
        "worker",
        "takes jobs, holds",
        "the scene's lease,",
        "commits snapshots",
        fill=BLUE,
    )
    d.box(770, 275, 190, 110, "SfM child", "pycolmap: features,", "matches, cameras;", "can be killed",
          fill=GREEN)  # fmt: skip

    d.arrow((190, 130), (310, 130))
    d.text(250, 120, "photographs", size=12)
    d.arrow((190, 200), (310, 200), mark="accent", both=True, width=2.4)
    d.text(250, 190, "rankings", size=12, color=ACCENT, weight="600")
    d.arrow((190, 250), (310, 250))
    d.text(250, 240, "jobs", size=12)
    d.arrow((310, 330), (190, 330))
    d.text(248, 320, "events, files", size=12)

    d.arrow((495, 125), (770, 125), mark="accent", both=True, width=2.4)
    d.text(632, 114, "ranking requests: straight", size=12, color=ACCENT, weight="600")
    d.text(632, 145, "to the runner, not behind jobs", size=12, color=ACCENT, weight="600")
    d.arrow((495, 330), (585, 330))
    d.text(540, 320, "jobs, queued", size=12)
    d.arrow((657, 275), (657, 172), (770, 172))
    d.text(650, 215, "spawns; jobs out,", "results back", size=12, anchor="end")
    d.arrow((865, 190), (865, 275), both=True)
    d.text(857, 228, "images in,", "cameras out", size=12, anchor="end")

    d.box(290, 470, 690, 145, fill="#ffffff", dashed=True)
    d.text(400, 492, "--root", anchor="start", weight="600", size=15)
    d.text(462, 492, "what is on disk", anchor="start", size=13, color=GREY)
    d.box(310, 505, 150, 95, "blobs/", "images, snapshots'", "artifacts, renders", fill=AMBER)
    d.box(
        475,
        505,
        305,
        95,
        "fvs.sqlite3",
        "scenes, jobs and their queue, keys,",
        "rankings, leases",
        fill=AMBER,
    )
    d.box(795, 505, 165, 95, "scenes/<id>/", "features, matches,", "checkpoint", fill=AMBER)
    d.arrow((370, 385), (370, 505), both=True)
    d.text(378, 440, "bytes first,", "then rows", size=12, anchor="start")
    d.arrow((620, 385), (620, 505))
    d.text(612, 440, "commits, fenced", "by the lease", size=12, anchor="end")
    d.arrow((715, 385), (715, 505), both=True)
    d.text(723, 450, "jobs", size=12, anchor="start")
    d.arrow((865, 385), (865, 505), both=True)
    return d.svg()


def life_of_a_scene() -> str:
    """From a photograph to a ranking, and round again."""
    d = Drawing(1000, 470, "The life of a scene: from photographs to a ranking, and round again")
    d.box(20, 50, 150, 95, "image", "arrives, is decoded,", "gets a verdict", fill=BLUE)
    d.box(215, 50, 150, 95, "pending", "accepted; the next", "update takes it", fill=BLUE)
    d.arrow((170, 97), (215, 97))
    d.text(75, 168, "unreadable, too small,", "duplicate: rejected", size=12, color=GREY, anchor="start")

    d.box(410, 30, 570, 135, fill="#ffffff", dashed=True)
    d.text(426, 52, "update", anchor="start", weight="600", size=15)
    d.text(496, 52, "a job: continues from the last snapshot", anchor="start", size=13, color=GREY)
    d.arrow((365, 97), (428, 97))
    stages = ("features", "matching", "mapping", "alignment", "training")
    for number, stage in enumerate(stages):
        x = 428 + number * 109
        d.box(x, 75, 95, 46, fill=GREEN)
        d.text(x + 47.5, 103, stage, size=13)
        if number:
            d.arrow((x - 14, 98), (x, 98))
    unregistered = "an image without enough matches stays unregistered, and is tried again"
    d.text(695, 148, unregistered, size=12, color=GREY)

    d.box(
        740,
        235,
        220,
        100,
        "snapshot",
        "immutable: cameras, points,",
        "Gaussians, alignment, metrics",
        fill=AMBER,
    )
    d.arrow((905, 165), (905, 235))
    d.arrow((820, 235), (820, 165), dashed=True)
    d.text(812, 205, "the next update", "continues from here", size=12, anchor="end", color=GREY)

    d.box(
        440, 235, 220, 100, "ranking", "scores candidates at any", "time, also while a job trains", fill=AMBER
    )
    d.arrow((740, 285), (660, 285), mark="accent", width=2.4)
    d.box(140, 235, 220, 100, "next view", "the planner flies there and", "takes a photograph", fill=PAPER)
    d.arrow((440, 285), (360, 285), mark="accent", width=2.4)
    d.text(400, 272, "rank 1", size=12, color=ACCENT, weight="600")
    d.arrow((140, 285), (50, 285), (50, 145), mark="accent", width=2.4)
    d.text(58, 228, "new image", size=12, color=ACCENT, anchor="start", weight="600")

    d.box(440, 380, 220, 70, "fine", "the final job: SH degree 3, longer", fill=GREEN)
    d.arrow((850, 335), (850, 415), (660, 415))
    d.arrow((440, 415), (360, 415))
    d.text(350, 408, "the final model,", "point_cloud.ply", anchor="end", size=13)
    return d.svg()


class Axes:
    """Three dimensions on paper: x to the lower right, y to the upper right, z up."""

    def __init__(self, origin: Point, scale: float, turn_deg: float = 0.0) -> None:
        self._origin, self._scale, self._turn = origin, scale, math.radians(turn_deg)

    def at(self, x: float, y: float, z: float) -> Point:
        """Where a point is drawn."""
        c, s = math.cos(self._turn), math.sin(self._turn)
        x, y = c * x - s * y, s * x + c * y
        across = 0.87 * x + 0.62 * y
        up = -0.36 * x + 0.42 * y + z
        return self._origin[0] + self._scale * across, self._origin[1] - self._scale * up


def _draw_axes(d: Drawing, axes: Axes, names: Sequence[str], length: float = 1.0) -> None:
    start = axes.at(0, 0, 0)
    for name, mark, color, end in zip(
        names,
        "xyz",
        (X_AXIS, Y_AXIS, Z_AXIS),
        ((length, 0, 0), (0, length, 0), (0, 0, length)),
        strict=True,
    ):
        tip = axes.at(*end)
        d.arrow(start, tip, mark=mark, width=2.2)
        beyond = axes.at(*(1.18 * part for part in end))
        d.text(beyond[0], beyond[1] + 5, name, size=13, color=color, weight="600")
    d.dot(start)


def frames() -> str:
    """World, model and camera, and the pixels of an image."""
    d = Drawing(1000, 500, "The frames: world, model, camera and pixels")
    d.text(150, 36, "world", weight="600", size=16)
    d.text(150, 56, "ENU metres about a fixed origin,", "or the dataset's own frame", size=12, color=GREY)
    _draw_axes(d, Axes((110, 330), 105), ("x east", "y north", "z up"))

    d.text(430, 36, "model", weight="600", size=16)
    d.text(430, 56, "the reconstruction's frame: no unit;", "it stays between updates", size=12, color=GREY)
    model = Axes((390, 330), 70, turn_deg=-28)
    _draw_axes(d, model, ("x", "y", "z"))
    for x, y, z in ((0.9, 0.8, 0.2), (1.1, 0.3, 0.5), (0.5, 1.2, 0.6), (1.0, 1.0, 0.9), (0.4, 0.6, 1.0)):
        d.dot(model.at(x, y, z), 2.5, LINE)

    d.text(800, 36, "camera", weight="600", size=16)
    d.text(800, 56, "OpenCV axes: x right, y down, z forward;", "the camera centre is the origin",
           size=12, color=GREY)  # fmt: skip
    centre = (700.0, 235.0)
    corners = [(830.0, 120.0), (950.0, 165.0), (950.0, 315.0), (830.0, 270.0)]
    d.polygon(corners, fill=BLUE)
    for corner in corners:
        d.polygon([centre, corner])
    d.arrow(centre, (860, 212), mark="z", width=2.4)
    d.text(873, 207, "z forward", size=13, color=Z_AXIS, weight="600", anchor="start")
    d.arrow(centre, (768, 262), mark="x", width=2.4)
    d.text(774, 280, "x right", size=13, color=X_AXIS, weight="600", anchor="start")
    d.arrow(centre, (700, 315), mark="y", width=2.4)
    d.text(700, 334, "y down", size=13, color=Y_AXIS, weight="600")
    d.dot(centre)

    d.arrow((470, 395), (180, 395), mark="accent", width=2)
    d.text(325, 418, "world_from_model: a similarity", size=13, color=ACCENT, weight="600")
    d.text(325, 437, "scale · rotation · translation, with its RMS in metres", size=12, color=GREY)
    d.arrow((520, 395), (690, 395), mark="accent", width=2)
    d.text(605, 418, "camera_from_model", size=13, color=ACCENT, weight="600")
    d.text(605, 437, "rigid: a view's pose", size=12, color=GREY)

    d.polygon([(770, 395), (950, 395), (950, 480), (770, 480)], fill=PAPER)
    d.polygon([(770, 395), (800, 395), (800, 425), (770, 425)], fill=BLUE)
    d.dot((770, 395), 3.5)
    d.dot((785, 410), 3.5, ACCENT)
    d.text(762, 388, "(0, 0): the image's corner", size=12, anchor="start")
    d.text(808, 415, "(0.5, 0.5): the first", "pixel's centre", size=12, anchor="start", color=ACCENT)
    return d.svg()


def _sequence(title: str, names: Sequence[str], steps: Sequence[tuple[int, int, str]]) -> str:
    """Participants above their lifelines, and steps: from which to which (or to itself), and what."""
    colors = {"client": PAPER, "storage": AMBER, "runner": GREEN, "SfM child": GREEN}
    fills = [colors.get(name, BLUE) for name in names]
    height = 110 + 37 * len(steps)
    d = Drawing(1000, height, title)
    apart = 1000 / len(names)
    middles = [apart * (number + 0.5) for number in range(len(names))]
    for x, name, fill in zip(middles, names, fills, strict=True):
        d.polygon([(x, 62), (x, height - 20)])
        d.box(x - 0.43 * apart, 20, 0.86 * apart, 42, fill=fill)
        d.text(x, 46, name, weight="600", size=14)
    for number, (start, end, what) in enumerate(steps):
        y = 100 + 37 * number
        if start == end:
            width = 7 * len(what) + 16
            left = min(max(middles[start] - width / 2, 8), 992 - width)
            d.box(left, y - 19, width, 26, fill=fills[start])
            d.text(left + width / 2, y - 2, what, size=12)
        else:
            d.arrow((middles[start], y), (middles[end], y))
            d.text((middles[start] + middles[end]) / 2, y - 9, what, size=12, halo=True)
    return d.svg()


def photograph() -> str:
    """What happens to a photograph between its upload and the first model trained on it."""
    return _sequence(
        "The way of a photograph",
        ["client", "gateway", "inspector", "storage", "worker", "runner", "SfM child"],
        [
            (0, 1, "PUT …/images/…"),
            (1, 2, "decode, within limits"),
            (2, 1, "verdict"),
            (1, 3, "bytes first, then the row"),
            (1, 0, "201, accepted"),
            (0, 1, "POST …/jobs: update"),
            (1, 3, "the job's row, a notification"),
            (3, 4, "wakes it"),
            (4, 3, "takes job and lease"),
            (4, 5, "run the job"),
            (3, 5, "photographs"),
            (5, 6, "features, matches"),
            (5, 6, "register, adjust"),
            (6, 5, "poses, points"),
            (5, 5, "the gate, and checks of poses"),
            (5, 5, "first Gaussians, at the sparse points"),
            (5, 4, "the quick model"),
            (4, 4, "aligns it with the world"),
            (4, 3, "files, then the snapshot"),
            (1, 0, "snapshot.created"),
            (5, 5, "trains on; ranks meanwhile"),
        ],
    )


def ranking() -> str:
    """A ranking, from the request to the answer."""
    return _sequence(
        "The way of a ranking",
        ["client", "gateway", "storage", "worker", "runner"],
        [
            (0, 1, "POST …/rankings"),
            (1, 1, "checks the caller, then the body"),
            (1, 2, "scene, snapshot, lease"),
            (2, 1, "where its runner listens"),
            (1, 2, "if there is none: start one"),
            (2, 3, "wakes it"),
            (3, 4, "starts it with the snapshot"),
            (1, 1, "candidates, not visited, in the model frame"),
            (1, 4, "views, method, the time that is left"),
            (4, 4, "waits for earlier requests; equal ones share"),
            (4, 4, "training pauses, for at most 2 s"),
            (4, 4, "feasibility, then scores: render and spectrum"),
            (4, 1, "scores, statuses, chances"),
            (1, 1, "poses into the frame of the answer"),
            (1, 2, "ranking and event, committed"),
            (1, 0, "201, the ranking"),
        ],
    )


DRAWINGS = {
    "architecture.svg": architecture,
    "life-of-a-scene.svg": life_of_a_scene,
    "frames.svg": frames,
    "photograph.svg": photograph,
    "ranking.svg": ranking,
}

if __name__ == "__main__":
    for name, draw in DRAWINGS.items():
        Path(__file__).with_name(name).write_text(draw(), encoding="utf-8")
