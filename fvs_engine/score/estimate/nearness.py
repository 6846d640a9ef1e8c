"""How much of a view shows the model from nearer than photographs saw it.

A model holds the detail that its photographs had. Seen from much nearer, or from inside, a Gaussian is larger
than what it stands for, and the view is blurred whatever is there.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fvs_engine.compilation.kernels import F, kernel
from fvs_engine.plan.distances import even_sample
from fvs_engine.plan.familiarity import MOST_DISTANCE_RATIO
from fvs_engine.score.estimate.cells import LEAST_CELL_PX, cover
from fvs_engine.score.estimate.splat_table import SplatTable
from fvs_engine.splat.conventions import CENTER_X, CENTER_Y, DEPTH, GREEN, RED
from fvs_engine.splat.gaussians import Gaussians
from fvs_engine.splat.raster.packed_view import PackedView
from fvs_engine.views import PinholeView

Floats = NDArray[np.float32]
Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

_CELLS = 24
"""Cells along the longer side of a view."""
_MOST_PHOTOGRAPHS = 500
"""Of more photographs an even share stands for all, which bounds the time of a model to about a second."""
_SOLID = np.float32(0.5)
"""Opacity from which a cell hides what is behind it."""
_BEHIND = 1.5
"""Depth of a point, in depths of its cell, up to which it is visible: cells are coarse."""
_BESIDE = F(0.1)
"""How far beside a frame, in shares of it, the centre of a Gaussian may be that is seen in it."""


@kernel
def nearest_photographs(means: Floats, photographs: Floats) -> Floats:
    """The distance [N] of each of ``means`` [3, N] from the nearest photograph that has it in its frame.

    ``photographs`` [M, 16]: a camera's rotation, translation, and least and most x / z and y / z. Infinite
    where no photograph has it in its frame.
    """
    nearest = np.full(means.shape[1], np.inf, np.float32)
    for m in range(photographs.shape[0]):
        r0, r1, r2, r3, r4, r5, r6, r7, r8, t0, t1, t2, left, right, top, bottom = photographs[m]
        for n in range(means.shape[1]):
            px, py, pz = means[0, n], means[1, n], means[2, n]
            x = r0 * px + r1 * py + r2 * pz + t0
            y = r3 * px + r4 * py + r5 * pz + t1
            z = r6 * px + r7 * py + r8 * pz + t2
            inside = (z > F(0)) & (x >= left * z) & (x <= right * z) & (y >= top * z) & (y <= bottom * z)
            square = x * x + y * y + z * z
            nearest[n] = min(nearest[n], square if inside else F(np.inf))
    return np.sqrt(nearest)


@dataclass(frozen=True, eq=False)
class Look:
    """What a view shows.

    ``near`` and ``covered`` are the shares of it, in [0, 1], that show Gaussians from nearer than photographs
    did, and any at all. ``depths`` [rows, columns] are those expected in its cells, infinite where most of a
    cell is empty.
    """

    view: PinholeView
    near: float
    covered: float
    depths: Floats

    def visible(self, points: Array) -> Mask:
        """Which of ``points`` [N, 3] in the frame of the view are not behind something."""
        camera = self.view.camera
        x, y, z = self.view.camera_from_model.apply(points).T
        rows, columns = self.depths.shape
        down = (camera.fy * y / z + camera.cy) / camera.height
        across = (camera.fx * x / z + camera.cx) / camera.width
        row = np.clip(rows * down, 0, rows - 1).astype(int)
        column = np.clip(columns * across, 0, columns - 1).astype(int)
        return np.asarray(z <= _BEHIND * self.depths[row, column])


@dataclass(frozen=True, eq=False)
class Nearness:
    """A model, and for every Gaussian the least distance from which it looks as its photographs saw it.

    In the table the distance takes the place of the colour red.
    """

    table: SplatTable

    @classmethod
    def of(cls, gaussians: Gaussians, photographs: Sequence[PinholeView]) -> "Nearness":
        """The distances at which the nearest of ``photographs`` saw the Gaussians, divided by 2."""
        table = SplatTable.of(gaussians)
        used = even_sample(len(photographs), _MOST_PHOTOGRAPHS)
        frames = np.array([_frame(photographs[index]) for index in used], np.float32).reshape(-1, 16)
        looks = np.zeros_like(table.looks)
        looks[:, 0] = table.looks[:, 0]
        looks[:, 1] = nearest_photographs(table.columns[:3], frames) / F(MOST_DISTANCE_RATIO)
        return cls(replace(table, looks=looks))

    def look(self, view: PinholeView) -> Look:
        """What ``view`` shows."""
        width = _CELLS * LEAST_CELL_PX
        scale = width / max(view.camera.width, view.camera.height)
        camera = view.camera.resized(
            max(1, round(scale * view.camera.width)), max(1, round(scale * view.camera.height))
        )
        splats = self.table.splats(PinholeView(view.name, camera, view.camera_from_model))
        across = (splats[:, CENTER_X] - F(camera.cx)) / F(camera.fx)
        down = (splats[:, CENTER_Y] - F(camera.cy)) / F(camera.fy)
        distances = splats[:, DEPTH] * np.sqrt(across**2 + down**2 + F(1))
        splats[:, RED] = distances < splats[:, RED]
        splats[:, GREEN] = splats[:, DEPTH]
        size = (camera.width, camera.height)
        cells = cover(splats, size, F(LEAST_CELL_PX), np.empty(len(splats), np.float32))
        opaque = 1.0 - cells[0]
        depths = np.where(opaque > _SOLID, cells[2] / np.maximum(opaque, _SOLID), np.inf)
        near, covered = (float(np.clip(cell.mean(dtype=np.float64), 0.0, 1.0)) for cell in (cells[1], opaque))
        return Look(view, near, covered, depths.astype(np.float32))


def _frame(view: PinholeView) -> Floats:
    """A photograph as ``nearest_photographs`` takes it."""
    camera, vector = view.camera, PackedView(view.camera, view.camera_from_model, 0).vector
    beside_x, beside_y = _BESIDE * camera.width, _BESIDE * camera.height
    frame = (
        (-beside_x - camera.cx) / camera.fx,
        (camera.width + beside_x - camera.cx) / camera.fx,
        (-beside_y - camera.cy) / camera.fy,
        (camera.height + beside_y - camera.cy) / camera.fy,
    )
    return np.concatenate([vector[:12], np.array(frame, np.float32)])
