"""Adam and the statistics of densification, in place, one launch each; they do nothing when the guard is set.

Per number that moves, 16 bytes are read (parameter, gradient, moments) and 12 written: 392 per Gaussian for
its 14 numbers that always move, and 1,260 for 15 harmonics where it was seen. The statistics read 20 bytes
per Gaussian (24 more where gradients are columns of rows of ten) and write 8.
"""

import triton
import triton.language as tl
from torch import Tensor

_BLOCK = 1024
_WARPS = 4


@triton.jit(do_not_specialize=["count", "columns"])
def adam(
    parameter, gradient, first, second, radii, guard, count, columns,
    step_size, root_correction, rest_first, rest_second, epsilon,
    WIDTH: tl.constexpr, SPARSE: tl.constexpr, BLOCK: tl.constexpr,
):  # fmt: skip
    """Step with ``count`` numbers; where ``SPARSE``, with ``columns`` of the visible rows of ``WIDTH``."""
    if tl.load(guard) == 0:
        start = tl.program_id(0).to(tl.int64) * BLOCK
        i = start + tl.arange(0, BLOCK)
        moved = i < count
        if SPARSE:
            first_row = start // WIDTH
            within = (start - first_row * WIDTH).to(tl.int32) + tl.arange(0, BLOCK)
            moved &= within % WIDTH < columns
            moved &= tl.load(radii + first_row + within // WIDTH, mask=moved, other=0.0) > 0
        g = tl.load(gradient + i, mask=moved, other=0.0)
        m = tl.load(first + i, mask=moved, other=0.0)
        v = tl.load(second + i, mask=moved, other=0.0)
        p = tl.load(parameter + i, mask=moved, other=0.0)
        m += rest_first * (g - m)
        v += rest_second * (g * g - v)
        p -= tl.div_rn(step_size * m, tl.sqrt_rn(v) * root_correction + epsilon)
        tl.store(first + i, m, mask=moved)
        tl.store(second + i, v, mask=moved)
        tl.store(parameter + i, p, mask=moved)


@triton.jit(do_not_specialize=["count", "stride"])
def gradient_norms(
    gradients, radii, total, views, guard, count, stride, half_width, half_height, BLOCK: tl.constexpr
):
    """Add the norms of the visible Gaussians' screen gradients, and 1 to their views."""
    if tl.load(guard) == 0:
        i = tl.program_id(0).to(tl.int64) * BLOCK + tl.arange(0, BLOCK)
        inside = i < count
        seen = inside & (tl.load(radii + i, mask=inside, other=0.0) > 0)
        gx = tl.load(gradients + i * stride, mask=seen, other=0.0) * half_width
        gy = tl.load(gradients + i * stride + 1, mask=seen, other=0.0) * half_height
        norm = tl.sqrt_rn(gx * gx + gy * gy)
        tl.store(total + i, tl.load(total + i, mask=seen, other=0.0) + norm, mask=seen)
        tl.store(views + i, tl.load(views + i, mask=seen, other=0.0) + 1, mask=seen)


def adam_step(
    tensors: tuple[Tensor, Tensor, Tensor, Tensor],
    guard: Tensor,
    *,
    step_size: float,
    corrections: tuple[float, float],
    betas: tuple[float, float],
    epsilon: float,
    radii: Tensor | None = None,
    columns: int | None = None,
) -> None:
    """Move one parameter along its gradient: ``tensors`` are these and the two moments, [N, …], contiguous.

    ``corrections`` are those of the moments' bias. With ``radii`` [N] only the rows where these are > 0 move,
    and of them the first ``columns`` numbers (None: all).
    """
    parameter, gradient, first, second = (tensor.detach() for tensor in tensors)
    if parameter.numel() == 0:
        return
    width = parameter[0].numel()
    adam[(triton.cdiv(parameter.numel(), _BLOCK),)](
        parameter,
        gradient.contiguous(),
        first,
        second,
        guard if radii is None else radii,
        guard,
        parameter.numel(),
        width if columns is None else columns,
        step_size / corrections[0],
        corrections[1] ** -0.5,
        1 - betas[0],
        1 - betas[1],
        epsilon,
        WIDTH=width if radii is not None else 1,
        SPARSE=radii is not None,
        BLOCK=_BLOCK,
        num_warps=_WARPS,
    )


def add_gradients(
    gradients: Tensor, radii: Tensor, size: tuple[int, int], total: Tensor, views: Tensor, guard: Tensor
) -> None:
    """Count one backward pass: add ‖∂loss/∂centre‖ in normalised device coordinates, and a view, where seen.

    ``gradients`` [N, ≥ 2] by the centre in px: the first two columns of rows, contiguous or not; ``radii``,
    ``total``, ``views`` [N]; ``size``: the image's width and height.
    """
    if len(radii) == 0:
        return
    gradient_norms[(triton.cdiv(len(radii), _BLOCK),)](
        gradients,
        radii.detach(),
        total,
        views,
        guard,
        len(radii),
        gradients.stride(0),
        size[0] / 2,
        size[1] / 2,
        BLOCK=_BLOCK,
        num_warps=_WARPS,
    )
