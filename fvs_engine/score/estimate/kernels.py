"""The power spectrum of a view, computed from its splats without rendering pixels.

A splat with the screen covariance Σ adds a Gaussian to the image, whose power at the frequency f is known:
(2π)² |Σ| exp(−4π² fᵀ Σ f), times the square of its contrast. Splats are taken as independent of one another,
so their powers add up. Three things decide a splat's contrast, and need one walk over the splats front to
back, on *cells* of ``CELL_PX`` pixels: how much of it is seen, its opacity, and how its colour differs from
the cell's.

Blurred views have so little power of that kind that three others matter, which a render's FFT sees as well:
splats end where their alpha falls under 1/255 (a step along an ellipse); and the FFT takes the left and the
right border of the image for neighbours (a step where splats cross it), and the upper and the lower one.
"""

import math

import numpy as np
from numpy.typing import NDArray

from fvs_engine.compilation.kernels import F, inlined_kernel, kernel
from fvs_engine.splat.raster.interface import ALPHA_MAX, ALPHA_MIN, BLUR_PX2, NEAR_PLANE
from fvs_engine.splat.raster.kernels.blending import exp_of_minus_eight
from fvs_engine.splat.raster.kernels.projection import screen_direction
from fvs_engine.splat.raster.kernels.records import BLUE, CENTER_X, CENTER_Y, DEPTH, OPACITY, RED

Floats = NDArray[np.float32]
Longs = NDArray[np.int64]

CELL_PX = 16
CELL, HALF_CELL = F(CELL_PX), F(CELL_PX / 2)
CELL_VARIANCE = F(CELL_PX * CELL_PX / 12)
"""The variance of a cell's own area: a splat averaged over cells is wider by it."""
SIGMAS = F(2)
"""Radius, in standard deviations, within which a splat is spread over cells."""
LEAST_SEEN = F(1e-3)
"""A splat of lower visibility contributes nothing that matters."""

XX, XY, YY = 2, 3, 4  # the screen covariance, where a rendered record has the factors of its ellipse
RECORD_SIZE = 10

NEAR, BLUR, LEAST_ALPHA, MOST_ALPHA = F(NEAR_PLANE), F(BLUR_PX2), F(ALPHA_MIN), F(ALPHA_MAX)
TWO_PI, FOUR_PI2 = F(2 * math.pi), F(4 * math.pi * math.pi)
MOST_EXPONENT = F(24)


@inlined_kernel
def exp_of_minus(x: float) -> float:
    """exp(−x) for x in [0, 24]; exp(−24) for a larger x."""
    power = exp_of_minus_eight(x * F(1 / 32))
    power *= power
    return power * power


@kernel
def project(
    means: Floats, covariances: Floats, looks: Floats, view: Floats, size: tuple[int, int], records: Floats
) -> int:
    """Write ``records`` [V, 10] of the splats that touch the image; returns V.

    ``means`` [N, 3], ``covariances`` [N, 6] (xx, xy, xz, yy, yz, zz), ``looks`` [N, 5]: opacity, the reach in
    standard deviations, colour. ``view`` and ``size`` as for ``raster.kernels.projection``.
    """
    width, height = size
    count = 0
    for n in range(means.shape[0]):
        px, py, pz = means[n, 0], means[n, 1], means[n, 2]
        z = view[6] * px + view[7] * py + view[8] * pz + view[11]
        if not z >= NEAR:
            continue
        x = view[0] * px + view[1] * py + view[2] * pz + view[9]
        y = view[3] * px + view[4] * py + view[5] * pz + view[10]
        u, _ = screen_direction(x, z, view[15], view[17], width)
        v, _ = screen_direction(y, z, view[16], view[18], height)
        fx_z, fy_z = view[15] / z, view[16] / z
        a0, a1, a2 = (
            fx_z * (view[0] - u * view[6]),
            fx_z * (view[1] - u * view[7]),
            fx_z * (view[2] - u * view[8]),
        )
        b0, b1, b2 = (
            fy_z * (view[3] - v * view[6]),
            fy_z * (view[4] - v * view[7]),
            fy_z * (view[5] - v * view[8]),
        )
        cxx, cxy, cxz = covariances[n, 0], covariances[n, 1], covariances[n, 2]
        cyy, cyz, czz = covariances[n, 3], covariances[n, 4], covariances[n, 5]
        xx = (
            a0 * a0 * cxx
            + a1 * a1 * cyy
            + a2 * a2 * czz
            + F(2) * (a0 * a1 * cxy + a0 * a2 * cxz + a1 * a2 * cyz)
        )
        yy = (
            b0 * b0 * cxx
            + b1 * b1 * cyy
            + b2 * b2 * czz
            + F(2) * (b0 * b1 * cxy + b0 * b2 * cxz + b1 * b2 * cyz)
        )
        xy = (
            a0 * (b0 * cxx + b1 * cxy + b2 * cxz)
            + a1 * (b0 * cxy + b1 * cyy + b2 * cyz)
            + a2 * (b0 * cxz + b1 * cyz + b2 * czz)
        )
        xx, yy = max(xx, F(0)) + BLUR, max(yy, F(0)) + BLUR
        reach = looks[n, 1]
        center_x, center_y = fx_z * x + view[17], fy_z * y + view[18]
        extent_x, extent_y = reach * math.sqrt(xx), reach * math.sqrt(yy)
        if not (
            center_x + extent_x > F(0)
            and center_x - extent_x < F(width)
            and center_y + extent_y > F(0)
            and center_y - extent_y < F(height)
            and xx * yy < F(1e30)
        ):
            continue
        record = records[count]
        record[CENTER_X], record[CENTER_Y] = center_x, center_y
        record[XX], record[XY], record[YY] = xx, xy, yy
        record[OPACITY] = looks[n, 0]
        record[RED], record[RED + 1], record[BLUE] = looks[n, 2], looks[n, 3], looks[n, 4]
        record[DEPTH] = z
        count += 1
    return count


@inlined_kernel
def _determinant(record: Floats) -> float:
    """|Σ|; at least the blur's, which rounding may take from thin splats."""
    determinant: float = record[XX] * record[YY] - record[XY] * record[XY]
    return max(determinant, BLUR * BLUR)


@inlined_kernel
def _hidden(cells: Floats, first_row: int, end_row: int, first_column: int, end_column: int) -> bool:
    """Whether almost no light passes these cells."""
    for row in range(first_row, end_row):
        for column in range(first_column, end_column):
            if cells[row, column, 3] >= LEAST_SEEN:
                return False
    return True


@kernel
def cover(records: Floats, order: Longs, cells: Floats, seen: Floats) -> None:
    """Blend the splats, front to back by ``order``, into ``cells`` [rows, columns, 4]: colour, transmittance.

    Writes how much of every splat is seen to ``seen`` [V], in the order of ``records``.
    """
    rows, columns = cells.shape[0], cells.shape[1]
    cells[:, :, :3] = F(0)
    cells[:, :, 3] = F(1)
    for i in order:
        record = records[i]
        x, y, xy = record[CENTER_X], record[CENTER_Y], record[XY]
        xx, yy = record[XX] + CELL_VARIANCE, record[YY] + CELL_VARIANCE
        inverse = F(1) / (xx * yy - xy * xy)
        summit = record[OPACITY] * math.sqrt(_determinant(record) * inverse)
        wide, high = SIGMAS * math.sqrt(xx), SIGMAS * math.sqrt(yy)
        first_column = int(max((x - wide) / CELL, F(0)))
        end_column = int(min(max((x + wide) / CELL, F(-1)) + F(1), F(columns)))
        first_row = int(max((y - high) / CELL, F(0)))
        end_row = int(min(max((y + high) / CELL, F(-1)) + F(1), F(rows)))
        if _hidden(cells, first_row, end_row, first_column, end_column):
            seen[i] = F(0)
            continue
        total, light = F(0), F(0)
        for row in range(first_row, end_row):
            dy = F(row) * CELL + HALF_CELL - y
            for column in range(first_column, end_column):
                dx = F(column) * CELL + HALF_CELL - x
                exponent = F(0.5) * inverse * (yy * dx * dx - F(2) * xy * dx * dy + xx * dy * dy)
                alpha = min(summit * exp_of_minus_eight(F(0.125) * exponent), MOST_ALPHA)
                cell = cells[row, column]
                weight = alpha * cell[3]
                total += alpha
                light += weight
                cell[0] += weight * record[RED]
                cell[1] += weight * record[RED + 1]
                cell[2] += weight * record[BLUE]
                cell[3] -= weight
        seen[i] = light / total if total > F(0) else F(0)


@kernel
def sum_powers(
    records: Floats,
    order: Longs,
    cells: Floats,
    seen: Floats,
    size: tuple[int, int],
    grid: Floats,
    inside: Floats,
    across_x: Floats,
    across_y: Floats,
    steps: Floats,
) -> None:
    """Add up the powers of all splats, per colour, at the frequencies ``grid`` [F, 2] in cycles/px.

    ``inside`` [3, F]: of their bodies. ``across_x``, ``across_y`` [3, F]: along the borders that they cross,
    of the step in x or y. ``steps`` [3]: of their edges, over 1 / (2π² |f|³).
    """
    width, height = size
    rows, columns = cells.shape[0], cells.shape[1]
    fxx, fxy, fyy = grid[:, 0] * grid[:, 0], F(2) * grid[:, 0] * grid[:, 1], grid[:, 1] * grid[:, 1]
    contrast = np.empty(3, np.float32)
    shape = np.empty(grid.shape[0], np.float32)
    for i in order:
        if seen[i] < LEAST_SEEN:
            continue
        record = records[i]
        x, y, xx, xy, yy = record[CENTER_X], record[CENTER_Y], record[XX], record[XY], record[YY]
        determinant, opacity = _determinant(record), record[OPACITY]
        row = min(max(int(y / CELL), 0), rows - 1)
        column = min(max(int(x / CELL), 0), columns - 1)
        for c in range(3):
            difference = seen[i] * (record[RED + c] - cells[row, column, c])
            contrast[c] = difference * difference
        # Those whose centre is outside count by what they add along the border only, or not at all: many are
        # huge, near the camera, and known badly.
        in_x, in_y = F(0) <= x < F(width), F(0) <= y < F(height)
        if in_x and in_y:
            for j in range(shape.size):
                exponent = FOUR_PI2 * (fxx[j] * xx + fxy[j] * xy + fyy[j] * yy)
                shape[j] = exp_of_minus(min(exponent, MOST_EXPONENT))
            scale = opacity * opacity * FOUR_PI2 * determinant
            reach = math.sqrt(F(2) * math.log(max(opacity / LEAST_ALPHA, F(1))))
            edge = LEAST_ALPHA * LEAST_ALPHA * reach * math.sqrt(math.sqrt(determinant))
            for c in range(3):
                weight = scale * contrast[c]
                for j in range(shape.size):
                    inside[c, j] += weight * shape[j]
                steps[c] += edge * contrast[c]
        strength = opacity * opacity
        if in_y:
            _add_crossing(x, F(width), xx, determinant / xx, strength, contrast, fyy, across_x)
        if in_x:
            _add_crossing(y, F(height), yy, determinant / yy, strength, contrast, fxx, across_y)


@kernel
def _add_crossing(
    position: float,
    end: float,
    variance: float,
    variance_along: float,
    strength: float,
    contrast: Floats,
    squares: Floats,
    power: Floats,
) -> None:
    """Add the power, along the borders at 0 and ``end``, of a splat that crosses one of them.

    ``squares`` [F] are those of the frequencies along the border.
    """
    for border in (F(0), end):
        distance = position - border
        if distance * distance > F(9) * variance:
            continue
        scale = strength * exp_of_minus(min(distance * distance / variance, MOST_EXPONENT))
        scale *= TWO_PI * variance_along
        for j in range(squares.size):
            value = scale * exp_of_minus(min(FOUR_PI2 * squares[j] * variance_along, MOST_EXPONENT))
            for c in range(3):
                power[c, j] += value * contrast[c]


@kernel
def median_log_magnitude(powers: NDArray[np.float64]) -> float:
    """The median of ln |F| over coefficients whose real and imaginary parts are normal; their ``powers`` [P].

    A share 1 − exp(−m² / p) of the magnitudes of the power p is below m; the median is found by bisection.
    −inf where a power is 0 or not finite.
    """
    least, greatest = powers.min(), powers.max()
    if not (least > 0.0 and math.isfinite(greatest)):
        return -math.inf
    low, high = math.log(least) - 2.0, math.log(greatest) + 2.0
    for _ in range(40):
        middle = 0.5 * (low + high)
        square = math.exp(middle)
        below = 0.0
        for power in powers:
            below += 1.0 - math.exp(-square / power)
        if below < 0.5 * powers.size:
            low = middle
        else:
            high = middle
    return 0.25 * (low + high)
