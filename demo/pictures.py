"""The figures of the demonstration: renders of the first candidates, and a map of all poses."""

import io
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from fvs_client import FramePose, Ranking, SnapshotCameras
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray
from PIL import Image
from plyfile import PlyData, PlyElement

from fvs_engine.candidates import RankedCandidate
from fvs_engine.pipeline.contact_sheet import SheetEntry, contact_sheet
from fvs_schema.candidates import CandidateStatus

Array = NDArray[np.float64]

_SHEET_ENTRIES = 8
_MOST_POINTS = 20_000
_MIN_OPACITY = 0.5
_SH_DC = 0.28209479177387814
"""The constant spherical harmonic: colour = 0.5 + ``_SH_DC`` · f_dc."""


def draw_contact_sheet(path: Path, ranking: Ranking) -> None:
    """Draw the renders of the first ranked candidates, each above its spectrum."""
    entries = []
    for item in [item for item in ranking.candidates if item.rank is not None][:_SHEET_ENTRIES]:
        pixels = (
            np.asarray(Image.open(io.BytesIO(ranking.render(item))).convert("RGB"), dtype=np.float64) / 255
        )
        candidate = RankedCandidate(
            name=item.id,
            rank=item.rank,
            score=item.score,
            status=CandidateStatus(item.status.value),
            coverage=item.coverage,
            distance=item.distance_m,
        )
        entries.append(SheetEntry(candidate, pixels))
    contact_sheet(path, entries, title="Next views, the least well known first")


def draw_trajectory(path: Path, cameras: SnapshotCameras, ranking: Ranking, model: Path) -> None:
    """Draw the camera's path and the candidates, coloured by rank, over the model seen from above.

    The ranking's poses are in the model frame, as all else.
    """
    across = _level(np.array(cameras.up))
    way = np.array([view.position for view in cameras.views]) @ across
    figure = Figure(figsize=(8.0, 7.2), layout="constrained")
    axes = figure.add_subplot()
    points, colors = _points(model)
    flat = points @ across
    axes.scatter(flat[:, 0], flat[:, 1], c=colors, s=1.5, linewidths=0, rasterized=True)
    axes.plot(way[:, 0], way[:, 1], color="0.25", linewidth=1, zorder=2)
    axes.scatter(way[:, 0], way[:, 1], color="0.1", s=16, label="photographs, in order of arrival", zorder=3)
    ranked = [item for item in ranking.candidates if item.rank is not None]
    in_model = [item.pose.position for item in ranked if isinstance(item.pose, FramePose)]
    places = np.array(in_model) @ across
    dots = axes.scatter(
        places[:, 0],
        places[:, 1],
        c=[item.rank or 0 for item in ranked],
        cmap="plasma",
        s=70,
        edgecolors="white",
        label="candidates",
        zorder=4,
    )
    figure.colorbar(
        dots, ax=axes, label="rank: 1 is to be photographed next", shrink=0.7, ticks=MaxNLocator(integer=True)
    )
    axes.annotate(
        ranked[0].id, places[0], xytext=(8, 8), textcoords="offset points", fontsize=9, fontweight="bold"
    )
    _frame(axes, np.vstack([way, places]), flat)
    axes.set_title("From above", loc="left")
    axes.set_xlabel("in the unit of the model")
    axes.spines[["top", "right"]].set_visible(False)
    figure.legend(loc="outside lower center", ncols=2, frameon=False)
    figure.savefig(path, dpi=140)


def _level(up: Array) -> Array:
    """Two level directions [3, 2]: columns."""
    first = np.cross(up, np.eye(3)[np.argmin(np.abs(up))])
    first /= np.linalg.norm(first)
    return np.column_stack([first, np.cross(up, first)])


def _points(model: Path) -> tuple[Array, Array]:
    """Means [N, 3] and colours [N, 3] of the opaque Gaussians, not all if they are many."""
    vertices = PlyData.read(str(model))["vertex"]
    opaque = np.flatnonzero(1.0 / (1.0 + np.exp(-np.asarray(vertices["opacity"], float))) > _MIN_OPACITY)
    kept = opaque[:: max(1, len(opaque) // _MOST_POINTS)]
    means = _columns(vertices, ("x", "y", "z"), kept)
    return means, np.clip(0.5 + _SH_DC * _columns(vertices, ("f_dc_0", "f_dc_1", "f_dc_2"), kept), 0, 1)


def _columns(vertices: PlyElement, names: Sequence[str], kept: NDArray[np.intp]) -> Array:
    return np.column_stack([np.asarray(vertices[name], dtype=float)[kept] for name in names])


def _frame(axes: Axes, places: Array, points: Array) -> None:
    """Show all ``places`` and the middle of the model in a square, not the far background."""
    shown = np.vstack([places, np.percentile(points, [20, 80], axis=0)]) if len(points) else places
    low, high = shown.min(axis=0), shown.max(axis=0)
    middle, half = (low + high) / 2, 0.6 * float((high - low).max())
    axes.set_xlim(middle[0] - half, middle[0] + half)
    axes.set_ylim(middle[1] - half, middle[1] + half)
    axes.set_aspect("equal")
