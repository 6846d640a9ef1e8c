"""The data of a model that the estimate needs, prepared once for all views."""

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from fvs_engine.compilation.kernels import F
from fvs_engine.score.estimate.cells import LEAST_CELL_PX, MOST_CELLS, cover
from fvs_engine.score.estimate.powers import median_log_magnitude
from fvs_engine.score.estimate.projection import RECORD_SIZE, front_to_back, project
from fvs_engine.score.estimate.spectrum import expected_powers
from fvs_engine.splat.gaussians import Gaussians
from fvs_engine.splat.raster.cpu import PackedView
from fvs_engine.splat.raster.interface import ALPHA_MIN
from fvs_engine.splat.raster.reference_projection import rotation_matrices
from fvs_engine.splat.spherical_harmonics import SH_C0
from fvs_engine.views import PinholeView

Floats = NDArray[np.float32]


@dataclass(frozen=True)
class SplatTable:
    """The visible Gaussians of a model: ``columns`` [10, N] and ``looks`` [N, 4], see ``projection.project``.

    Colours are those of degree 0: the same from all directions.
    """

    columns: Floats
    looks: Floats

    @classmethod
    def of(cls, gaussians: Gaussians) -> "SplatTable":
        """The table of a model, on the CPU."""
        with torch.no_grad():
            model = gaussians.to("cpu")
            opacities = torch.sigmoid(model.opacity_logits)
            kept = opacities > ALPHA_MIN
            axes = rotation_matrices(model.quaternions_wxyz[kept]) * model.log_scales[kept].exp()[:, None, :]
            covariances = axes @ axes.transpose(1, 2)
            upper = torch.triu_indices(3, 3)
            opacities = opacities[kept, None]
            reaches = (2 * (opacities / ALPHA_MIN).log()).sqrt()
            columns = torch.cat([model.means[kept], covariances[:, upper[0], upper[1]], reaches], dim=1).T
            looks = torch.cat([opacities, (0.5 + SH_C0 * model.sh_dc[kept]).clamp_min(0)], dim=1)
        return cls(*(np.ascontiguousarray(values.numpy(), dtype=np.float32) for values in (columns, looks)))

    def splats(self, view: PinholeView) -> Floats:
        """The records of those that touch a view, front to back."""
        packed = PackedView(view.camera, view.camera_from_model, 0)
        records = np.empty((len(self.looks), RECORD_SIZE), np.float32)
        count = project(self.columns, self.looks, packed.vector, packed.size, records)
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
