"""How much of every splat is seen, and the colours of a view, from one walk over its splats front to back.

Splats are blended into *cells*, squares of 16 px, at most ``MOST_CELLS`` along the longer side of the image.
Most are small beside a cell, and count in that of their centre alone. Nearly all others are small beside a
few cells: a patch of 4 × 8 cells, whatever the splat, costs less than finding out which of them it touches.
So the grid has a border that is no part of the image.
"""

import math

import numpy as np
from numpy.typing import NDArray

from fvs_engine.compilation.kernels import F, inlined_kernel, kernel
from fvs_engine.score.estimate.projection import BLUR, XX, XY, YY
from fvs_engine.splat.conventions import ALPHA_MAX, BLUE, CENTER_X, CENTER_Y, OPACITY, RED
from fvs_engine.splat.raster.kernels.blending import exp_of_minus_eight

Floats = NDArray[np.float32]

LEAST_CELL_PX = 16
MOST_CELLS = 40
LANES, PATCH_ROWS = 8, 4
BORDER_X, BORDER_Y = LANES, PATCH_ROWS
STRIDE = MOST_CELLS + 2 * BORDER_X
PLANE = STRIDE * (MOST_CELLS + 2 * BORDER_Y)
"""Cells of a plane of the buffer: transmittance, red, green, blue."""

LEAST_SEEN = F(1e-3)
"""Visibility below which a splat is ignored."""
SIGMAS = F(math.sqrt(8))
"""Radius, in standard deviations, within which a splat is spread over cells."""
MOST_EIGHTH = SIGMAS * SIGMAS * F(1 / 16)
CELL_VARIANCE = F(1 / 12)
MOST_XX, MOST_YY = F((0.375 * LANES / 2) ** 2), F((0.375 * PATCH_ROWS / 2) ** 2)
"""Variances, in cells, up to which a splat is blended into one patch: 2 standard deviations fit in."""
MOST_SMALL = F(0.05)
"""Variance, in cells, up to which a splat is blended into the one cell that holds its centre."""
MOST_ALPHA = F(ALPHA_MAX)
TWO_PI = F(2 * math.pi)


@inlined_kernel
def determinant(record: Floats) -> float:
    """|Σ|; at least the blur's, which rounding may take from thin splats."""
    volume: float = record[XX] * record[YY] - record[XY] * record[XY]
    return max(volume, BLUR * BLUR)


@inlined_kernel
def _blend_patch(
    buffer: Floats,
    at: np.uint64,
    offset: tuple[float, float],
    factors: tuple[float, float, float],
    splat: tuple[float, float, float, float],
) -> tuple[float, float]:
    """Blend a splat into 4 × 8 cells; returns the sum of its alphas, and that of what is seen of them.

    An eighth of its exponent is a dx² + b dx dy + c dy², ``offset`` from its centre to the first cell's.
    """
    a, b, c = factors
    summit, red, green, blue = splat
    total, light = F(0), F(0)
    for row in range(PATCH_ROWS):
        y = offset[1] + F(row)
        by, cyy = b * y, c * y * y
        for lane in range(LANES):
            i = at + np.uint64(row * STRIDE + lane)
            x = offset[0] + F(lane)
            eighth = x * (a * x + by) + cyy
            alpha = min(summit * exp_of_minus_eight(eighth), MOST_ALPHA)
            alpha = alpha if eighth < MOST_EIGHTH else F(0)
            before = buffer[i]
            weight = alpha * before
            total += alpha if before > F(0) else F(0)
            light += weight
            buffer[i] = before - weight
            buffer[i + np.uint64(PLANE)] += weight * red
            buffer[i + np.uint64(2 * PLANE)] += weight * green
            buffer[i + np.uint64(3 * PLANE)] += weight * blue
    return total, light


@kernel
def cover(splats: Floats, size: tuple[int, int], side: float, seen: Floats) -> Floats:
    """Blend ``splats`` [V, 11] into cells of ``side`` px; returns these, [4, rows, columns].

    Their planes are transmittance and colour on black. How much is seen of every splat goes to ``seen``.
    """
    columns, rows = math.ceil(F(size[0]) / side), math.ceil(F(size[1]) / side)
    buffer = np.zeros(4 * PLANE, np.float32)
    planes = buffer.reshape(4, MOST_CELLS + 2 * BORDER_Y, STRIDE)
    image = planes[:, BORDER_Y : BORDER_Y + rows, BORDER_X : BORDER_X + columns]
    image[0] = F(1)  # nothing is seen in the border
    scale = F(1) / side
    area = scale * scale
    for n in range(splats.shape[0]):
        record = splats[n]
        x, y = record[CENTER_X] * scale, record[CENTER_Y] * scale
        small = record[XX] * area < MOST_SMALL and record[YY] * area < MOST_SMALL
        if small and F(0) <= x < F(columns) and F(0) <= y < F(rows):
            at = np.uint64((BORDER_Y + int(y)) * STRIDE + BORDER_X + int(x))
            before = buffer[at]
            seen[n] = before if before >= LEAST_SEEN else F(0)
            covered = record[OPACITY] * TWO_PI * math.sqrt(determinant(record)) * area
            weight = before * min(covered, MOST_ALPHA)
            buffer[at] = before - weight
            buffer[at + np.uint64(PLANE)] += weight * record[RED]
            buffer[at + np.uint64(2 * PLANE)] += weight * record[RED + 1]
            buffer[at + np.uint64(3 * PLANE)] += weight * record[BLUE]
            continue
        # A splat that is averaged over cells is wider by their own variance.
        xx, xy, yy = record[XX] * area + CELL_VARIANCE, record[XY] * area, record[YY] * area + CELL_VARIANCE
        if yy < MOST_YY and xx < MOST_XX:
            left = int(min(max(x - F(LANES / 2 - 0.5), F(-BORDER_X)), F(columns)) + F(BORDER_X))
            top = int(min(max(y - F(PATCH_ROWS / 2 - 0.5), F(-BORDER_Y)), F(rows)) + F(BORDER_Y))
            right, bottom = left + LANES, top + PATCH_ROWS
            row = BORDER_Y + int(min(max(y, F(0)), F(rows - 1)))
            column = BORDER_X + int(min(max(x, F(0)), F(columns - 1)))
            if buffer[np.uint64(row * STRIDE + column)] < LEAST_SEEN:
                seen[n] = F(0)
                continue
        else:
            wide, high = SIGMAS * math.sqrt(xx), SIGMAS * math.sqrt(yy)
            left = BORDER_X + int(min(max(x - wide, F(0)), F(columns)))
            right = BORDER_X + int(min(max(x + wide + F(1), F(0)), F(columns)))
            top = BORDER_Y + int(min(max(y - high, F(0)), F(rows)))
            bottom = BORDER_Y + int(min(max(y + high + F(1), F(0)), F(rows)))
        # |Σ + v 1| as |Σ| + v tr Σ + v²: the difference of products may round to less than nothing.
        volume = determinant(record) * area * area
        inverse = F(1) / (volume + CELL_VARIANCE * (xx + yy - CELL_VARIANCE))
        summit = record[OPACITY] * math.sqrt(volume * inverse)
        splat = (summit, record[RED], record[RED + 1], record[BLUE])
        inverse *= F(1 / 16)
        factors = (yy * inverse, F(-2) * xy * inverse, xx * inverse)
        total, light = F(0), F(0)
        for row in range(top, bottom, PATCH_ROWS):
            for column in range(left, right, LANES):
                offset = (F(column - BORDER_X) + F(0.5) - x, F(row - BORDER_Y) + F(0.5) - y)
                at = np.uint64(row * STRIDE + column)
                alphas, weights = _blend_patch(buffer, at, offset, factors, splat)
                total += alphas
                light += weights
        seen[n] = light / total if total > F(0) else F(0)
    return image.copy()
