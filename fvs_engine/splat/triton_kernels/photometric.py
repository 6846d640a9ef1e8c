"""The photometric loss and its gradient: what ``loss_kernels`` computes on the CPU, on the GPU.

An image is rows of 3 W floats (lanes): a horizontal tap is 3 lanes away. A program marches down ``_ROWS``
rows of ``_LANES`` lanes. Every row is blurred across by reading its neighbours, and added to the sums of the
ten rows whose 11-row windows it belongs to, which stay in registers: a vertical tap reads nothing. The first
kernel writes the three derivatives of SSIM, the second blurs these and chains them to the rendering.

Per pixel 15 bytes are read and 36 written, then 51 read and 12 written: 114, and 8 more with a mask. Programs
above and beside one another read the same rows and lanes: 31 % and 23 % more, out of the caches.
"""

import torch
import triton
import triton.language as tl
from torch import Tensor

from fvs_engine.splat import loss_kernels
from fvs_engine.splat.triton_kernels.guard import HALTED_NOT_FINITE

C1 = tl.constexpr(loss_kernels.C1)
C2 = tl.constexpr(loss_kernels.C2)
TAPS = tl.constexpr(loss_kernels.TAPS)
REACH = tl.constexpr(loss_kernels.REACH)
NOT_FINITE = tl.constexpr(HALTED_NOT_FINITE)
BYTE = tl.constexpr(1 / 255)
WINDOW = tl.constexpr(tuple(float(tap) for tap in loss_kernels.gaussian_window()))

_LANES = 128
_ROWS = 32
_WARPS = 4
_SUMS = 1024


@triton.jit
def _no_rows(zero):
    return zero, zero, zero, zero, zero, zero, zero, zero, zero, zero


@triton.jit
def _advance(sums, row):
    """Add a row to the window of the row ``REACH`` above, now whole, and to the next ten; drop the former."""
    s0, s1, s2, s3, s4, s5, s6, s7, s8, s9 = sums
    whole = s0 + WINDOW[0] * row
    return whole, (
        s1 + WINDOW[1] * row,
        s2 + WINDOW[2] * row,
        s3 + WINDOW[3] * row,
        s4 + WINDOW[4] * row,
        s5 + WINDOW[5] * row,
        s6 + WINDOW[4] * row,
        s7 + WINDOW[3] * row,
        s8 + WINDOW[2] * row,
        s9 + WINDOW[1] * row,
        WINDOW[0] * row,
    )


@triton.jit
def _load(x_row, y_row, mask_row, lane, present, MASKED: tl.constexpr):
    """The rendering, black where the mask is 0, and the photograph; both 0 outside of the image."""
    inside = (lane >= 0) & (lane < present)
    x = tl.load(x_row + lane, mask=inside, other=0.0)
    y = tl.load(y_row + lane, mask=inside, other=0).to(tl.float32) * BYTE
    if MASKED:
        x *= tl.load(mask_row + lane // 3, mask=inside, other=0.0)
    return x, y


@triton.jit
def _pair(source, lane, distance, present):
    """The sum of two neighbours: as many roundings of a blur less, and of its multiplications."""
    before = tl.load(source - distance, mask=(lane >= distance) & (lane < present + distance), other=0.0)
    return before + tl.load(source + distance, mask=lane < present - distance, other=0.0)


@triton.jit(do_not_specialize=["height", "row_lanes"])
def ssim_rows(
    color, target, mask, height, row_lanes, derivatives, sums,
    MASKED: tl.constexpr, LANES: tl.constexpr, ROWS: tl.constexpr,
):  # fmt: skip
    """Write the derivatives of SSIM [3, H, 3 W], and Σ SSIM of each program to ``sums`` [programs, 2]."""
    lane = tl.program_id(0) * LANES + tl.arange(0, LANES)
    top = tl.program_id(1) * ROWS
    rows = tl.minimum(ROWS, height - top)
    pitch = row_lanes.to(tl.int64)
    width = pitch // 3
    plane = height * pitch
    zero = tl.zeros([LANES], tl.float32)
    us, vs, squares, products = _no_rows(zero), _no_rows(zero), _no_rows(zero), _no_rows(zero)
    total = zero
    for step in range(rows + 2 * REACH):
        row = top - REACH + step
        present = tl.where((row >= 0) & (row < height), row_lanes, 0)
        x_row, y_row, mask_row = color + row * pitch, target + row * pitch, mask + row * width
        x, y = _load(x_row, y_row, mask_row, lane, present, MASKED)
        u_row, v_row = WINDOW[REACH] * x, WINDOW[REACH] * y
        square_row, product_row = WINDOW[REACH] * (x * x + y * y), WINDOW[REACH] * (x * y)
        for i in tl.static_range(REACH):
            x, y = _load(x_row, y_row, mask_row, lane - 3 * (REACH - i), present, MASKED)
            x2, y2 = _load(x_row, y_row, mask_row, lane + 3 * (REACH - i), present, MASKED)
            u_row += WINDOW[i] * (x + x2)
            v_row += WINDOW[i] * (y + y2)
            square_row += WINDOW[i] * ((x * x + y * y) + (x2 * x2 + y2 * y2))
            product_row += WINDOW[i] * (x * y + x2 * y2)
        u, us = _advance(us, u_row)
        v, vs = _advance(vs, v_row)
        square, squares = _advance(squares, square_row)
        product, products = _advance(products, product_row)
        uv = u * v
        uu_vv = u * u + v * v
        a1 = 2 * uv + C1
        a2 = 2 * (product - uv) + C2
        b1 = uu_vv + C1
        b2 = square - uu_vv + C2
        inverse = 1 / (b1 * b2)
        ssim = a1 * a2 * inverse
        done = row - REACH
        stored = lane < tl.where(done >= top, row_lanes, 0)
        out = derivatives + done * pitch + lane
        tl.store(out, 2 * inverse * (v * (a2 - a1) - u * ssim * (b2 - b1)), mask=stored)
        tl.store(out + plane, -ssim * b1 * inverse, mask=stored)
        tl.store(out + 2 * plane, 2 * a1 * inverse, mask=stored)
        total += tl.where(stored, ssim, 0.0)
    tl.store(sums + 2 * (tl.program_id(1) * tl.num_programs(0) + tl.program_id(0)), tl.sum(total))


@triton.jit(do_not_specialize=["height", "row_lanes"])
def gradient_rows(
    color, target, mask, height, row_lanes, derivatives, l1_weight, ssim_weight, gradient, sums,
    MASKED: tl.constexpr, LANES: tl.constexpr, ROWS: tl.constexpr,
):  # fmt: skip
    """Blur the derivatives and chain them to the rendering; Σ |x − y| of each program to ``sums``.

    The gradient [H, 3 W] is l1_weight · sign(x − y) − ssim_weight · ∂ΣSSIM/∂x.
    """
    lane = tl.program_id(0) * LANES + tl.arange(0, LANES)
    top = tl.program_id(1) * ROWS
    rows = tl.minimum(ROWS, height - top)
    pitch = row_lanes.to(tl.int64)
    width = pitch // 3
    plane = height * pitch
    zero = tl.zeros([LANES], tl.float32)
    means, squares, products = _no_rows(zero), _no_rows(zero), _no_rows(zero)
    total = zero
    for step in range(rows + 2 * REACH):
        row = top - REACH + step
        present = tl.where((row >= 0) & (row < height), row_lanes, 0)
        source = derivatives + row * pitch + lane
        inside = lane < present
        mean_row = WINDOW[REACH] * tl.load(source, mask=inside, other=0.0)
        square_row = WINDOW[REACH] * tl.load(source + plane, mask=inside, other=0.0)
        product_row = WINDOW[REACH] * tl.load(source + 2 * plane, mask=inside, other=0.0)
        for i in tl.static_range(REACH):
            mean_row += WINDOW[i] * _pair(source, lane, 3 * (REACH - i), present)
            square_row += WINDOW[i] * _pair(source + plane, lane, 3 * (REACH - i), present)
            product_row += WINDOW[i] * _pair(source + 2 * plane, lane, 3 * (REACH - i), present)
        by_mean, means = _advance(means, mean_row)
        by_square, squares = _advance(squares, square_row)
        by_product, products = _advance(products, product_row)
        done = row - REACH
        stored = lane < tl.where(done >= top, row_lanes, 0)
        x_row, y_row, mask_row = color + done * pitch, target + done * pitch, mask + done * width
        x, y = _load(x_row, y_row, mask_row, lane, tl.where(done >= top, row_lanes, 0), MASKED)
        difference = x - y
        sign = tl.where(difference > 0, l1_weight, tl.where(difference < 0, -l1_weight, 0.0))
        slope = sign - ssim_weight * (by_mean + 2 * x * by_square + y * by_product)
        if MASKED:
            slope *= tl.load(mask_row + lane // 3, mask=stored, other=0.0)
        tl.store(gradient + done * pitch + lane, slope, mask=stored)
        total += tl.abs(difference)
    tl.store(sums + 2 * (tl.program_id(1) * tl.num_programs(0) + tl.program_id(0)) + 1, tl.sum(total))


@triton.jit(do_not_specialize=["count"])
def loss_of_sums(
    sums, count, l1_weight, ssim_weight, ssim_offset, loss, guard, GUARDED: tl.constexpr, SUMS: tl.constexpr
):
    """The loss of the programs' sums [count, 2] of SSIM and of L1, in a fixed order; one program."""
    l1, ssim = tl.zeros([SUMS], tl.float32), tl.zeros([SUMS], tl.float32)
    for start in range(0, count, SUMS):
        index = start + tl.arange(0, SUMS)
        ssim += tl.load(sums + 2 * index, mask=index < count, other=0.0)
        l1 += tl.load(sums + 2 * index + 1, mask=index < count, other=0.0)
    value = l1_weight * tl.sum(l1) + (ssim_offset - ssim_weight * tl.sum(ssim))
    tl.store(loss, value)
    if GUARDED:
        halted = tl.load(guard)
        finite = tl.abs(value) < float("inf")
        tl.store(guard, tl.where(finite | (halted != 0), halted, NOT_FINITE))


def photometric(
    color: Tensor,
    target: Tensor,
    ssim_weight: float,
    mask: Tensor | None = None,
    guard: Tensor | None = None,
) -> tuple[Tensor, Tensor]:
    """The loss between a rendering and a photograph [], and its gradient in the rendering [H, W, 3].

    ``color`` [H, W, 3] float32, not clamped; ``target`` [H, W, 3] uint8. ``mask`` [H, W, 1] float32: the
    rendering is multiplied by it. A ``guard`` is set where the loss is not finite. Waits for nothing.
    """
    height, width, _ = color.shape
    color, target = color.detach().contiguous(), target.contiguous()
    size, row_lanes = color.numel(), 3 * width
    grid = (triton.cdiv(row_lanes, _LANES), triton.cdiv(height, _ROWS))
    sums = color.new_empty((grid[0] * grid[1], 2))
    derivatives = color.new_empty((3, height, row_lanes))
    gradient = torch.empty_like(color)
    loss = color.new_empty(())
    masks = color if mask is None else mask.contiguous()
    meta = {"MASKED": mask is not None, "LANES": _LANES, "ROWS": _ROWS, "num_warps": _WARPS}
    l1_share, ssim_share = (1 - ssim_weight) / size, ssim_weight / size
    ssim_rows[grid](color, target, masks, height, row_lanes, derivatives, sums, **meta)
    gradient_rows[grid](
        color, target, masks, height, row_lanes, derivatives, l1_share, ssim_share, gradient, sums, **meta
    )
    loss_of_sums[(1,)](
        sums,
        len(sums),
        l1_share,
        ssim_share,
        float(ssim_weight),
        loss,
        sums if guard is None else guard,
        GUARDED=guard is not None,
        SUMS=_SUMS,
        num_warps=_WARPS,
    )
    return loss, gradient
