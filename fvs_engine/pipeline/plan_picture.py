"""Picture of a plan: the variance of the targets from above, before and after it, with the tours."""

import io
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from numpy.typing import NDArray

from fvs_engine.files.atomic import write_bytes_atomically
from fvs_engine.geometry.top_view import TopView
from fvs_engine.plan.plan_records import Plan, VehicleTour
from fvs_engine.views import PinholeView

Array = NDArray[np.float64]

_COLOR_MAP = "viridis_r"
_DPI = 140
_TOURS = ("#D1495B", "#00798C", "#EDAE49", "#6A4C93", "#30638E")
_WIDTH_IN, _MARGINS_IN = 11.6, 1.6
_HEIGHTS_IN = (3.6, 8.0)
_MOST_NUMBERS = 60
"""Stops of a tour that are numbered; more would hide each other."""


def draw_plan(
    path: Path,
    plan: Plan,
    visited: Sequence[PinholeView],
    targets: Sequence[PinholeView],
    candidates: Mapping[str, PinholeView],
    *,
    title: str,
) -> None:
    """Write a PNG of two maps. Targets are coloured by their kriging variance, photographs are black.

    Stops are numbered in the order of the visit. Raises ``StorageError`` when it cannot be written.
    """
    centres = np.stack([view.centre for view in targets])
    above = TopView(centres, np.stack([view.camera_from_model.rotation for view in targets]))
    width, height = np.ptp(above.project(centres), axis=0)
    figure = Figure(figsize=(_WIDTH_IN, _height_in(width, height)), layout="constrained")
    panels = figure.subplots(1, 2, sharex=True, sharey=True)
    variances = np.array(plan.target_variances)
    shades = Normalize(0.0, max(1e-6, float(variances.max())))
    places = above.project(np.stack([view.centre for view in visited]))
    for axes, values, name in zip(panels, variances.T, ("now", "after the plan"), strict=True):
        x, y = above.project(centres).T
        axes.scatter(x, y, c=values, cmap=_COLOR_MAP, norm=shades, s=42, edgecolors="none", zorder=2)
        axes.scatter(*places.T, s=12, color="black", zorder=3, label=f"photographs ({len(visited)})")
        axes.set_aspect("equal")
        axes.set_title(f"{name}: mean variance {values.mean():.3f}", loc="left", fontsize=11)
        axes.spines[["top", "right"]].set_visible(False)
        axes.set_xlabel("from above, in units of the model")
    for number, tour in enumerate(plan.tours):
        label = "plan" if len(plan.tours) == 1 else f"vehicle {number + 1}"
        _draw_tour(panels[1], tour, above, candidates, _TOURS[number % len(_TOURS)], label)
    figure.suptitle(title, x=0.01, ha="left", fontsize=12)
    colors = ScalarMappable(shades, _COLOR_MAP)
    figure.colorbar(colors, ax=panels, label="kriging variance of a target", shrink=0.8, pad=0.01)
    panels[1].legend(loc="best", frameon=False, fontsize=9)
    png = io.BytesIO()
    figure.savefig(png, format="png", dpi=_DPI)
    write_bytes_atomically(path, png.getvalue())


def _height_in(width: float, height: float) -> float:
    """The height of a picture with two maps of this extent beside each other."""
    panel = _WIDTH_IN / 2.4 * height / max(width, 1e-9)
    return float(np.clip(panel + _MARGINS_IN, *_HEIGHTS_IN))


def _draw_tour(
    axes: Axes,
    tour: VehicleTour,
    above: TopView,
    candidates: Mapping[str, PinholeView],
    color: str,
    label: str,
) -> None:
    way = [np.array(tour.start), *(candidates[stop.name].centre for stop in tour.stops)]
    x, y = above.project(np.stack(way)).T
    flown = [way[0]]
    for stop, centre in zip(tour.stops, way[1:], strict=True):
        flown += [*map(np.array, stop.via), centre]
    lines = above.project(np.stack(flown)).T
    axes.plot(*lines, color=color, linewidth=1.4, zorder=4, label=f"{label} ({len(tour.stops)})")
    if tour.stops and tour.length > tour.stops[-1].travel * (1 + 1e-6):  # home
        home = above.project(np.stack([way[-1], *map(np.array, tour.via_home), way[0]])).T
        axes.plot(*home, color=color, linewidth=1.0, linestyle=":", zorder=4)
    axes.scatter(x[:1], y[:1], s=60, facecolors="white", edgecolors=color, linewidths=1.6, zorder=5)
    axes.scatter(x[1:], y[1:], s=30, color=color, edgecolors="white", linewidths=0.6, zorder=6)
    for number, place in enumerate(zip(x[1:], y[1:], strict=True), start=1):
        if number <= _MOST_NUMBERS:
            axes.annotate(str(number), place, xytext=(4, 4), textcoords="offset points", fontsize=8, zorder=7)
