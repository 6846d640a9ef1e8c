"""The data of a model that the estimate needs, prepared once for all views."""

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from fvs_engine.compilation.kernels import F
from fvs_engine.score.estimate.cells import LEAST_CELL_PX, MOST_CELLS, cover
from fvs_engine.score.estimate.powers import median_log_magnitude
from fvs_engine.score.estimate.projection import BLOCK, RECORD_SIZE, front_to_back, project
from fvs_engine.score.estimate.spectrum import expected_powers
from fvs_engine.splat.conventions import ALPHA_MIN
from fvs_engine.splat.gaussians import Gaussians
from fvs_engine.splat.raster.packed_view import PackedView
from fvs_engine.splat.raster.reference_projection import rotation_matrices
from fvs_engine.splat.spherical_harmonics import SH_C0
from fvs_engine.views import PinholeView

Floats = NDArray[np.float32]

_PLACE_BITS = 5
"""Of a place along one axis. Those of three fit into 16 bits, which numpy sorts in no time."""


@dataclass(frozen=True)
class SplatTable:
    """The visible Gaussians of a model: ``columns``, ``looks`` and ``bounds`` of ``projection.project``.

    Neighbours in the model are neighbours here. Colours are those of degree 0: the same from all directions.
    """

    columns: Floats
    looks: Floats
    bounds: Floats

    @classmethod
    def of(cls, gaussians: Gaussians) -> "SplatTable":
        """The table of a model, on the CPU."""
        with torch.no_grad():
            model = gaussians.to("cpu")
            opacities = torch.sigmoid(model.opacity_logits)
            kept = opacities > ALPHA_MIN
            scales = model.log_scales[kept].exp()
            axes = rotation_matrices(model.quaternions_wxyz[kept]) * scales[:, None, :]
            covariances = axes @ axes.transpose(1, 2)
            upper = torch.triu_indices(3, 3)
            opacities = opacities[kept, None]
            reaches = (2 * (opacities / ALPHA_MIN).log()).sqrt()
            colors = (0.5 + SH_C0 * model.sh_dc[kept]).clamp_min(0)
            lengths = reaches * scales.amax(dim=1, keepdim=True)
            parts = [
                model.means[kept],
                covariances[:, upper[0], upper[1]],
                reaches,
                opacities,
                colors,
                lengths,
            ]
            rows = torch.cat(parts, dim=1).to(torch.float32).numpy()
        rows = np.take(rows, _order_by_place(rows[:, :3]), axis=0)  # a tenth of the time of rows[order]
        return cls(
            columns=np.ascontiguousarray(rows[:, :10].T),
            looks=np.ascontiguousarray(rows[:, 10:14]),
            bounds=_bounds(rows[:, :3], rows[:, 14]),
        )

    def splats(self, view: PinholeView) -> Floats:
        """The records of those that touch a view, front to back."""
        packed = PackedView(view.camera, view.camera_from_model, 0)
        records = np.empty((len(self.looks), RECORD_SIZE), np.float32)
        count = project(self.columns, self.looks, self.bounds, packed.vector, packed.size, records)
        return front_to_back(records[:count])

    def estimate(self, view: PinholeView) -> tuple[float, float]:
        """Estimate the median log-magnitude of a view's spectrum, and the share that the model covers."""
        size = (view.camera.width, view.camera.height)
        side = _cell_side(*size)
        splats = self.splats(view)
        seen = np.empty(len(splats), np.float32)
        cells = cover(splats, size, side, seen)
        powers = expected_powers(splats, cells, side, seen, size)
        return median_log_magnitude(powers.ravel()), _covered(cells[0], side, size)


def _order_by_place(means: Floats) -> NDArray[np.int64]:
    """An order [N] in which points [N, 3] that are near one another are neighbours: a Morton curve.

    It runs over the points' ranks along the axes, so that far points do not take the others' places.
    """
    codes = np.zeros(len(means), np.uint16)
    places = (np.arange(len(means)) * (1 << _PLACE_BITS) // max(len(means), 1)).astype(np.uint16)
    place = np.empty_like(places)
    for axis in range(3):
        place[np.argsort(means[:, axis])] = places
        for bit in range(_PLACE_BITS):
            codes |= (place >> bit & 1) << (3 * bit + axis)
    return np.argsort(codes, kind="stable")


def _bounds(means: Floats, lengths: Floats) -> Floats:
    """The bounds [5, B] of blocks, see ``projection.project``: of means [N, 3] that reach ``lengths`` [N]."""
    if len(means) == 0:
        return np.empty((5, 0), np.float32)
    starts = np.arange(0, len(means), BLOCK)
    middles = (np.minimum.reduceat(means, starts) + np.maximum.reduceat(means, starts)) / 2
    distances = np.linalg.norm(means - np.repeat(middles, BLOCK, axis=0)[: len(means)], axis=1)
    greatest = (np.maximum.reduceat(values, starts) for values in (distances, lengths))
    return np.stack([*middles.T, *greatest])


def _cell_side(width: int, height: int) -> float:
    """The side of the cells of an image, in px."""
    return F(max(LEAST_CELL_PX, max(width, height) / MOST_CELLS))


def _covered(transmittances: Floats, side: float, size: tuple[int, int]) -> float:
    """The mean of 1 − transmittance over an image; the last cells may reach beyond it."""
    widths, heights = (
        np.clip(length - side * np.arange(count), 0, side)
        for length, count in zip(size, reversed(transmittances.shape), strict=True)
    )
    return float(heights @ (1.0 - transmittances.astype(np.float64)) @ widths) / (size[0] * size[1])
