"""The data of a model that the estimate needs, prepared once for all views."""

from dataclasses import dataclass

import numpy as np
import torch

from fvs_engine.score.estimate import kernels
from fvs_engine.score.estimate.kernels import CELL_PX, RECORD_SIZE, Floats
from fvs_engine.score.estimate.spectrum import powers
from fvs_engine.splat.gaussians import Gaussians
from fvs_engine.splat.raster.cpu import PackedView
from fvs_engine.splat.raster.interface import ALPHA_MIN
from fvs_engine.splat.raster.kernels import binning
from fvs_engine.splat.raster.reference_projection import rotation_matrices
from fvs_engine.splat.spherical_harmonics import SH_C0
from fvs_engine.views import PinholeView


@dataclass(frozen=True)
class SplatTable:
    """The visible Gaussians of a model: ``means`` [N, 3], ``covariances`` [N, 6], ``looks`` [N, 5].

    Covariances are xx, xy, xz, yy, yz, zz in the model frame; looks are the opacity, the reach in standard
    deviations and the colour, that of degree 0: the same from all directions.
    """

    means: Floats
    covariances: Floats
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
            reach = (2 * (opacities / ALPHA_MIN).log()).sqrt()
            colors = (0.5 + SH_C0 * model.sh_dc[kept]).clamp_min(0)
            looks = torch.cat([opacities, reach, colors], dim=1)
            columns = (model.means[kept], covariances[:, upper[0], upper[1]], looks)
        return cls(*(np.ascontiguousarray(values.numpy(), dtype=np.float32) for values in columns))

    def estimate(self, view: PinholeView) -> tuple[float, float]:
        """Estimate the median log-magnitude of a view's spectrum, and the share that the model covers."""
        packed = PackedView(view.camera, view.camera_from_model, 0)
        records = np.empty((len(self.means), RECORD_SIZE), np.float32)
        count = kernels.project(self.means, self.covariances, self.looks, packed.vector, packed.size, records)
        records = records[:count]
        order = binning.front_to_back(records, np.ones(count, np.float32))
        width, height = packed.size
        cells = np.empty((-(-height // CELL_PX), -(-width // CELL_PX), 4), np.float32)
        seen = np.empty(count, np.float32)
        kernels.cover(records, order, cells, seen)
        found = powers(records, order, cells, seen, packed.size)
        return kernels.median_log_magnitude(found.ravel()), _covered(cells[:, :, 3], width, height)


def _covered(transmittances: Floats, width: int, height: int) -> float:
    """The mean of 1 − transmittance over an image; the last cells may reach beyond it."""
    rows, columns = transmittances.shape
    heights = np.minimum(CELL_PX, height - CELL_PX * np.arange(rows))
    widths = np.minimum(CELL_PX, width - CELL_PX * np.arange(columns))
    return float(heights @ (1.0 - transmittances.astype(np.float64)) @ widths) / (width * height)
