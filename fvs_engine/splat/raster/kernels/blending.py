"""Blend splats front to back, tile by tile, and differentiate it. These two kernels take most of the time.

What makes them fast:

* the inner loop runs over 8 neighbouring pixels without a branch, so that it becomes vector instructions;
* all state of a tile lives in one small float32 buffer in L1, addressed by constant offsets, so that the
  compiler can prove that nothing overlaps;
* rows that a splat's ellipse misses are skipped, separately in the left and the right half of the tile,
  and so are rows where every pixel is finished;
* the exponential is a polynomial on the only interval that matters (alpha ≥ 1/255 means an exponent ≤ 5.55);
* a finished pixel keeps its transmittance with a negative sign: no mask, no second array;
* the backward pass also walks front to back, keeping the part of the sum that lies behind: it stops where
  the forward pass stopped and divides by nothing that can be 0;
* a lane's x does not depend on the row, so six sums per lane are enough for all gradients of a splat.
"""

import math

import numba
import numpy as np
from numpy.typing import NDArray

from fvs_engine.compilation.kernels import F, kernel, parallel_kernel
from fvs_engine.splat.conventions import (
    ALPHA_MAX,
    ALPHA_MIN,
    BLUE,
    CENTER_X,
    CENTER_Y,
    DEPTH,
    FACTOR_A,
    FACTOR_B,
    FACTOR_K,
    GRADIENT_SIZE,
    GREEN,
    OPACITY,
    RED,
    TRANSMITTANCE_MIN,
)
from fvs_engine.splat.raster.kernels.binning import HALVES, LANES, TILE_PX

Floats = NDArray[np.float32]
Ints = NDArray[np.int32]
Longs = NDArray[np.int64]
Bytes = NDArray[np.uint8]

AREA = TILE_PX * TILE_PX
CHECK_EVERY = 16  # splats between two checks whether the whole tile is finished
LEAST_ALPHA, MOST_ALPHA, LEAST_T = F(ALPHA_MIN), F(ALPHA_MAX), F(TRANSMITTANCE_MIN)

# exp(−y) on [0, 0.75], interpolated at Chebyshev nodes; its eighth power is exp(−8 y), relative error < 3e-6.
MOST_EIGHTH = F(0.75)
_EXP = np.polynomial.chebyshev.Chebyshev.interpolate(lambda y: np.exp(-y), 5, [0.0, 0.75])
E0, E1, E2, E3, E4, E5 = (F(float(c)) for c in _EXP.convert(kind=np.polynomial.Polynomial).coef)
SQRT_EIGHTH = F(math.sqrt(0.125))

# Offsets of the planes in a tile's buffer. Gradient planes exist in the backward pass only.
T_PLANE, RED_PLANE, GREEN_PLANE, BLUE_PLANE, DEPTH_PLANE = 0, AREA, 2 * AREA, 3 * AREA, 4 * AREA
FORWARD_SIZE = 5 * AREA
ALPHA_PLANE, BEHIND_PLANE, SUMS = 5 * AREA, 6 * AREA, 7 * AREA
SUM_COUNT = 7
BACKWARD_SIZE = SUMS + SUM_COUNT * TILE_PX


@kernel
def exp_of_minus_eight(y: float) -> float:
    """exp(−8 y) for y in [0, 0.75]; exp(−6) for a larger y."""
    y = min(y, MOST_EIGHTH)
    yy = y * y  # Estrin's scheme: a shorter chain than Horner's, and the chain is what the loop waits for
    power = (E0 + E1 * y) + yy * ((E2 + E3 * y) + yy * (E4 + E5 * y))
    power *= power
    power *= power
    return power * power


@kernel
def retire(buffer: Floats, live: Ints) -> bool:
    """Mark the half rows that still let light through; returns whether none does."""
    total = 0
    for strip in range(live.size):
        count = 0
        for lane in range(LANES):
            count += buffer[np.uint64(strip * LANES + lane)] > F(0)
        live[strip] = count
        total += count
    return total == 0


@kernel
def _blend_row(
    buffer: Floats,
    at: np.uint64,
    p: float,
    a: float,
    qq: float,
    splat: tuple[float, float, float, float, float],
) -> None:
    """Blend one splat into 8 pixels; its exponent is 8 ((p + a · lane)² + qq)."""
    opacity, red, green, blue, depth = splat
    for lane in range(LANES):
        i = at + np.uint64(lane)
        s = p + a * F(lane)
        alpha = min(opacity * exp_of_minus_eight(s * s + qq), MOST_ALPHA)
        alpha = alpha if alpha >= LEAST_ALPHA else F(0)
        before = buffer[i]
        after = before - before * alpha
        live = after > LEAST_T
        weight = before * alpha if live else F(0)
        buffer[i] = after if live else -abs(before)
        buffer[i + np.uint64(RED_PLANE)] += weight * red
        buffer[i + np.uint64(GREEN_PLANE)] += weight * green
        buffer[i + np.uint64(BLUE_PLANE)] += weight * blue
        buffer[i + np.uint64(DEPTH_PLANE)] += weight * depth


@parallel_kernel
def blend(
    splats: Floats,
    tile_starts: Longs,
    hit_splats: Ints,
    hit_rows: Bytes,
    color: Floats,
    alpha: Floats,
    depth: Floats,
) -> None:
    """Render ``color`` [H, W, 3], ``alpha`` [H, W] and ``depth`` [H, W] from binned splats."""
    height, width = alpha.shape
    tiles_x = (width + TILE_PX - 1) // TILE_PX
    for tile in numba.prange(tile_starts.size - 1):
        buffer = np.empty(FORWARD_SIZE, np.float32)
        buffer[:AREA] = F(1)
        buffer[AREA:] = F(0)
        live = np.ones(AREA // LANES, np.int32)
        left, top = (tile % tiles_x) * TILE_PX, (tile // tiles_x) * TILE_PX
        for slot in range(tile_starts[tile], tile_starts[tile + 1]):
            splat = splats[hit_splats[slot]]
            a, k, b = SQRT_EIGHTH * splat[FACTOR_A], splat[FACTOR_K], SQRT_EIGHTH * splat[FACTOR_B]
            values = (splat[OPACITY], splat[RED], splat[GREEN], splat[BLUE], splat[DEPTH])
            for half in range(HALVES):
                x = F(left + half * LANES)
                first, end = hit_rows[slot, 2 * half], hit_rows[slot, 2 * half + 1]
                dx = x + F(0.5) - splat[CENTER_X]
                for row in range(first, end):
                    if live[row * HALVES + half] == 0:
                        continue
                    dy = F(top + row) + F(0.5) - splat[CENTER_Y]
                    q = b * dy
                    at = np.uint64(row * TILE_PX + half * LANES)
                    _blend_row(buffer, at, a * (dx - k * dy), a, q * q, values)
            if (slot - tile_starts[tile]) % CHECK_EVERY == CHECK_EVERY - 1 and retire(buffer, live):
                break
        for y in range(min(TILE_PX, height - top)):
            for x in range(min(TILE_PX, width - left)):
                i = y * TILE_PX + x
                transmittance = abs(buffer[i])
                color[top + y, left + x, 0] = buffer[i + RED_PLANE]
                color[top + y, left + x, 1] = buffer[i + GREEN_PLANE]
                color[top + y, left + x, 2] = buffer[i + BLUE_PLANE]
                alpha[top + y, left + x] = F(1) - transmittance
                depth[top + y, left + x] = buffer[i + DEPTH_PLANE]


@kernel
def _differentiate_row(
    buffer: Floats,
    at: np.uint64,
    sums: np.uint64,
    p: float,
    a: float,
    qq: float,
    dy: float,
    splat: tuple[float, float, float, float, float],
    g_depth: Floats | None,
) -> None:
    """Add 8 pixels' part to the sums of one splat, and move the state of these pixels behind it.

    Where ``g_depth`` is None, a version without depth is compiled: training needs none.
    """
    opacity, red, green, blue, depth = splat
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
        g_red = buffer[i + np.uint64(RED_PLANE)]
        g_green = buffer[i + np.uint64(GREEN_PLANE)]
        g_blue = buffer[i + np.uint64(BLUE_PLANE)]
        value = red * g_red + green * g_green + blue * g_blue + buffer[i + np.uint64(ALPHA_PLANE)]
        if g_depth is not None:
            value += depth * buffer[i + np.uint64(DEPTH_PLANE)]
        behind = buffer[i + np.uint64(BEHIND_PLANE)] - weight * value
        buffer[i + np.uint64(BEHIND_PLANE)] = behind
        # alpha · ∂L/∂alpha; nothing flows through a clamped or skipped alpha.
        flow = weight * value - behind * alpha / (F(1) - alpha)
        flow = flow if live and raw <= MOST_ALPHA else F(0)
        buffer[j] += flow
        buffer[j + np.uint64(TILE_PX)] += flow * dy
        buffer[j + np.uint64(2 * TILE_PX)] += flow * dy * dy
        buffer[j + np.uint64(3 * TILE_PX)] += weight * g_red
        buffer[j + np.uint64(4 * TILE_PX)] += weight * g_green
        buffer[j + np.uint64(5 * TILE_PX)] += weight * g_blue
        if g_depth is not None:
            buffer[j + np.uint64(6 * TILE_PX)] += weight * buffer[i + np.uint64(DEPTH_PLANE)]


@kernel
def _collect(buffer: Floats, splat: Floats, x0: float, y0: float, out: Floats) -> None:
    """Turn the lanes' sums, taken around (x0, y0), into the gradient of one splat's record."""
    s, sx, sy, sxx, sxy, syy = F(0), F(0), F(0), F(0), F(0), F(0)
    red, green, blue, depth = F(0), F(0), F(0), F(0)
    for lane in range(TILE_PX):
        x = F(lane) - F(7.5)
        j = SUMS + lane
        d0, d1, d2 = buffer[j], buffer[j + TILE_PX], buffer[j + 2 * TILE_PX]
        s += d0
        sx += x * d0
        sy += d1
        sxx += x * x * d0
        sxy += x * d1
        syy += d2
        red += buffer[j + 3 * TILE_PX]
        green += buffer[j + 4 * TILE_PX]
        blue += buffer[j + 5 * TILE_PX]
        depth += buffer[j + 6 * TILE_PX]
    a, k, b = splat[FACTOR_A], splat[FACTOR_K], splat[FACTOR_B]
    # With u = u0 + x − k y and v = y0 + y: exponent = (a u)² + (b v)², and ∂L/∂exponent = −flow.
    u0 = x0 - k * y0
    su = u0 * s + sx - k * sy
    suu = u0 * u0 * s + F(2) * u0 * (sx - k * sy) + sxx - F(2) * k * sxy + k * k * syy
    suv = y0 * su + u0 * sy + sxy - k * syy
    sv = y0 * s + sy
    svv = y0 * y0 * s + F(2) * y0 * sy + syy
    out[CENTER_X] = F(2) * a * a * su
    out[CENTER_Y] = F(2) * (b * b * sv - a * a * k * su)
    out[FACTOR_A] = F(-2) * a * suu
    out[FACTOR_K] = F(2) * a * a * suv
    out[FACTOR_B] = F(-2) * b * svv
    out[OPACITY] = s / splat[OPACITY]
    out[RED], out[GREEN], out[BLUE], out[DEPTH] = red, green, blue, depth


@parallel_kernel
def blend_backward(
    splats: Floats,
    tile_starts: Longs,
    hit_splats: Ints,
    hit_rows: Bytes,
    hit_numbers: Ints,
    color: Floats,
    alpha: Floats,
    depth: Floats,
    g_color: Floats,
    g_alpha: Floats,
    g_depth: Floats | None,
    hit_gradients: Floats,
) -> None:
    """Write the gradient of every hit to ``hit_gradients`` [H, 10].

    ``color``, ``alpha``, ``depth`` are what ``blend`` rendered; ``g_…`` are the loss's gradients of them
    (that of depth may be None).
    """
    height, width = alpha.shape
    tiles_x = (width + TILE_PX - 1) // TILE_PX
    for tile in numba.prange(tile_starts.size - 1):
        buffer = np.empty(BACKWARD_SIZE, np.float32)
        buffer[:AREA] = F(-1)  # pixels outside of the image are finished
        buffer[AREA:] = F(0)
        live = np.ones(AREA // LANES, np.int32)
        left, top = (tile % tiles_x) * TILE_PX, (tile // tiles_x) * TILE_PX
        for y in range(min(TILE_PX, height - top)):
            for x in range(min(TILE_PX, width - left)):
                i = y * TILE_PX + x
                row, column = top + y, left + x
                buffer[i] = F(1)
                behind = F(0)
                for c in range(3):
                    g = g_color[row, column, c]
                    buffer[i + RED_PLANE + c * AREA] = g
                    behind += g * color[row, column, c]
                if g_depth is not None:
                    buffer[i + DEPTH_PLANE] = g_depth[row, column]
                    behind += g_depth[row, column] * depth[row, column]
                buffer[i + ALPHA_PLANE] = g_alpha[row, column]
                buffer[i + BEHIND_PLANE] = behind + g_alpha[row, column] * alpha[row, column]
        end_slot = tile_starts[tile + 1]
        for slot in range(tile_starts[tile], tile_starts[tile + 1]):
            splat = splats[hit_splats[slot]]
            a, k, b = SQRT_EIGHTH * splat[FACTOR_A], splat[FACTOR_K], SQRT_EIGHTH * splat[FACTOR_B]
            values = (splat[OPACITY], splat[RED], splat[GREEN], splat[BLUE], splat[DEPTH])
            buffer[SUMS:] = F(0)
            for half in range(HALVES):
                x_left = F(left + half * LANES)
                first, end = hit_rows[slot, 2 * half], hit_rows[slot, 2 * half + 1]
                dx = x_left + F(0.5) - splat[CENTER_X]
                for row in range(first, end):
                    if live[row * HALVES + half] == 0:
                        continue
                    dy = F(top + row) + F(0.5) - splat[CENTER_Y]
                    q = b * dy
                    at = np.uint64(row * TILE_PX + half * LANES)
                    _differentiate_row(
                        buffer,
                        at,
                        np.uint64(half * LANES),
                        a * (dx - k * dy),
                        a,
                        q * q,
                        F(row) - F(7.5),
                        values,
                        g_depth,
                    )
            _collect(
                buffer,
                splat,
                F(left) + F(8) - splat[CENTER_X],
                F(top) + F(8) - splat[CENTER_Y],
                hit_gradients[hit_numbers[slot]],
            )
            if (slot - tile_starts[tile]) % CHECK_EVERY == CHECK_EVERY - 1 and retire(buffer, live):
                end_slot = slot + 1
                break
        for slot in range(end_slot, tile_starts[tile + 1]):  # hidden behind finished pixels
            hit_gradients[hit_numbers[slot], :] = F(0)


@parallel_kernel
def sum_hits(hit_gradients: Floats, splat_starts: Longs, order: Longs, gradients: Floats) -> None:
    """Add up the hits of every splat, in order, into its Gaussian's row of ``gradients`` [N, 10]."""
    for i in numba.prange(order.size):
        total = gradients[order[i]]
        for j in range(GRADIENT_SIZE):
            total[j] = F(0)
        for hit in range(splat_starts[i], splat_starts[i + 1]):
            for j in range(GRADIENT_SIZE):
                total[j] += hit_gradients[hit, j]
