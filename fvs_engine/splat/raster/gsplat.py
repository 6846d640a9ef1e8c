"""The rasteriser gsplat (https://github.com/nerfstudio-project/gsplat), in its classic mode, on CUDA devices.

gsplat would compile its kernels at the first use, for minutes, and a second process that starts meanwhile
deletes what the first has compiled. So only kernels that were compiled with the package are used.
"""

from collections.abc import Mapping

import numpy as np
import torch
from torch import Tensor

from fvs_engine.errors import BackendUnavailableError
from fvs_engine.geometry import PinholeCamera, RigidTransform
from fvs_engine.splat.conventions import ALPHA_MIN, BLUR_PX2, NEAR_PLANE
from fvs_engine.splat.gaussians import Gaussians
from fvs_engine.splat.raster.interface import GPU_BATCH_BYTES, Rendering
from fvs_engine.splat.spherical_harmonics import sh_colors

try:
    import gsplat
    import gsplat.csrc
except ImportError as error:
    missing = isinstance(error, ModuleNotFoundError)
    found = "is not installed with its kernels compiled" if missing else f"cannot load its kernels: {error}"
    raise BackendUnavailableError(
        f"gsplat {found}.",
        hint="docs/operate/gpu.md shows how to compile them for this PyTorch; or use the backend 'cpu'.",
    ) from error


class GsplatRasterizer:
    """gsplat on a CUDA device, where the Gaussians must be."""

    name = "gsplat"
    steps_on_device = True

    def __init__(self, device: torch.device) -> None:
        self.device = device
        self.batch_bytes = GPU_BATCH_BYTES

    def render(
        self,
        gaussians: Gaussians,
        camera: PinholeCamera,
        camera_from_model: RigidTransform,
        *,
        sh_degree: int | None = None,
    ) -> Rendering:
        """See ``Rasterizer.render``."""
        degree = gaussians.degree_in_use(sh_degree)
        means = gaussians.means
        view, intrinsics, centre = _on_device(camera, camera_from_model, means)
        # Given coefficients, gsplat wants a copy of all, and waits for the inverse of the view.
        directions = torch.nn.functional.normalize(means - centre, dim=-1)
        images, alphas, meta = gsplat.rasterization(
            means,
            gaussians.quaternions_wxyz,
            gaussians.log_scales.exp(),
            torch.sigmoid(gaussians.opacity_logits),
            sh_colors(gaussians.sh_dc, gaussians.sh_rest, directions, degree),
            view[None],
            intrinsics[None],
            camera.width,
            camera.height,
            near_plane=NEAR_PLANE,
            eps2d=BLUR_PX2,
            packed=False,
            render_mode="RGB+D",
        )
        screen_means = meta["means2d"]
        if screen_means.requires_grad:
            screen_means.retain_grad()
        color, alpha, depth = images[0, ..., :3], alphas[0, ..., 0], images[0, ..., 3]
        # gsplat's centres carry a leading camera axis; its gradient is read through the same view.
        return Rendering(
            color,
            alpha,
            depth,
            _radii_px(meta, camera),
            _ScreenMeans(screen_means) if screen_means.requires_grad else None,
        )


def _on_device(
    camera: PinholeCamera, camera_from_model: RigidTransform, like: Tensor
) -> tuple[Tensor, Tensor, Tensor]:
    """camera_from_model [4, 4], intrinsics [3, 3] and the camera's centre [3], as ``like``.

    In one copy from pinned memory: one from pageable memory would wait for the device.
    """
    view = np.eye(4)
    view[:3, :3], view[:3, 3] = camera_from_model.rotation, camera_from_model.translation
    centre = camera_from_model.inverse().translation
    numbers = torch.from_numpy(np.concatenate([view.ravel(), camera.matrix.ravel(), centre])).to(like.dtype)
    if like.is_cuda:
        numbers = numbers.pin_memory().to(like.device, non_blocking=True)
    return numbers[:16].view(4, 4), numbers[16:25].view(3, 3), numbers[25:]


@torch.no_grad()
def _radii_px(meta: Mapping[str, Tensor], camera: PinholeCamera) -> Tensor:
    """Half the longer side of every screen box [N], 0 where it is culled: ``Rendering.radii_px``.

    gsplat rounds the half sides up to whole pixels before it culls. A Gaussian that ends less than a pixel
    outside the image then counts as seen, with a gradient of zero: its mean gradient falls, and
    densification passes it over. So the box is computed again from gsplat's own ellipse, unrounded.
    """
    a, b, c = meta["conics"][0].unbind(-1)
    opacities = meta["opacities"][0]
    reach = (2 * (opacities / ALPHA_MIN).log().clamp_min(0)).sqrt()
    half_sides = reach[:, None] * (torch.stack([c, a], dim=-1) / (a * c - b * b)[:, None]).sqrt()
    centers = meta["means2d"][0]
    # A tensor of both sides would be copied to the device, and the host would wait for it.
    first, last = centers - half_sides, centers + half_sides
    on_screen = (last > 0).all(-1) & (first[:, 0] < camera.width) & (first[:, 1] < camera.height)
    radii = meta["radii"][0]
    seen = (radii > 0).all(-1) & on_screen & (opacities >= ALPHA_MIN)
    return torch.where(seen, half_sides.amax(-1), half_sides.new_zeros(()))


class _ScreenMeans:
    """The projected centres of the one camera, whose ``grad`` is [N, 2] as the interface requires."""

    def __init__(self, batched: Tensor) -> None:
        self._batched = batched

    @property
    def grad(self) -> Tensor | None:
        """The gradient [N, 2] after a backward pass."""
        return None if self._batched.grad is None else self._batched.grad[0]
