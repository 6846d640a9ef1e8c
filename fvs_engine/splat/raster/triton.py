"""The Triton rasteriser: kernels of our own on a CUDA device. Deterministic; all cameras of a batch at once.

Under ``TRITON_INTERPRET=1`` the same kernels run in Triton's interpreter on the CPU, for tests.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor

from fvs_engine.geometry import PinholeCamera, RigidTransform
from fvs_engine.splat.conventions import CENTER_X
from fvs_engine.splat.gaussians import Gaussians
from fvs_engine.splat.raster.interface import GPU_BATCH_BYTES, Rendering, SquaredJacobian
from fvs_engine.splat.raster.packed_view import PackedView
from fvs_engine.splat.triton_kernels.binning import Hits, bin_hits
from fvs_engine.splat.triton_kernels.blending import blend
from fvs_engine.splat.triton_kernels.blending_backward import blend_backward
from fvs_engine.splat.triton_kernels.guard import StepGuard
from fvs_engine.splat.triton_kernels.projection import Projected, project
from fvs_engine.splat.triton_kernels.projection_backward import project_backward
from fvs_engine.splat.triton_kernels.squares import square
from fvs_engine.splat.triton_kernels.sums import sum_hits
from fvs_engine.views import PinholeView


class TritonRasterizer:
    """Triton kernels on a device (``cuda_device``), where the Gaussians must be; float32."""

    name = "triton"
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
        """See ``Rasterizer.render``. Waits for the device once, to learn how many hits there are."""
        return self._render(gaussians, (camera, camera_from_model), sh_degree, None)

    def render_guarded(
        self,
        gaussians: Gaussians,
        camera: PinholeCamera,
        camera_from_model: RigidTransform,
        guard: StepGuard,
        *,
        sh_degree: int | None = None,
    ) -> Rendering:
        """See ``GuardedRasterizer``."""
        return self._render(gaussians, (camera, camera_from_model), sh_degree, guard)

    def render_batch(
        self, gaussians: Gaussians, views: Sequence[PinholeView], *, sh_degree: int | None = None
    ) -> tuple[Tensor, Tensor]:
        """See ``BatchRasterizer``."""
        degree = gaussians.degree_in_use(sh_degree)
        cameras = _Cameras.of([(view.camera, view.camera_from_model) for view in views], degree, self.device)
        color, alpha, _ = _forward(gaussians, cameras, None, depth=False).images
        return color, alpha

    def squared_jacobian(
        self,
        gaussians: Gaussians,
        camera: PinholeCamera,
        camera_from_model: RigidTransform,
        *,
        sh_degree: int | None = None,
    ) -> SquaredJacobian:
        """See ``SquaringRasterizer``: exact, for about the price of a gradient."""
        degree = gaussians.degree_in_use(sh_degree)
        cameras = _Cameras.of([(camera, camera_from_model)], degree, self.device)
        forward = _forward(gaussians, cameras, None, depth=False)
        color, alpha, _ = forward.images
        means, log_scales, opacity_logits, sh_dc, sh_rest = square(
            gaussians, cameras.packed, cameras.size, degree, forward.projected, forward.hits, color
        )
        return SquaredJacobian(means, log_scales, opacity_logits, sh_dc, sh_rest, alpha[0])

    def _render(
        self,
        gaussians: Gaussians,
        view: tuple[PinholeCamera, RigidTransform],
        sh_degree: int | None,
        guard: StepGuard | None,
    ) -> Rendering:
        cameras = _Cameras.of([view], gaussians.degree_in_use(sh_degree), self.device)
        tensors = gaussians.tensors()
        if not (torch.is_grad_enabled() and any(t.requires_grad for t in tensors.values())):
            forward = _forward(gaussians, cameras, None, depth=True)
            color, alpha, depth = forward.images
            assert depth is not None
            return Rendering(color[0], alpha[0], depth[0], forward.projected.radii[0], None)
        # The projected centres exist only inside the kernels; this leaf receives their gradient.
        screen_means = torch.zeros((len(gaussians), 2), device=self.device, requires_grad=True)
        color, alpha, depth, radii = _Rasterize.apply(  # type: ignore[no-untyped-call]
            gaussians, cameras, guard, screen_means, *tensors.values()
        )
        return Rendering(color, alpha, depth, radii, screen_means)


@dataclass(frozen=True)
class _Cameras:
    """Cameras of one ``size`` (width, height) on the device, ``packed`` [C, 19] (``PackedView``)."""

    packed: Tensor
    size: tuple[int, int]
    degree: int

    @staticmethod
    def of(
        views: Sequence[tuple[PinholeCamera, RigidTransform]], degree: int, device: torch.device
    ) -> "_Cameras":
        each = [PackedView(camera, pose, degree) for camera, pose in views]
        packed = torch.from_numpy(np.stack([view.vector for view in each]))
        if device.type == "cuda":  # a copy from pageable memory would wait for the device
            packed = packed.pin_memory().to(device, non_blocking=True)
        return _Cameras(packed, each[0].size, degree)


@dataclass(frozen=True)
class _Forward:
    """Results of the forward pass that the backward pass needs."""

    projected: Projected
    hits: Hits
    images: tuple[Tensor, Tensor, Tensor | None]


def _forward(gaussians: Gaussians, cameras: _Cameras, guard: StepGuard | None, *, depth: bool) -> _Forward:
    """Render; the number of hits is waited for unless the ``guard`` knows how much room there is."""
    projected = project(gaussians, cameras.packed, cameras.size, cameras.degree)
    if guard is not None and guard.capacity is not None:
        hits = bin_hits(projected, cameras.size, guard.capacity, guard.words)
    else:
        hits = bin_hits(projected, cameras.size)
        if guard is not None:
            guard.make_room(hits.capacity)
    return _Forward(projected, hits, blend(projected, hits, cameras.size, depth=depth))


class _Rasterize(torch.autograd.Function):
    @staticmethod
    def forward(
        ctx: Any,
        gaussians: Gaussians,
        cameras: _Cameras,
        guard: StepGuard | None,
        screen_means: Tensor,  # noqa: ARG004 - only its gradient is used
        *parameters: Tensor,  # noqa: ARG004 - those of ``gaussians``: here for autograd
    ) -> tuple[Tensor, ...]:
        forward = _forward(gaussians, cameras, guard, depth=guard is None)
        color, alpha, depth = forward.images
        radii = forward.projected.radii[0]
        ctx.mark_non_differentiable(radii)
        ctx.set_materialize_grads(False)  # images that the loss does not use get None
        ctx.gaussians, ctx.cameras, ctx.forward = gaussians, cameras, forward
        return color[0], alpha[0], torch.zeros_like(alpha[0]) if depth is None else depth[0], radii

    @staticmethod
    def backward(ctx: Any, *image_gradients: Tensor | None) -> tuple[Tensor | None, ...]:
        forward, cameras, gaussians = ctx.forward, ctx.cameras, ctx.gaussians
        g_color, g_alpha, g_depth = (None if g is None else g.contiguous()[None] for g in image_gradients[:3])
        if g_color is None:
            g_color = torch.zeros_like(forward.images[0])
        rows = blend_backward(forward.projected, forward.hits, forward.images, (g_color, g_alpha, g_depth))
        gradients = sum_hits(rows, forward.hits)
        outputs = project_backward(
            gaussians, cameras.packed, cameras.size, cameras.degree, forward.projected, gradients
        )
        screen = gradients[0, :, CENTER_X : CENTER_X + 2].contiguous()
        return None, None, None, screen, *(outputs[name] for name in gaussians.tensors())
