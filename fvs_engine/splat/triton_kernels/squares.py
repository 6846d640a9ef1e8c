"""The squared Jacobian of an image: ``raster.kernels.squares`` says how one pass suffices.

Bytes: per hit it reads 8 of the lists and 36 of the record, and writes and reads 64 of moments; per pixel it
reads 12; per Gaussian that is seen it reads 40 of its parameters and 100 of record and moments; it
writes 220 for all.
"""

import math

import torch
import triton
import triton.language as tl
from torch import Tensor

from fvs_engine.splat.gaussians import Gaussians
from fvs_engine.splat.triton_kernels.binning import Hits
from fvs_engine.splat.triton_kernels.blending import (
    BLUE,
    CENTER_X,
    CENTER_Y,
    CHECK_EVERY,
    DEPTH,
    FACTOR_A,
    FACTOR_B,
    FACTOR_K,
    GREEN,
    LANES,
    LEAST_T,
    MOST_ALPHA,
    OPACITY,
    RECORD,
    RED,
    blended,
    by_lanes,
    falloff,
    is_finished,
    neighbours,
    tile_pixels,
)
from fvs_engine.splat.triton_kernels.blending_backward import sum_of_lanes
from fvs_engine.splat.triton_kernels.colors_backward import basis_row, store_rest
from fvs_engine.splat.triton_kernels.harmonics import C0
from fvs_engine.splat.triton_kernels.projection import (
    Projected,
    load_3,
    load_4,
    load_camera,
    store_3,
    view_direction,
)
from fvs_engine.splat.triton_kernels.projection_backward import (
    covariance_gradient,
    linearise,
    position_gradient,
)
from fvs_engine.splat.triton_kernels.sums import sum_hits
from fvs_engine.splat.triton_kernels.tiles import tile_counts

BLOCK = 128
MOMENTS = tl.constexpr(15)
"""Of the squared flow, by the powers (i, j) of s and q: i + j ≤ 4, ordered by i, then j."""
SIZE = tl.constexpr(16)
"""The moments, and the sum of squared weights."""
SQRT_EIGHT, SQRT_EIGHTH = tl.constexpr(math.sqrt(8.0)), tl.constexpr(math.sqrt(0.125))


def square(
    gaussians: Gaussians,
    camera: Tensor,
    size: tuple[int, int],
    degree: int,
    projected: Projected,
    hits: Hits,
    color: Tensor,
) -> tuple[Tensor, Tensor, Tensor, Tensor, Tensor]:
    """The squared derivatives of a view by means, log scales, opacity logits, ``sh_dc`` and ``sh_rest``.

    They are those of ``raster.SquaredJacobian``. ``camera`` [1, 19], ``projected``, ``hits`` and ``color``
    [1, H, W, 3], on black, are of the view.
    """
    rows = color.new_zeros((hits.capacity, SIZE.value))  # of hits that are hidden, or none
    tiles_x, tiles_y = tile_counts(size)
    found = (
        torch.empty_like(gaussians.means),
        torch.empty_like(gaussians.log_scales),
        torch.empty_like(gaussians.opacity_logits),
        torch.empty_like(gaussians.sh_dc),
        torch.empty_like(gaussians.sh_rest),
    )
    count = len(gaussians)
    if count:
        blend_squares_kernel[(tiles_x * tiles_y,)](
            projected.records, hits.listed, hits.numbers, hits.tile_starts, rows, color,
            *size, tiles_x, tiles_x * tiles_y, num_warps=1,
        )  # fmt: skip
        square_kernel[(triton.cdiv(count, BLOCK),)](
            gaussians.means, gaussians.log_scales, gaussians.quaternions_wxyz, camera, count, *size,
            projected.records, projected.radii, sum_hits(rows, hits), *found,
            DEGREE=degree, REST=gaussians.sh_rest.shape[1], BLOCK=BLOCK,
        )  # fmt: skip
    return found


@triton.jit(do_not_specialize=["width", "height", "tiles_x", "tiles"])
def blend_squares_kernel(
    records, listed, numbers, tile_starts, rows, color_image, width, height, tiles_x, tiles
):
    """Blend a tile; write the moments of every hit to its row [16]."""
    x, y, place, inside = tile_pixels(width, height, tiles_x, tiles)
    lane = tl.arange(0, LANES)
    light = by_lanes(tl.where(inside, 1.0, -1.0))
    red_behind = by_lanes(tl.load(color_image + place * 3, mask=inside, other=0.0))
    green_behind = by_lanes(tl.load(color_image + place * 3 + 1, mask=inside, other=0.0))
    blue_behind = by_lanes(tl.load(color_image + place * 3 + 2, mask=inside, other=0.0))
    slot, end = tl.load(tile_starts + tl.program_id(0)), tl.load(tile_starts + tl.program_id(0) + 1)
    while slot < end:
        stop = tl.minimum(slot + CHECK_EVERY, end)
        while slot < stop:
            record = records + tl.load(listed + slot).to(tl.int64) * RECORD
            a, b = tl.load(record + FACTOR_A), tl.load(record + FACTOR_B)
            u, dy, gauss = falloff(
                tl.load(record + CENTER_X), tl.load(record + CENTER_Y), a, tl.load(record + FACTOR_K), b, x, y
            )
            raw = tl.load(record + OPACITY) * gauss
            weight, behind = blended(raw, light)
            light = tl.where(behind > LEAST_T, behind, -1.0)
            red, green, blue = tl.load(record + RED), tl.load(record + GREEN), tl.load(record + BLUE)
            red_behind -= weight * red
            green_behind -= weight * green
            blue_behind -= weight * blue
            # alpha · ∂ colour / ∂ alpha; nothing flows through a clamped or skipped alpha.
            flow_red = weight * (red - red_behind / behind)
            flow_green = weight * (green - green_behind / behind)
            flow_blue = weight * (blue - blue_behind / behind)
            flow = flow_red * flow_red + flow_green * flow_green + flow_blue * flow_blue
            flow = tl.where(raw <= MOST_ALPHA, flow, 0.0)

            s, q = (u[None, :] + neighbours()) * (a * SQRT_EIGHTH), dy * (b * SQRT_EIGHTH)
            qq = q * q
            s0 = tl.sum(flow, axis=0)
            flow *= s
            s1 = tl.sum(flow, axis=0)
            flow *= s
            s2 = tl.sum(flow, axis=0)
            flow *= s
            s3 = tl.sum(flow, axis=0)
            s4 = tl.sum(flow * s, axis=0)
            row = rows + tl.load(numbers + slot).to(tl.int64) * SIZE
            total = sum_of_lanes(
                s0, s0 * q, s0 * qq, s0 * qq * q, s0 * qq * qq, s1, s1 * q, s1 * qq, s1 * qq * q, s2, lane
            )
            tl.store(row + lane, total, mask=lane < 10)
            zero = tl.zeros_like(s0)
            total = sum_of_lanes(
                s2 * q, s2 * qq, s3, s3 * q, s4, tl.sum(weight * weight, axis=0), zero, zero, zero, zero, lane
            )
            tl.store(row + 10 + lane, total, mask=lane < 6)
            slot += 1
        if is_finished(light):
            slot = end


@triton.jit
def slopes(g_x, g_y, g_a, g_k, g_b, factors, xy, z, held, axes, t1, t2, m1, m2, camera):
    """The derivatives by means and log scales, six [B], given those by a record's centre and factors."""
    g_m1, g_m2 = covariance_gradient(factors[0], factors[1], factors[2], g_a, g_k, g_b, m1, m2)
    p = position_gradient(xy, z, held, axes, t1, t2, g_m1, g_m2, g_x, g_y, 0.0, camera)
    return (
        p[0], p[1], p[2],
        g_m1[0] * m1[0] + g_m2[0] * m2[0], g_m1[1] * m1[1] + g_m2[1] * m2[1],
        g_m1[2] * m1[2] + g_m2[2] * m2[2],
    )  # fmt: skip


@triton.jit
def combined(s, q, ss, sq, qq, m):
    """The sum over pixels of (flow · Σ coefficient · monomial)², given its moments ``m``."""
    total = s * s * m[9] + q * q * m[2] + ss * ss * m[14] + sq * sq * m[11] + qq * qq * m[4]
    total += 2.0 * s * (q * m[6] + ss * m[12] + sq * m[10] + qq * m[7])
    total += 2.0 * q * (ss * m[10] + sq * m[7] + qq * m[3])
    total += 2.0 * ss * (sq * m[13] + qq * m[11])
    total += 2.0 * sq * qq * m[8]
    return tl.maximum(total, 0.0)  # rounding alone takes a sum of squares below


@triton.jit(do_not_specialize=["count", "width", "height"])
def square_kernel(
    means, log_scales, quaternions, cameras, count, width, height, records, radii, squares,
    of_means, of_log_scales, of_opacities, of_dc, of_rest,
    DEGREE: tl.constexpr, REST: tl.constexpr, BLOCK: tl.constexpr,
):  # fmt: skip
    """One program carries the moments of ``BLOCK`` Gaussians to their parameters."""
    n = tl.program_id(0) * BLOCK + tl.arange(0, BLOCK)
    here = n < count
    seen = here & (tl.load(radii + n, mask=here, other=0.0) > 0.0)
    camera = load_camera(cameras)
    record, moment = records + n.to(tl.int64) * RECORD, squares + n.to(tl.int64) * SIZE
    # What is not seen reads zeros, and a depth and factors of 1: all its squares are zero.
    px, py, pz = load_3(means, n, seen)
    z = tl.load(record + DEPTH, mask=seen, other=1.0)
    xy, held, axes, _, t1, t2, m1, m2 = linearise(
        px, py, pz, load_3(log_scales, n, seen), load_4(quaternions, n, seen), z, camera, width, height
    )
    a = tl.load(record + FACTOR_A, mask=seen, other=1.0)
    k = tl.load(record + FACTOR_K, mask=seen, other=0.0)
    b = tl.load(record + FACTOR_B, mask=seen, other=1.0)
    f = (a, k, b)
    o = tl.zeros_like(a)
    # The derivative of colour by record, as coefficients of flow · sⁱ qʲ, monomial after monomial; with
    # u, v as in ``blending``: s = √⅛ A u, q = √⅛ B v.
    g = a * (2.0 * SQRT_EIGHT)
    s = slopes(g, -g * k, o, o, o, f, xy, z, held, axes, t1, t2, m1, m2, camera)
    q = slopes(o, b * (2.0 * SQRT_EIGHT), o, o, o, f, xy, z, held, axes, t1, t2, m1, m2, camera)
    ss = slopes(o, o, -16.0 / a, o, o, f, xy, z, held, axes, t1, t2, m1, m2, camera)
    sq = slopes(o, o, o, 16.0 * a / b, o, f, xy, z, held, axes, t1, t2, m1, m2, camera)
    qq = slopes(o, o, o, o, -16.0 / b, f, xy, z, held, axes, t1, t2, m1, m2, camera)
    m = (
        tl.load(moment, mask=seen, other=0.0), tl.load(moment + 1, mask=seen, other=0.0),
        tl.load(moment + 2, mask=seen, other=0.0), tl.load(moment + 3, mask=seen, other=0.0),
        tl.load(moment + 4, mask=seen, other=0.0), tl.load(moment + 5, mask=seen, other=0.0),
        tl.load(moment + 6, mask=seen, other=0.0), tl.load(moment + 7, mask=seen, other=0.0),
        tl.load(moment + 8, mask=seen, other=0.0), tl.load(moment + 9, mask=seen, other=0.0),
        tl.load(moment + 10, mask=seen, other=0.0), tl.load(moment + 11, mask=seen, other=0.0),
        tl.load(moment + 12, mask=seen, other=0.0), tl.load(moment + 13, mask=seen, other=0.0),
        tl.load(moment + 14, mask=seen, other=0.0),
    )  # fmt: skip
    store_3(
        of_means, n,
        combined(s[0], q[0], ss[0], sq[0], qq[0], m),
        combined(s[1], q[1], ss[1], sq[1], qq[1], m),
        combined(s[2], q[2], ss[2], sq[2], qq[2], m),
        here,
    )  # fmt: skip
    store_3(
        of_log_scales, n,
        combined(s[3], q[3], ss[3], sq[3], qq[3], m),
        combined(s[4], q[4], ss[4], sq[4], qq[4], m),
        combined(s[5], q[5], ss[5], sq[5], qq[5], m),
        here,
    )  # fmt: skip
    # ∂ opacity / ∂ logit = opacity · (1 − opacity).
    transparency = 1.0 - tl.load(record + OPACITY, mask=seen, other=0.0)
    tl.store(of_opacities + n, m[0] * transparency * transparency, mask=here)

    # max(colour, 0) depends on nothing where it clamps.
    weight = tl.load(moment + MOMENTS, mask=seen, other=0.0)
    red = tl.where(tl.load(record + RED, mask=seen, other=0.0) > 0.0, weight, 0.0)
    green = tl.where(tl.load(record + GREEN, mask=seen, other=0.0) > 0.0, weight, 0.0)
    blue = tl.where(tl.load(record + BLUE, mask=seen, other=0.0) > 0.0, weight, 0.0)
    store_3(of_dc, n, red * (C0 * C0), green * (C0 * C0), blue * (C0 * C0), here)
    if REST > 0:
        x, y, z, _ = view_direction(px, py, pz, camera)
        values = basis_row(x, y, z, DEGREE)
        store_rest(of_rest, n, values * values, red, green, blue, here, REST, False)
