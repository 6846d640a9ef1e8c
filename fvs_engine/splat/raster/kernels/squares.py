"""Blend splats front to back and add up the squares of every pixel's derivatives, tile by tile.

A gradient adds derivatives up before they are squared; here they are squared first. What makes it one pass:
for the channel c of a pixel, the derivative with respect to anything of a splat's geometry is

    flow_c · φ(s, q),    flow_c = alpha · ∂C_c/∂alpha,

where s and q are the pixel's coordinates in the splat's ellipse (exponent 8 (s² + q²)) and φ is a polynomial
of degree 2 that is known before any pixel is seen. So fifteen moments Σ (flow_r² + flow_g² + flow_b²) sⁱ qʲ,
i + j ≤ 4, hold all squares of all parameters, mixed terms included. Its structure, and why that is fast, are
those of ``blending``.
"""

import math

import numba
import numpy as np
from numpy.typing import NDArray

from fvs_engine.compilation.kernels import F, kernel, parallel_kernel
from fvs_engine.splat.conventions import (
    BLUE,
    CENTER_X,
    CENTER_Y,
    FACTOR_A,
    FACTOR_B,
    FACTOR_K,
    GREEN,
    OPACITY,
    RED,
)
from fvs_engine.splat.raster.kernels.binning import HALVES, LANES, TILE_PX
from fvs_engine.splat.raster.kernels.blending import (
    AREA,
    CHECK_EVERY,
    LEAST_ALPHA,
    LEAST_T,
    MOST_ALPHA,
    SQRT_EIGHTH,
    exp_of_minus_eight,
    retire,
)
from fvs_engine.splat.raster.kernels.harmonics import C0, basis

Floats = NDArray[np.float32]
Ints = NDArray[np.int32]
Longs = NDArray[np.int64]
Bytes = NDArray[np.uint8]

# The order of the moments (i, j); the last entry is the sum of the squared weights.
MOMENTS = ((0, 0), (0, 1), (0, 2), (0, 3), (0, 4), (1, 0), (1, 1), (1, 2), (1, 3), (2, 0), (2, 1), (2, 2),
           (3, 0), (3, 1), (4, 0))  # fmt: skip
MONOMIALS = ((1, 0), (0, 1), (2, 0), (1, 1), (0, 2))
WEIGHT = len(MOMENTS)
SQUARES_SIZE = WEIGHT + 1
SQRT_EIGHT = F(math.sqrt(8.0))

RED_BEHIND, GREEN_BEHIND, BLUE_BEHIND, SUMS = AREA, 2 * AREA, 3 * AREA, 4 * AREA
BUFFER_SIZE = SUMS + SQUARES_SIZE * TILE_PX


@kernel
def _square_row(
    buffer: Floats,
    at: np.uint64,
    sums: np.uint64,
    p: float,
    a: float,
    q: float,
    splat: tuple[float, float, float, float],
) -> None:
    """Add 8 pixels' part to the moments of one splat, and move the state of these pixels behind it."""
    opacity, red, green, blue = splat
    qq = q * q
    qqq = qq * q
    qqqq = qq * qq
    for lane in range(LANES):
        i = (at & np.uint64(248)) + np.uint64(lane)
        j = (sums & np.uint64(8)) + np.uint64(lane + SUMS)
        s = p + a * F(lane)
        raw = opacity * exp_of_minus_eight(s * s + qq)
        alpha = min(raw, MOST_ALPHA)
        alpha = alpha if alpha >= LEAST_ALPHA else F(0)
        before = buffer[i]
        after = before - before * alpha
        live = after > LEAST_T
        weight = before * alpha if live else F(0)
        buffer[i] = after if live else -abs(before)
        red_behind = buffer[i + np.uint64(RED_BEHIND)] - weight * red
        green_behind = buffer[i + np.uint64(GREEN_BEHIND)] - weight * green
        blue_behind = buffer[i + np.uint64(BLUE_BEHIND)] - weight * blue
        buffer[i + np.uint64(RED_BEHIND)] = red_behind
        buffer[i + np.uint64(GREEN_BEHIND)] = green_behind
        buffer[i + np.uint64(BLUE_BEHIND)] = blue_behind
        occluding = alpha / (F(1) - alpha)
        flow_red = weight * red - red_behind * occluding
        flow_green = weight * green - green_behind * occluding
        flow_blue = weight * blue - blue_behind * occluding
        flow = flow_red * flow_red + flow_green * flow_green + flow_blue * flow_blue
        # Nothing flows through a clamped or skipped alpha.
        flow = flow if live and raw <= MOST_ALPHA else F(0)
        buffer[j] += flow
        buffer[j + np.uint64(TILE_PX)] += flow * q
        buffer[j + np.uint64(2 * TILE_PX)] += flow * qq
        buffer[j + np.uint64(3 * TILE_PX)] += flow * qqq
        buffer[j + np.uint64(4 * TILE_PX)] += flow * qqqq
        flow *= s
        buffer[j + np.uint64(5 * TILE_PX)] += flow
        buffer[j + np.uint64(6 * TILE_PX)] += flow * q
        buffer[j + np.uint64(7 * TILE_PX)] += flow * qq
        buffer[j + np.uint64(8 * TILE_PX)] += flow * qqq
        flow *= s
        buffer[j + np.uint64(9 * TILE_PX)] += flow
        buffer[j + np.uint64(10 * TILE_PX)] += flow * q
        buffer[j + np.uint64(11 * TILE_PX)] += flow * qq
        flow *= s
        buffer[j + np.uint64(12 * TILE_PX)] += flow
        buffer[j + np.uint64(13 * TILE_PX)] += flow * q
        buffer[j + np.uint64(14 * TILE_PX)] += flow * s
        buffer[j + np.uint64(WEIGHT * TILE_PX)] += weight * weight


@parallel_kernel
def blend_squares(
    splats: Floats,
    tile_starts: Longs,
    hit_splats: Ints,
    hit_rows: Bytes,
    hit_numbers: Ints,
    color: Floats,
    hit_squares: Floats,
) -> None:
    """Write the moments of every hit to ``hit_squares`` [H, 16]; ``color`` is the render on black."""
    height, width = color.shape[:2]
    tiles_x = (width + TILE_PX - 1) // TILE_PX
    for tile in numba.prange(tile_starts.size - 1):
        buffer = np.empty(BUFFER_SIZE, np.float32)
        buffer[:AREA] = F(-1)  # pixels outside of the image are finished
        buffer[AREA:] = F(0)
        live = np.ones(AREA // LANES, np.int32)
        left, top = (tile % tiles_x) * TILE_PX, (tile // tiles_x) * TILE_PX
        for y in range(min(TILE_PX, height - top)):
            for x in range(min(TILE_PX, width - left)):
                i = y * TILE_PX + x
                buffer[i] = F(1)
                for c in range(3):
                    buffer[i + RED_BEHIND + c * AREA] = color[top + y, left + x, c]
        end_slot = tile_starts[tile + 1]
        for slot in range(tile_starts[tile], tile_starts[tile + 1]):
            splat = splats[hit_splats[slot]]
            a, k, b = SQRT_EIGHTH * splat[FACTOR_A], splat[FACTOR_K], SQRT_EIGHTH * splat[FACTOR_B]
            values = (splat[OPACITY], splat[RED], splat[GREEN], splat[BLUE])
            buffer[SUMS:] = F(0)
            for half in range(HALVES):
                x_left = F(left + half * LANES)
                first, end = hit_rows[slot, 2 * half], hit_rows[slot, 2 * half + 1]
                dx = x_left + F(0.5) - splat[CENTER_X]
                for row in range(first, end):
                    if live[row * HALVES + half] == 0:
                        continue
                    dy = F(top + row) + F(0.5) - splat[CENTER_Y]
                    at = np.uint64(row * TILE_PX + half * LANES)
                    _square_row(buffer, at, np.uint64(half * LANES), a * (dx - k * dy), a, b * dy, values)
            out = hit_squares[hit_numbers[slot]]
            for j in range(SQUARES_SIZE):
                total = F(0)
                for lane in range(TILE_PX):
                    total += buffer[SUMS + j * TILE_PX + lane]
                out[j] = total
            if (slot - tile_starts[tile]) % CHECK_EVERY == CHECK_EVERY - 1 and retire(buffer, live):
                end_slot = slot + 1
                break
        for slot in range(end_slot, tile_starts[tile + 1]):  # hidden behind finished pixels
            hit_squares[hit_numbers[slot], :] = F(0)


@parallel_kernel
def sum_squares(hit_squares: Floats, splat_starts: Longs, order: Longs, squares: Floats) -> None:
    """Add up the hits of every splat, in order, into its Gaussian's row of ``squares`` [N, 16]."""
    for i in numba.prange(order.size):
        total = squares[order[i]]
        for j in range(SQUARES_SIZE):
            total[j] = F(0)
        for hit in range(splat_starts[i], splat_starts[i + 1]):
            for j in range(SQUARES_SIZE):
                total[j] += hit_squares[hit, j]


@parallel_kernel
def fill_gradients(records: Floats, radii: Floats, monomial: tuple[int, int], gradients: Floats) -> None:
    """Write the derivative of colour by record, as coefficients of flow · sⁱ qʲ, to ``gradients`` [N, 10].

    ``monomial`` (i, j) is one of ``MONOMIALS``. With u, v as in ``blending``: s = √⅛ A u, q = √⅛ B v.
    """
    i, j = monomial
    for n in numba.prange(radii.size):
        if radii[n] == F(0):
            continue
        a, k, b = records[n, FACTOR_A], records[n, FACTOR_K], records[n, FACTOR_B]
        gradients[n, :] = F(0)
        if i == 1 and j == 0:
            gradients[n, CENTER_X] = F(2) * SQRT_EIGHT * a
            gradients[n, CENTER_Y] = F(-2) * SQRT_EIGHT * a * k
        elif i == 0 and j == 1:
            gradients[n, CENTER_Y] = F(2) * SQRT_EIGHT * b
        elif i == 2:
            gradients[n, FACTOR_A] = F(-16) / a
        elif i == 1:
            gradients[n, FACTOR_K] = F(16) * a / b
        else:
            gradients[n, FACTOR_B] = F(-16) / b


@parallel_kernel
def combine(squares: Floats, slopes: Floats, means: Floats, log_scales: Floats) -> None:
    """Write the sums over pixels of (flow · Σ_m ``slopes``[m, n, p] · monomial_m)² to two arrays [N, 3].

    ``slopes`` [5, N, 6]: the derivative by position and log scales as coefficients of ``MONOMIALS``.
    """
    for n in numba.prange(means.shape[0]):
        m = squares[n]
        for p in range(6):
            s, q = slopes[0, n, p], slopes[1, n, p]
            ss, sq, qq = slopes[2, n, p], slopes[3, n, p], slopes[4, n, p]
            total = s * s * m[9] + q * q * m[2] + ss * ss * m[14] + sq * sq * m[11] + qq * qq * m[4]
            total += F(2) * s * (q * m[6] + ss * m[12] + sq * m[10] + qq * m[7])
            total += F(2) * q * (ss * m[10] + sq * m[7] + qq * m[3])
            total += F(2) * ss * (sq * m[13] + qq * m[11])
            total += F(2) * sq * qq * m[8]
            total = max(total, F(0))  # rounding alone takes a sum of squares below
            if p < 3:
                means[n, p] = total
            else:
                log_scales[n, p - 3] = total


@parallel_kernel
def square_appearance(
    means: Floats,
    view: Floats,
    degree: int,
    records: Floats,
    radii: Floats,
    squares: Floats,
    opacity_logits: Floats,
    sh_dc: Floats,
    sh_rest: Floats,
) -> None:
    """Write the squares of opacities [N] and colours [N, 3]; fill ``sh_rest`` up to ``degree``."""
    coefficients = (degree + 1) * (degree + 1)
    for n in numba.prange(radii.size):
        if radii[n] == F(0):
            opacity_logits[n] = F(0)
            sh_dc[n, :] = F(0)
            continue
        transparency = F(1) - records[n, OPACITY]  # ∂ opacity / ∂ logit = opacity · (1 − opacity)
        opacity_logits[n] = squares[n, 0] * transparency * transparency
        values = np.empty(16, np.float32)
        dx, dy, dz = means[n, 0] - view[12], means[n, 1] - view[13], means[n, 2] - view[14]
        scale = F(1) / max(math.sqrt(dx * dx + dy * dy + dz * dz), F(1e-12))
        basis(dx * scale, dy * scale, dz * scale, degree, values)
        for c in range(3):
            # max(colour, 0) depends on nothing where it clamps.
            seen = squares[n, WEIGHT] if records[n, RED + c] > F(0) else F(0)
            sh_dc[n, c] = C0 * C0 * seen
            for k in range(1, coefficients):
                sh_rest[n, k - 1, c] = values[k] * values[k] * seen
