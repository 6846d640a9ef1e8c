"""The photometric loss and its gradient on the CPU, in one pass over the image.

What ``losses.photometric_loss_torch`` computes with eight convolutions over whole images, this computes row
by row: the rows that an 11-row window needs stay in the cache, and nothing but the gradient is written to
memory. Three things make it fast:

* SSIM needs only E[x² + y²], not each square, so seven blurs suffice: x, y, x² + y², xy on the way
  forward, and the three derivatives of SSIM on the way back.
* Channels are interleaved, so a horizontal tap is 3 floats away and rows are plain contiguous vectors.
* Blurred rows live in a ring of blocks ``[block][field][row slot][lane]``. A vertical blur then reads
  from one pointer at constant distances (which is what lets LLVM vectorise it), and advancing the ring
  rotates the eleven weights instead of moving rows.

Everything is summed row by row in a fixed order: the result does not depend on the number of threads.
"""

import numba
import numpy as np
from numpy.typing import NDArray

from fvs_engine.compilation.kernels import kernel, parallel_kernel

F32 = np.float32
Floats = NDArray[np.float32]

TAPS = 11
REACH = TAPS // 2
SIGMA_PX = 1.5
C1 = 0.01**2
C2 = 0.03**2

_LANES = 64
"""Floats in a block: a few vectors, so that entering the inner loop costs little."""
_PAD = 16
"""Zeros on both sides of a row: at least REACH pixels of 3 channels."""
_BEFORE = 4
"""Blurred fields on the way forward: x, y, x² + y², xy."""
_AFTER = 3
"""Blurred fields on the way back: ∂SSIM/∂E[x], ∂SSIM/∂E[x² + y²], ∂SSIM/∂E[xy]."""
_BEFORE_BLOCK = _BEFORE * TAPS * _LANES
_AFTER_BLOCK = _AFTER * TAPS * _LANES

_C1 = F32(C1)
_C2 = F32(C2)
_ONE = F32(1)
_TWO = F32(2)
_ZERO = F32(0)
_BYTE = F32(1 / 255)


def gaussian_window() -> NDArray[np.float64]:
    """The 1-D window of SSIM [TAPS]: σ = 1.5 px, sums to 1. Source: Wang et al., 2004."""
    offsets = np.arange(TAPS) - REACH
    window = np.exp(-0.5 * (offsets / SIGMA_PX) ** 2)
    return np.asarray(window / window.sum())


_WINDOW = gaussian_window().astype(np.float32)
_W0, _W1, _W2, _W3, _W4, _W5 = (F32(w) for w in _WINDOW[: REACH + 1])


@kernel
def _blur_across(line: Floats, ring: Floats, field: int, slot: int, block_size: int) -> None:
    """Blur a padded row horizontally into one slot of the ring."""
    for block in range(ring.size // block_size):
        source = line[block * _LANES : block * _LANES + _LANES + 2 * _PAD]
        start = block * block_size + (field * TAPS + slot) * _LANES
        target = ring[start : start + _LANES]
        for i in range(_LANES):
            target[i] = (
                _W0 * (source[i + 1] + source[i + 31])
                + _W1 * (source[i + 4] + source[i + 28])
                + _W2 * (source[i + 7] + source[i + 25])
                + _W3 * (source[i + 10] + source[i + 22])
                + _W4 * (source[i + 13] + source[i + 19])
                + _W5 * source[i + 16]
            )


@kernel
def _clear_slot(ring: Floats, fields: int, slot: int, block_size: int) -> None:
    """A row outside the image: zeros, as zero padding has it."""
    for block in range(ring.size // block_size):
        for field in range(fields):
            start = block * block_size + (field * TAPS + slot) * _LANES
            ring[start : start + _LANES] = _ZERO


@kernel
def _load_rows(color: Floats, target: NDArray[np.uint8], lines: Floats) -> None:
    """Fill the four padded rows with x, y, x² + y², xy."""
    n = color.size
    xs = lines[0, _PAD : _PAD + n]
    ys = lines[1, _PAD : _PAD + n]
    squares = lines[2, _PAD : _PAD + n]
    products = lines[3, _PAD : _PAD + n]
    for i in range(n):
        x = color[i]
        y = F32(target[i]) * _BYTE
        xs[i] = x
        ys[i] = y
        squares[i] = x * x + y * y
        products[i] = x * y


@kernel
def _ssim_row(ring: Floats, w: Floats, n: int, lines: Floats) -> np.float32:
    """Blur vertically; fill three padded rows with the derivatives of SSIM; return Σ SSIM of the row.

    Only the n floats inside the image are written: beyond them the rows stay zero.
    """
    w0, w1, w2, w3, w4, w5 = w[0], w[1], w[2], w[3], w[4], w[5]
    w6, w7, w8, w9, w10 = w[6], w[7], w[8], w[9], w[10]
    total = F32(0)
    out = np.empty(_AFTER * _LANES, np.float32)  # one pointer: LLVM gives up on more alias checks than 8
    for block in range(ring.size // _BEFORE_BLOCK):
        r = ring[block * _BEFORE_BLOCK : (block + 1) * _BEFORE_BLOCK]
        inside = min(_LANES, n - block * _LANES)
        for i in range(inside):
            u = (
                w0 * r[i] + w1 * r[i + _LANES] + w2 * r[i + 2 * _LANES] + w3 * r[i + 3 * _LANES]
                + w4 * r[i + 4 * _LANES] + w5 * r[i + 5 * _LANES] + w6 * r[i + 6 * _LANES]
                + w7 * r[i + 7 * _LANES] + w8 * r[i + 8 * _LANES] + w9 * r[i + 9 * _LANES]
                + w10 * r[i + 10 * _LANES]
            )  # fmt: skip
            v = (
                w0 * r[i + 11 * _LANES] + w1 * r[i + 12 * _LANES] + w2 * r[i + 13 * _LANES]
                + w3 * r[i + 14 * _LANES] + w4 * r[i + 15 * _LANES] + w5 * r[i + 16 * _LANES]
                + w6 * r[i + 17 * _LANES] + w7 * r[i + 18 * _LANES] + w8 * r[i + 19 * _LANES]
                + w9 * r[i + 20 * _LANES] + w10 * r[i + 21 * _LANES]
            )  # fmt: skip
            square = (
                w0 * r[i + 22 * _LANES] + w1 * r[i + 23 * _LANES] + w2 * r[i + 24 * _LANES]
                + w3 * r[i + 25 * _LANES] + w4 * r[i + 26 * _LANES] + w5 * r[i + 27 * _LANES]
                + w6 * r[i + 28 * _LANES] + w7 * r[i + 29 * _LANES] + w8 * r[i + 30 * _LANES]
                + w9 * r[i + 31 * _LANES] + w10 * r[i + 32 * _LANES]
            )  # fmt: skip
            product = (
                w0 * r[i + 33 * _LANES] + w1 * r[i + 34 * _LANES] + w2 * r[i + 35 * _LANES]
                + w3 * r[i + 36 * _LANES] + w4 * r[i + 37 * _LANES] + w5 * r[i + 38 * _LANES]
                + w6 * r[i + 39 * _LANES] + w7 * r[i + 40 * _LANES] + w8 * r[i + 41 * _LANES]
                + w9 * r[i + 42 * _LANES] + w10 * r[i + 43 * _LANES]
            )  # fmt: skip
            uv = u * v
            uu_vv = u * u + v * v
            a1 = _TWO * uv + _C1
            a2 = _TWO * (product - uv) + _C2
            b1 = uu_vv + _C1
            b2 = square - uu_vv + _C2
            inverse = _ONE / (b1 * b2)
            ssim = a1 * a2 * inverse
            out[i] = _TWO * inverse * (v * (a2 - a1) - u * ssim * (b2 - b1))
            out[i + _LANES] = -ssim * b1 * inverse
            out[i + 2 * _LANES] = _TWO * a1 * inverse
            total += ssim
        first = _PAD + block * _LANES
        for field in range(_AFTER):
            line = lines[field, first : first + inside]
            source = out[field * _LANES : field * _LANES + inside]
            for i in range(inside):
                line[i] = source[i]
    return total


@kernel
def _gradient_row(
    ring: Floats,
    w: Floats,
    color: Floats,
    target: NDArray[np.uint8],
    l1_weight: np.float32,
    ssim_weight: np.float32,
    gradient: Floats,
) -> np.float32:
    """Blur the derivatives vertically and chain them to x; return Σ |x − y| of the row."""
    w0, w1, w2, w3, w4, w5 = w[0], w[1], w[2], w[3], w[4], w[5]
    w6, w7, w8, w9, w10 = w[6], w[7], w[8], w[9], w[10]
    total = F32(0)
    for block in range(ring.size // _AFTER_BLOCK):
        r = ring[block * _AFTER_BLOCK : (block + 1) * _AFTER_BLOCK]
        first = block * _LANES
        last = min(first + _LANES, color.size)
        xs = color[first:last]
        ys = target[first:last]
        out = gradient[first:last]
        for i in range(last - first):
            by_mean = (
                w0 * r[i] + w1 * r[i + _LANES] + w2 * r[i + 2 * _LANES] + w3 * r[i + 3 * _LANES]
                + w4 * r[i + 4 * _LANES] + w5 * r[i + 5 * _LANES] + w6 * r[i + 6 * _LANES]
                + w7 * r[i + 7 * _LANES] + w8 * r[i + 8 * _LANES] + w9 * r[i + 9 * _LANES]
                + w10 * r[i + 10 * _LANES]
            )  # fmt: skip
            by_square = (
                w0 * r[i + 11 * _LANES] + w1 * r[i + 12 * _LANES] + w2 * r[i + 13 * _LANES]
                + w3 * r[i + 14 * _LANES] + w4 * r[i + 15 * _LANES] + w5 * r[i + 16 * _LANES]
                + w6 * r[i + 17 * _LANES] + w7 * r[i + 18 * _LANES] + w8 * r[i + 19 * _LANES]
                + w9 * r[i + 20 * _LANES] + w10 * r[i + 21 * _LANES]
            )  # fmt: skip
            by_product = (
                w0 * r[i + 22 * _LANES] + w1 * r[i + 23 * _LANES] + w2 * r[i + 24 * _LANES]
                + w3 * r[i + 25 * _LANES] + w4 * r[i + 26 * _LANES] + w5 * r[i + 27 * _LANES]
                + w6 * r[i + 28 * _LANES] + w7 * r[i + 29 * _LANES] + w8 * r[i + 30 * _LANES]
                + w9 * r[i + 31 * _LANES] + w10 * r[i + 32 * _LANES]
            )  # fmt: skip
            x = xs[i]
            y = F32(ys[i]) * _BYTE
            difference = x - y
            sign = l1_weight if difference > _ZERO else (-l1_weight if difference < _ZERO else _ZERO)
            total += abs(difference)
            out[i] = sign - ssim_weight * (by_mean + _TWO * x * by_square + y * by_product)
    return total


@kernel
def _rotate_window(window: Floats, centre: int, rotated: Floats) -> None:
    """Put the tap of each ring slot where that slot's row stands relative to ``centre``."""
    for tap in range(TAPS):
        rotated[(centre - REACH + tap) % TAPS] = window[tap]


@kernel
def _band(
    color: Floats,
    target: NDArray[np.uint8],
    window: Floats,
    l1_weight: np.float32,
    ssim_weight: np.float32,
    top: int,
    bottom: int,
    gradient: Floats,
    row_l1: Floats,
    row_ssim: Floats,
    workspace: Floats,
) -> None:
    """Rows ``top`` to ``bottom``, reading up to 2 · REACH rows beyond them."""
    height, n = color.shape
    blocks = (n + _LANES - 1) // _LANES
    row_floats = blocks * _LANES + 2 * _PAD
    before = workspace[: blocks * _BEFORE_BLOCK]
    rest = workspace[blocks * _BEFORE_BLOCK :]
    after = rest[: blocks * _AFTER_BLOCK]
    lines = rest[blocks * _AFTER_BLOCK :][: 7 * row_floats].reshape((7, row_floats))
    inputs = lines[:4]
    derivatives = lines[4:]
    lines[:] = _ZERO
    rotated = np.empty(TAPS, np.float32)
    for row in range(top - 2 * REACH, bottom + 2 * REACH):
        if 0 <= row < height:
            _load_rows(color[row], target[row], inputs)
            for field in range(_BEFORE):
                _blur_across(inputs[field], before, field, row % TAPS, _BEFORE_BLOCK)
        else:
            _clear_slot(before, _BEFORE, row % TAPS, _BEFORE_BLOCK)

        middle = row - REACH
        if middle < top - REACH:
            continue
        if 0 <= middle < height:
            _rotate_window(window, middle, rotated)
            total = _ssim_row(before, rotated, n, derivatives)
            for field in range(_AFTER):
                _blur_across(derivatives[field], after, field, middle % TAPS, _AFTER_BLOCK)
            if top <= middle < bottom:
                row_ssim[middle] = total
        else:
            _clear_slot(after, _AFTER, middle % TAPS, _AFTER_BLOCK)

        done = middle - REACH
        if done >= top:
            _rotate_window(window, done, rotated)
            row_l1[done] = _gradient_row(
                after, rotated, color[done], target[done], l1_weight, ssim_weight, gradient[done]
            )


@parallel_kernel
def photometric_rows(
    color: Floats,
    target: NDArray[np.uint8],
    window: Floats,
    l1_weight: np.float32,
    ssim_weight: np.float32,
    gradient: Floats,
    row_l1: Floats,
    row_ssim: Floats,
    workspaces: Floats,
) -> None:
    """Fill ``gradient`` and the row sums Σ |x − y| and Σ SSIM; one band of rows per workspace.

    ``color``, ``gradient`` [H, 3 W] float32; ``target`` [H, 3 W] uint8; ``window`` [TAPS]; ``row_l1``,
    ``row_ssim`` [H]; ``workspaces`` [bands, workspace_floats(W)]. The gradient is
    l1_weight · sign(x − y) − ssim_weight · ∂ΣSSIM/∂x.
    """
    height = color.shape[0]
    bands = workspaces.shape[0]
    for band in numba.prange(bands):
        _band(
            color,
            target,
            window,
            l1_weight,
            ssim_weight,
            band * height // bands,
            (band + 1) * height // bands,
            gradient,
            row_l1,
            row_ssim,
            workspaces[band],
        )


def workspace_floats(width: int) -> int:
    """Floats of working memory that one band of an image ``width`` px wide needs."""
    blocks = -(-3 * width // _LANES)
    floats = blocks * (_BEFORE_BLOCK + _AFTER_BLOCK) + 7 * (blocks * _LANES + 2 * _PAD)
    return -(-floats // 16) * 16  # whole cache lines, so that every band's workspace is aligned
