"""Plot of the selectors' camera paths above the path of the whole capture, as in the paper."""

from collections.abc import Mapping, Sequence
from math import ceil
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from fvs_engine.lab.evaluate.plots import Style, save_figure
from fvs_engine.lab.evaluate.results import Run

Array = NDArray[np.float64]

_CAPTURE = "#9A9A9A"
_KEY_COLOR = "#6B6B6B"
_KEY = "grey: the whole capture; in colour, above it: the views as visited\nhollow: initial; star: the last"
_LIFT = 0.5
"""How far the selected views are lifted, in shares of the capture's width."""
_ELEVATION_DEG, _AZIMUTH_DEG = 28.0, 25.0
"""Direction of the orthographic projection."""
_PANEL_WIDTH, _HEADER = 4.0, 0.45
"""Size of a panel and of its header in inches."""


def plot_trajectories(
    path: Path, title: str, runs: Sequence[Run], centres: Mapping[str, Array], styled: Mapping[str, Style]
) -> None:
    """Write a PNG with one panel per run: the capture's path in grey, the run's above it, dotted lines down.

    ``centres``: name → camera centre [3] of every view of the dataset, in order of capture. Initial views are
    hollow, the last one is a star. The floor is the main plane of the centres.
    """
    capture = on_floor(np.stack(list(centres.values())))
    lift = np.array([0.0, 0.0, _LIFT * float(np.ptp(capture[:, :2], axis=0).max())])
    below, above = as_seen(capture), as_seen(capture + lift)
    low, high = np.minimum(below, above).min(axis=0), np.maximum(below, above).max(axis=0)
    margin = 0.05 * (high - low).max()
    shape = (high - low + 2 * margin)[1] / (high - low + 2 * margin)[0]
    columns = min(3, len(runs))
    rows = ceil(len(runs) / columns)
    height = rows * (_PANEL_WIDTH * shape + _HEADER) + 2 * _HEADER
    figure = Figure(figsize=(_PANEL_WIDTH * columns, height), layout="constrained")
    panels = figure.subplots(rows, columns, squeeze=False).ravel()
    places = {name: index for index, name in enumerate(centres)}
    for axes, run in zip(panels, runs, strict=False):
        flown = [places[name] for name in run.order]
        _draw_run(axes, run, below, below[flown], above[flown], styled[run.method][0])
        travel = sum(_travel(capture[flown][way]) for way in _ways(run))
        axes.set_title(f"{run.method}: {travel:.1f} units", fontsize=10)
        axes.set_xlim(low[0] - margin, high[0] + margin)
        axes.set_ylim(low[1] - margin, high[1] + margin)
    for axes in panels:
        axes.set_aspect("equal")
        axes.set_axis_off()
    figure.suptitle(title, fontsize=12, x=0.01, ha="left")
    figure.supxlabel(_KEY, fontsize=9, color=_KEY_COLOR)
    save_figure(figure, path)


def _draw_run(axes: Axes, run: Run, capture: Array, below: Array, above: Array, color: str) -> None:
    """Draw one run; all points are projected, [N, 2]."""
    axes.plot(*capture.T, color=_CAPTURE, linewidth=0.8, marker=".", markersize=2.5, label="capture")
    for low, high in zip(below, above, strict=True):
        axes.plot(*np.stack([low, high]).T, color=color, linewidth=0.5, linestyle=":", alpha=0.7)
    first, *others = _ways(run)
    axes.plot(*above[first].T, color=color, linewidth=1.3, label=run.method)
    for way in others:
        axes.plot(*above[way].T, color=color, linewidth=1.3)
    given, chosen = above[: run.initial], above[run.initial :]
    axes.plot(*chosen.T, color=color, linestyle="none", marker="o", markersize=4)
    axes.plot(*given.T, color=color, linestyle="none", marker="o", markersize=5, markerfacecolor="white")
    axes.plot(*above[-1:].T, color=color, linestyle="none", marker="*", markersize=12)


def _ways(run: Run) -> list[list[int]]:
    """The way of each vehicle, in indices of ``run.order``; the first one flew to the initial views."""
    given, chosen = list(range(run.initial)), range(run.initial, len(run.order))
    vehicles = run.vehicles or (1,) * len(chosen)
    of = {
        number: [i for i, v in zip(chosen, vehicles, strict=True) if v == number] for number in {1, *vehicles}
    }
    return [[*given, *of[1]], *([given[-1], *way] for number, way in sorted(of.items()) if number != 1)]


def as_seen(points: Array) -> Array:
    """Orthographic projection of ``points`` [N, 3], seen obliquely from above: [N, 2], right and up."""
    azimuth, elevation = np.radians(_AZIMUTH_DEG), np.radians(_ELEVATION_DEG)
    right = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
    away = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
    up = np.sin(elevation) * away + np.cos(elevation) * np.array([0.0, 0.0, 1.0])
    return np.asarray(points @ np.stack([right, up], axis=1))


def on_floor(centres: Array) -> Array:
    """``centres`` [N, 3] turned so that they spread most along x and y, and least along z.

    z points away from where COLMAP's and OpenCV's y points, which is down in most datasets.
    """
    middle = centres.mean(axis=0)
    _, _, directions = np.linalg.svd(centres - middle, full_matrices=True)
    if directions[2, 1] > 0:
        directions[2] *= -1
    directions[1] = np.cross(directions[2], directions[0])
    return np.asarray((centres - middle) @ directions.T)


def _travel(flown: Array) -> float:
    return float(np.linalg.norm(np.diff(flown, axis=0), axis=1).sum())
