"""Project a model's Gaussians to the splats of a view, front to back.

The mathematics is that of ``splat.raster.kernels.projection``. Here it runs over columns of numbers, a block
of Gaussians at a time and without a branch, so that it becomes vector instructions; those that touch the
image are then picked out. Blocks are made of neighbours (``splat_table``), and those that miss the image as a
whole are left out. Depths need not be told apart to their last bit: one counting sort is enough.
"""

import math

import numpy as np
from numpy.typing import NDArray

from fvs_engine.compilation.kernels import F, kernel
from fvs_engine.splat.conventions import BLUE, BLUR_PX2, CENTER_X, CENTER_Y, DEPTH, NEAR_PLANE, OPACITY, RED
from fvs_engine.splat.raster.kernels.projection import MARGIN, MOST_BLUR

Floats = NDArray[np.float32]

XX, XY, YY = 2, 3, 4  # the screen covariance, where a rendered record has the factors of its ellipse
REACH = 10
RECORD_SIZE = 11

NEAR, BLUR = F(NEAR_PLANE), F(BLUR_PX2)
BLOCK = 128
BINS = 1 << 14


@kernel
def _beyond(across: float, ahead: float, radius: float, length: float, border: float) -> bool:
    """Whether all splats of a block are beyond one border of the image, which lies at x = ``border`` · z.

    Their means are within ``radius`` of the block's middle, which is at x = ``across`` and z = ``ahead`` in
    the camera's frame. ``length``: how far the longest of them reaches on the screen, as a step in x.
    """
    return across - border * ahead > radius * math.sqrt(F(1) + border * border) + length


@kernel
def project(
    columns: Floats, looks: Floats, bounds: Floats, view: Floats, size: tuple[int, int], records: Floats
) -> int:
    """Write ``records`` [V, 11] of the splats that touch the image, in the order of the table; returns V.

    ``columns`` [10, N]: mean, covariance (xx, xy, xz, yy, yz, zz) and reach in standard deviations, ``looks``
    [N, 4]: opacity and colour. ``bounds`` [5, N / 128]: the middle of each block of means, their greatest
    distance from it, and the greatest reach. ``view`` and ``size`` as for ``raster.kernels.projection``.
    """
    width, height = F(size[0]), F(size[1])
    r0, r1, r2, r3, r4, r5, r6, r7, r8 = view[0:9]
    t0, t1, t2 = view[9:12]
    fx, fy, cx, cy = view[15:19]
    least_u, most_u = -cx / fx - MARGIN * width / fx, (width - cx) / fx + MARGIN * width / fx
    least_v, most_v = -cy / fy - MARGIN * height / fy, (height - cy) / fy + MARGIN * height / fy
    right, bottom = (width - cx + MOST_BLUR) / fx, (height - cy + MOST_BLUR) / fy
    left, top = (cx + MOST_BLUR) / fx, (cy + MOST_BLUR) / fy
    # At most that much longer is a splat on the screen than it is, at z = 1 and a focal length of 1.
    stretch = F(1) + max(max(-least_u, most_u), max(-least_v, most_v))
    block = np.empty((7, BLOCK), np.float32)
    depths, xs, ys, xxs, xys, yys, shown = (
        block[0],
        block[1],
        block[2],
        block[3],
        block[4],
        block[5],
        block[6],
    )
    mean_x, mean_y, mean_z, reaches = columns[0], columns[1], columns[2], columns[9]
    cov_xx, cov_xy, cov_xz = columns[3], columns[4], columns[5]
    cov_yy, cov_yz, cov_zz = columns[6], columns[7], columns[8]
    count = 0
    for start in range(0, columns.shape[1], BLOCK):
        px, py, pz, radius, reach = bounds[:, start // BLOCK]
        x = r0 * px + r1 * py + r2 * pz + t0
        y = r3 * px + r4 * py + r5 * pz + t1
        z = r6 * px + r7 * py + r8 * pz + t2
        reach *= stretch
        if z + radius < NEAR or (
            _beyond(x, z, radius, reach, right)
            or _beyond(-x, z, radius, reach, left)
            or _beyond(y, z, radius, reach, bottom)
            or _beyond(-y, z, radius, reach, top)
        ):
            continue
        length = min(BLOCK, columns.shape[1] - start)
        for i in range(length):
            n = start + i
            px, py, pz = mean_x[n], mean_y[n], mean_z[n]
            x = r0 * px + r1 * py + r2 * pz + t0
            y = r3 * px + r4 * py + r5 * pz + t1
            z = r6 * px + r7 * py + r8 * pz + t2
            inverse = F(1) / z
            fx_z, fy_z = fx * inverse, fy * inverse
            u, v = min(max(x * inverse, least_u), most_u), min(max(y * inverse, least_v), most_v)
            a0, a1, a2 = fx_z * (r0 - u * r6), fx_z * (r1 - u * r7), fx_z * (r2 - u * r8)
            b0, b1, b2 = fy_z * (r3 - v * r6), fy_z * (r4 - v * r7), fy_z * (r5 - v * r8)
            cxx, cxy, cxz = cov_xx[n], cov_xy[n], cov_xz[n]
            cyy, cyz, czz = cov_yy[n], cov_yz[n], cov_zz[n]
            ca0, cb0 = cxx * a0 + cxy * a1 + cxz * a2, cxx * b0 + cxy * b1 + cxz * b2
            ca1, cb1 = cxy * a0 + cyy * a1 + cyz * a2, cxy * b0 + cyy * b1 + cyz * b2
            ca2, cb2 = cxz * a0 + cyz * a1 + czz * a2, cxz * b0 + cyz * b1 + czz * b2
            xx = max(a0 * ca0 + a1 * ca1 + a2 * ca2, F(0)) + BLUR
            yy = max(b0 * cb0 + b1 * cb1 + b2 * cb2, F(0)) + BLUR
            center_x, center_y = fx_z * x + cx, fy_z * y + cy
            extent_x, extent_y = reaches[n] * math.sqrt(xx), reaches[n] * math.sqrt(yy)
            inside = (center_x + extent_x > F(0)) & (center_x - extent_x < width)
            inside &= (center_y + extent_y > F(0)) & (center_y - extent_y < height)
            depths[i], xs[i], ys[i] = z, center_x, center_y
            xxs[i], xys[i], yys[i] = xx, a0 * cb0 + a1 * cb1 + a2 * cb2, yy
            shown[i] = F(1) if inside & (z >= NEAR) & (xx * yy < F(1e30)) else F(0)
        for i in range(length):
            if shown[i] > F(0):
                record, look = records[count], looks[start + i]
                record[CENTER_X], record[CENTER_Y] = xs[i], ys[i]
                record[XX], record[XY], record[YY] = xxs[i], xys[i], yys[i]
                record[OPACITY], record[RED], record[RED + 1], record[BLUE] = (
                    look[0],
                    look[1],
                    look[2],
                    look[3],
                )
                record[DEPTH], record[REACH] = depths[i], reaches[start + i]
                count += 1
    return count


@kernel
def front_to_back(records: Floats) -> Floats:
    """The records in the order of their depths, as far as ``BINS`` of these differ, then of the model."""
    count = records.shape[0]
    splats = np.empty_like(records)
    if count == 0:
        return splats
    depths = np.empty(count, np.float32)
    for i in range(count):
        depths[i] = records[i, DEPTH]  # positive, so their bits sort as they do
    bits = depths.view(np.int32)
    least, span, shift = bits.min(), bits.max() - bits.min(), np.int32(0)
    while span >> shift >= BINS:
        shift += np.int32(1)
    starts = np.zeros(BINS + 1, np.int32)
    for i in range(count):
        starts[((bits[i] - least) >> shift) + 1] += 1
    for depth in range(BINS):
        starts[depth + 1] += starts[depth]
    for i in range(count):
        depth = (bits[i] - least) >> shift
        splat, record = splats[starts[depth]], records[i]
        for j in range(RECORD_SIZE):
            splat[np.uint64(j)] = record[np.uint64(j)]
        starts[depth] += 1
    return splats
