"""Plot of a selection's path from above: the paper's figure of trajectories, in one panel."""

import io
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from fvs_engine.files.atomic import write_bytes_atomically
from fvs_engine.geometry.top_view import TopView
from fvs_engine.scene.dataset import Dataset

Array = NDArray[np.float64]

_COLOR_MAP = "plasma"
_DPI = 140
_CAPTURE, _UNVISITED, _TEST = "#D5D7DB", "#9BA0A8", "#3B7DD8"


def draw_trajectory(
    path: Path,
    dataset: Dataset,
    *,
    initial: Sequence[str],
    chosen: Sequence[str],
    vehicles: Sequence[int] | None = None,
    test: Sequence[str],
    title: str,
) -> None:
    """Write a PNG: all views of ``dataset`` and their capture in grey, test views hollow, initial ones black.

    ``chosen`` views, and the path to each, are coloured by order; ``vehicles`` flew there (None: one and the
    same). Seen along the cameras' common up direction. Raises ``StorageError`` when it cannot be written.
    """
    plane = top_view(dataset)
    turns = Normalize(len(initial) + 1, len(initial) + max(len(chosen), 2))
    figure = Figure(figsize=(8.6, 7.6), layout="constrained")
    axes = figure.add_subplot()
    _draw_capture(axes, dataset, plane, (*initial, *chosen), test)
    _draw_way(axes, plane, initial, list(zip(vehicles or [1] * len(chosen), chosen, strict=True)), turns)
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_title(title, loc="left", fontsize=12)
    axes.set_xlabel("from above, in the dataset's unit")
    axes.spines[["top", "right"]].set_visible(False)
    figure.legend(loc="outside lower center", ncols=4, frameon=False, fontsize=9)
    if chosen:
        colors = ScalarMappable(turns, _COLOR_MAP)
        ticks = MaxNLocator(integer=True)
        figure.colorbar(colors, ax=axes, label="view number", ticks=ticks, shrink=0.7, pad=0.02)
    png = io.BytesIO()
    figure.savefig(png, format="png", dpi=_DPI)
    write_bytes_atomically(path, png.getvalue())


def top_view(dataset: Dataset) -> dict[str, Array]:
    """View → its centre on a map [2] (``TopView``)."""
    views = [dataset.by_name[name] for name in dataset.names]
    centres = np.stack([view.centre for view in views])
    above = TopView(centres, np.stack([view.camera_from_model.rotation for view in views]))
    return dict(zip(dataset.names, above.project(centres), strict=True))


def _draw_capture(
    axes: Axes, dataset: Dataset, plane: Mapping[str, Array], visited: Sequence[str], test: Sequence[str]
) -> None:
    """The capture as a thin line, and what was not visited."""
    capture = np.stack([plane[name] for name in dataset.names])
    axes.plot(*capture.T, color=_CAPTURE, linewidth=0.7, zorder=1)
    known = {*visited, *test}
    rest = [plane[name] for name in dataset.names if name not in known]
    if rest:
        x, y = np.stack(rest).T
        axes.scatter(x, y, s=9, color=_UNVISITED, zorder=2, label=f"not visited ({len(rest)})")
    if test:
        x, y = np.stack([plane[name] for name in test]).T
        axes.scatter(x, y, s=20, facecolors="white", edgecolors=_TEST, zorder=3, label=f"test ({len(test)})")


def _draw_way(
    axes: Axes,
    plane: Mapping[str, Array],
    initial: Sequence[str],
    chosen: Sequence[tuple[int, str]],
    turns: Normalize,
) -> None:
    """The initial views, and every chosen one (with its vehicle) with the path to it."""
    x, y = np.stack([plane[name] for name in initial]).T
    axes.plot(x, y, color="black", linewidth=1.2, zorder=4)
    axes.scatter(x, y, s=26, color="black", zorder=6, label=f"initial ({len(initial)})")
    if not chosen:
        return
    stops = np.stack([plane[name] for _, name in chosen])
    at: dict[int, Array] = {}
    legs_flown = []
    for (vehicle, _), stop in zip(chosen, stops, strict=True):
        legs_flown.append(np.stack([at.get(vehicle, plane[initial[-1]]), stop]))
        at[vehicle] = stop
    numbers = np.arange(len(initial) + 1, len(initial) + len(chosen) + 1)
    legs = LineCollection(legs_flown, cmap=_COLOR_MAP, norm=turns, linewidths=1.4, zorder=4)
    legs.set_array(numbers)
    axes.add_collection(legs)
    axes.scatter(
        stops[:, 0],
        stops[:, 1],
        c=numbers,
        cmap=_COLOR_MAP,
        norm=turns,
        s=34,
        edgecolors="white",
        linewidths=0.6,
        zorder=7,
        label=f"chosen ({len(chosen)})",
    )
    axes.annotate(
        str(numbers[-1]), stops[-1], xytext=(6, 6), textcoords="offset points", fontsize=9, zorder=8
    )
