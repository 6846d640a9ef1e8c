"""The CPU rasteriser: Numba kernels behind torch's autograd. Deterministic for any number of threads."""

from dataclasses import dataclass
from typing import Any

import numba
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from fvs_engine.compilation.ahead import ensure_compiled
from fvs_engine.geometry import PinholeCamera, RigidTransform
from fvs_engine.monitor import Monitor
from fvs_engine.splat.conventions import CENTER_X, GRADIENT_SIZE, RECORD_SIZE
from fvs_engine.splat.gaussians import Gaussians
from fvs_engine.splat.raster.interface import Rendering, SquaredJacobian
from fvs_engine.splat.raster.kernels import binning, blending, drawing, projection, squares
from fvs_engine.splat.raster.packed_view import PackedView

Floats = NDArray[np.float32]

WARM_UP = "fvs_engine.splat.warm_up"

# Tiles differ widely in cost: threads take a few at a time instead of an equal share of the image.
TILES_AT_ONCE = 4
# So do the splats in depth order.
PARTS_PER_THREAD = 4


class CpuRasterizer:
    """Numba kernels, forward and backward; float32."""

    name = "cpu"
    steps_on_device = False
    batch_bytes = 0
    device = torch.device("cpu")

    def __init__(self, monitor: Monitor | None = None) -> None:
        """Compile the kernels that are not cached; ``monitor`` gets stage ``compile``."""
        ensure_compiled(WARM_UP, blending.blend, monitor)

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
        tensors = gaussians.tensors()
        view = PackedView(camera, camera_from_model, degree)
        if not (torch.is_grad_enabled() and any(t.requires_grad for t in tensors.values())):
            drawn = draw(view, [as_floats(t) for t in tensors.values()])
            color, alpha, depth, radii = (torch.from_numpy(values) for values in drawn)
            return Rendering(color, alpha, depth, radii, None)
        # The projected centres exist only inside the kernels; this leaf receives their gradient.
        screen_means = torch.zeros((len(gaussians), 2), requires_grad=True)
        color, alpha, depth, radii = _Rasterize.apply(  # type: ignore[no-untyped-call]
            view, screen_means, *tensors.values()
        )
        return Rendering(color, alpha, depth, radii, screen_means)

    def squared_jacobian(
        self,
        gaussians: Gaussians,
        camera: PinholeCamera,
        camera_from_model: RigidTransform,
        *,
        sh_degree: int | None = None,
    ) -> SquaredJacobian:
        """See ``SquaringRasterizer``: exact, for about the price of a gradient (``kernels.squares``)."""
        degree = gaussians.degree_in_use(sh_degree)
        view = PackedView(camera, camera_from_model, degree)
        parameters = [as_floats(tensor) for tensor in gaussians.tensors().values()]
        forward = rasterize(view, parameters)
        found = (*square(forward, view, parameters), forward.alpha)
        return SquaredJacobian(*(torch.from_numpy(values) for values in found))


@dataclass
class Forward:
    """Results of the forward pass that the backward pass needs."""

    records: Floats
    radii: Floats
    order: NDArray[np.int64]
    splats: Floats
    tile_starts: NDArray[np.int64]
    hit_splats: NDArray[np.int32]
    hit_rows: NDArray[np.uint8]
    hit_numbers: NDArray[np.int32]
    splat_starts: NDArray[np.int64]
    color: Floats
    alpha: Floats
    depth: Floats


def as_floats(tensor: Tensor) -> Floats:
    """The tensor's values as contiguous float32 numpy, without a copy where possible."""
    return np.ascontiguousarray(tensor.detach().numpy(), dtype=np.float32)


def rasterize(view: PackedView, parameters: list[Floats]) -> Forward:
    """Project, bin and blend; ``parameters`` are those of ``Gaussians.tensors``, in that order."""
    records, radii = _project(view, parameters)
    order = binning.front_to_back(records, radii)
    splats = binning.gather(records, order)
    with numba.parallel_chunksize(1):
        tile_starts, hit_splats, hit_rows, hit_numbers, splat_starts = binning.bin_splats(
            splats, *view.tiles(binning.TILE_PX), PARTS_PER_THREAD * numba.get_num_threads()
        )
    color, alpha, depth = _images(view)
    with numba.parallel_chunksize(TILES_AT_ONCE):
        blending.blend(splats, tile_starts, hit_splats, hit_rows, color, alpha, depth)
    return Forward(
        records, radii, order, splats, tile_starts, hit_splats, hit_rows, hit_numbers, splat_starts,
        color, alpha, depth,
    )  # fmt: skip


def draw(view: PackedView, parameters: list[Floats]) -> tuple[Floats, ...]:
    """What ``rasterize`` renders, up to rounding, faster: color, alpha, depth and radii."""
    records, radii = _project(view, parameters)
    splats = binning.gather(records, binning.front_to_back(records, radii))
    with numba.parallel_chunksize(1):
        tile_starts, hits = drawing.deal(
            splats, *view.tiles(drawing.SIDE_PX), PARTS_PER_THREAD * numba.get_num_threads()
        )
        images = _images(view)
        drawing.draw(splats, tile_starts, hits, *images)
    return *images, radii


def _project(view: PackedView, parameters: list[Floats]) -> tuple[Floats, Floats]:
    """The records [N, 16] and radii [N] of all Gaussians."""
    means, log_scales, quaternions, opacity_logits, sh_dc, sh_rest = parameters
    records = np.empty((len(means), RECORD_SIZE), np.float32)
    radii = np.empty(len(means), np.float32)
    projection.project(
        means, log_scales, quaternions, opacity_logits, sh_dc, sh_rest,
        view.degree, view.vector, view.size, records, radii,
    )  # fmt: skip
    return records, radii


def _images(view: PackedView) -> tuple[Floats, Floats, Floats]:
    """Uninitialised color [H, W, 3], alpha [H, W] and depth [H, W] of a view."""
    width, height = view.size
    alpha, depth = np.empty((height, width), np.float32), np.empty((height, width), np.float32)
    return np.empty((height, width, 3), np.float32), alpha, depth


def differentiate(
    forward: Forward, view: PackedView, parameters: list[Floats], image_gradients: list[Floats | None]
) -> tuple[Floats, list[Floats]]:
    """Gradients of the projected centres [N, 2] and of the parameters."""
    means, log_scales, quaternions, _, _, sh_rest = parameters
    g_color, g_alpha, g_depth = image_gradients
    g_color = np.zeros_like(forward.color) if g_color is None else g_color
    g_alpha = np.zeros_like(forward.alpha) if g_alpha is None else g_alpha
    hit_gradients = np.empty((len(forward.hit_splats), GRADIENT_SIZE), np.float32)
    with numba.parallel_chunksize(TILES_AT_ONCE):
        blending.blend_backward(
            forward.splats, forward.tile_starts, forward.hit_splats, forward.hit_rows, forward.hit_numbers,
            forward.color, forward.alpha, forward.depth,
            g_color, g_alpha, g_depth, hit_gradients,
        )  # fmt: skip
    gradients = np.zeros((len(means), GRADIENT_SIZE), np.float32)
    blending.sum_hits(hit_gradients, forward.splat_starts, forward.order, gradients)
    outputs = [np.empty_like(parameter) for parameter in parameters]
    projection.project_backward(
        means, log_scales, quaternions, sh_rest, view.degree, view.vector, view.size,
        forward.records, forward.radii, gradients, *outputs,
    )  # fmt: skip
    return gradients[:, CENTER_X : CENTER_X + 2], outputs


def square(forward: Forward, view: PackedView, parameters: list[Floats]) -> tuple[Floats, ...]:
    """The squared Jacobian of an image on black, in the order of ``SquaredJacobian``."""
    means, log_scales, quaternions, opacity_logits, sh_dc, sh_rest = parameters
    count = len(means)
    hit_squares = np.empty((len(forward.hit_splats), squares.SQUARES_SIZE), np.float32)
    with numba.parallel_chunksize(TILES_AT_ONCE):
        squares.blend_squares(
            forward.splats, forward.tile_starts, forward.hit_splats, forward.hit_rows, forward.hit_numbers,
            forward.color, hit_squares,
        )  # fmt: skip
    moments = np.zeros((count, squares.SQUARES_SIZE), np.float32)
    squares.sum_squares(hit_squares, forward.splat_starts, forward.order, moments)

    # The projection carries gradients of records to parameters, and is linear: once for every monomial.
    slopes = np.empty((len(squares.MONOMIALS), count, 6), np.float32)
    gradients = np.zeros((count, GRADIENT_SIZE), np.float32)
    g_means, g_log_scales = np.empty((count, 3), np.float32), np.empty((count, 3), np.float32)
    g_quaternions, g_opacities = np.empty((count, 4), np.float32), np.empty(count, np.float32)
    g_dc, no_rest = np.empty((count, 3), np.float32), np.empty((count, 0, 3), np.float32)
    for monomial, slope in zip(squares.MONOMIALS, slopes, strict=True):
        squares.fill_gradients(forward.records, forward.radii, monomial, gradients)
        projection.project_backward(
            means, log_scales, quaternions, no_rest, 0, view.vector, view.size,
            forward.records, forward.radii, gradients,
            g_means, g_log_scales, g_quaternions, g_opacities, g_dc, no_rest,
        )  # fmt: skip
        slope[:, :3], slope[:, 3:] = g_means, g_log_scales
    of_means, of_log_scales = np.empty((count, 3), np.float32), np.empty((count, 3), np.float32)
    squares.combine(moments, slopes, of_means, of_log_scales)
    of_opacities, of_dc = np.empty_like(opacity_logits), np.empty_like(sh_dc)
    of_rest = np.zeros_like(sh_rest)
    squares.square_appearance(
        means, view.vector, view.degree, forward.records, forward.radii, moments, of_opacities, of_dc, of_rest
    )
    return of_means, of_log_scales, of_opacities, of_dc, of_rest


class _Rasterize(torch.autograd.Function):
    @staticmethod
    def forward(
        ctx: Any,
        view: PackedView,
        screen_means: Tensor | None,  # noqa: ARG004 - only its gradient is used
        *parameters: Tensor,
    ) -> tuple[Tensor, ...]:
        forward = rasterize(view, [as_floats(p) for p in parameters])
        radii = torch.from_numpy(forward.radii)
        ctx.mark_non_differentiable(radii)
        ctx.set_materialize_grads(False)  # images that the loss does not use get None
        ctx.save_for_backward(*parameters)
        ctx.view, ctx.forward = view, forward
        images = (torch.from_numpy(image) for image in (forward.color, forward.alpha, forward.depth))
        return *images, radii

    @staticmethod
    def backward(ctx: Any, *image_gradients: Tensor | None) -> tuple[Tensor | None, ...]:
        parameters = [as_floats(p) for p in ctx.saved_tensors]
        gradients = [None if g is None else as_floats(g) for g in image_gradients[:3]]
        screen, outputs = differentiate(ctx.forward, ctx.view, parameters, gradients)
        return None, torch.from_numpy(screen.copy()), *(torch.from_numpy(o) for o in outputs)
