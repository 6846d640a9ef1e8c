"""Project Gaussians to screen records, and carry gradients of records back to their parameters.

The mathematics is that of ``raster.reference_projection``, differentiated by hand. ``view`` is a float32
vector [19]: rotation (9, row-major) and translation (3) of camera_from_model, the camera's centre
in the model frame (3), and fx, fy, cx, cy; ``size`` is (width, height).
"""

import math

import numba
import numpy as np
from numpy.typing import NDArray

from fvs_engine.compilation.kernels import F, kernel, parallel_kernel
from fvs_engine.splat.conventions import (
    ALPHA_MIN,
    BLUE,
    BLUR_PX2,
    CENTER_X,
    CENTER_Y,
    DEPTH,
    EXTENT_X,
    EXTENT_Y,
    FACTOR_A,
    FACTOR_B,
    FACTOR_K,
    GREEN,
    HEIGHT,
    NEAR_PLANE,
    OPACITY,
    RED,
    SLOPE_X,
    SLOPE_Y,
    WIDTH,
)
from fvs_engine.splat.raster.kernels.harmonics import C0, basis, basis_derivatives

Floats = NDArray[np.float32]

CHUNK = 1024  # Gaussians a thread takes at once; its scratch memory is made once for all of them
SQRT_HALF = F(math.sqrt(0.5))
NEAR, BLUR, LEAST_ALPHA, MARGIN = F(NEAR_PLANE), F(BLUR_PX2), F(ALPHA_MIN), F(0.15)
MOST_REACH = F(1.001 * math.sqrt(-2 * math.log(ALPHA_MIN)))
"""Where the alpha of an opaque splat falls under 1/255, in standard deviations; with room for rounding."""
MOST_BLUR = F(MOST_REACH * math.sqrt(BLUR_PX2))


@kernel
def screen_direction(
    offset: float, depth: float, focal: float, principal: float, size: int
) -> tuple[float, bool]:
    """The ratio x / z, held within 15 % of the image beyond its border, and whether it had to be held."""
    margin = MARGIN * F(size) / focal
    low, high = -principal / focal - margin, (F(size) - principal) / focal + margin
    direction = offset / depth
    return min(max(direction, low), high), not low <= direction <= high


@kernel
def _scaled_axes(quaternion: Floats, log_scales: Floats, axes: Floats) -> float:
    """Write R S, column j = axis j, to ``axes`` [3, 3]; returns 1 / |quaternion|."""
    w, x, y, z = quaternion[0], quaternion[1], quaternion[2], quaternion[3]
    inverse_norm = F(1) / max(math.sqrt(w * w + x * x + y * y + z * z), F(1e-12))
    w, x, y, z = w * inverse_norm, x * inverse_norm, y * inverse_norm, z * inverse_norm
    s0, s1, s2 = math.exp(log_scales[0]), math.exp(log_scales[1]), math.exp(log_scales[2])
    axes[0, 0] = s0 * (F(1) - F(2) * (y * y + z * z))
    axes[1, 0] = s0 * F(2) * (x * y + w * z)
    axes[2, 0] = s0 * F(2) * (x * z - w * y)
    axes[0, 1] = s1 * F(2) * (x * y - w * z)
    axes[1, 1] = s1 * (F(1) - F(2) * (x * x + z * z))
    axes[2, 1] = s1 * F(2) * (y * z + w * x)
    axes[0, 2] = s2 * F(2) * (x * z + w * y)
    axes[1, 2] = s2 * F(2) * (y * z - w * x)
    axes[2, 2] = s2 * (F(1) - F(2) * (x * x + y * y))
    return inverse_norm


@kernel
def _screen_axes(axes: Floats, view: Floats, z: float, u: float, v: float, m: Floats) -> None:
    """Write t₁, t₂ (rows 0, 1: the projection's rows) and m₁, m₂ (rows 2, 3) to ``m`` [4, 3]."""
    fx_z, fy_z = view[15] / z, view[16] / z
    for j in range(3):
        m[0, j] = fx_z * (view[j] - u * view[6 + j])
        m[1, j] = fy_z * (view[3 + j] - v * view[6 + j])
    for j in range(3):
        m[2, j] = m[0, 0] * axes[0, j] + m[0, 1] * axes[1, j] + m[0, 2] * axes[2, j]
        m[3, j] = m[1, 0] * axes[0, j] + m[1, 1] * axes[1, j] + m[1, 2] * axes[2, j]


@parallel_kernel
def project(
    means: Floats,
    log_scales: Floats,
    quaternions: Floats,
    opacity_logits: Floats,
    sh_dc: Floats,
    sh_rest: Floats,
    degree: int,
    view: Floats,
    size: tuple[int, int],
    records: Floats,
    radii: Floats,
) -> None:
    """Fill ``records`` [N, 16] and ``radii`` [N] px; a radius of 0 marks a culled Gaussian."""
    count = means.shape[0]
    width, height = size
    coefficients = (degree + 1) * (degree + 1)
    for chunk in numba.prange((count + CHUNK - 1) // CHUNK):
        axes = np.empty((3, 3), np.float32)
        m = np.empty((4, 3), np.float32)
        values = np.empty(16, np.float32)
        for n in range(chunk * CHUNK, min((chunk + 1) * CHUNK, count)):
            radii[n] = F(0)
            px, py, pz = means[n, 0], means[n, 1], means[n, 2]
            z = view[6] * px + view[7] * py + view[8] * pz + view[11]
            if not z >= NEAR:
                continue
            x = view[0] * px + view[1] * py + view[2] * pz + view[9]
            y = view[3] * px + view[4] * py + view[5] * pz + view[10]
            u, _ = screen_direction(x, z, view[15], view[17], width)
            v, _ = screen_direction(y, z, view[16], view[18], height)
            center_x = view[15] * x / z + view[17]
            center_y = view[16] * y / z + view[18]
            largest = math.exp(max(log_scales[n, 0], log_scales[n, 1], log_scales[n, 2]))
            # No ellipse is longer than a sphere of the largest scale is wide: that tells most Gaussians that
            # miss the image, before the work of their axes. A NaN goes on, to the exact comparison.
            widest = MOST_REACH * largest / z
            margin_x = MOST_BLUR + widest * view[15] * (F(1) + abs(u))
            margin_y = MOST_BLUR + widest * view[16] * (F(1) + abs(v))
            if (
                center_x + margin_x < F(0)
                or center_x - margin_x > F(width)
                or center_y + margin_y < F(0)
                or center_y - margin_y > F(height)
            ):
                continue
            opacity = F(1) / (F(1) + math.exp(-opacity_logits[n]))
            if not opacity >= LEAST_ALPHA:
                continue
            _scaled_axes(quaternions[n], log_scales[n], axes)
            _screen_axes(axes, view, z, u, v, m)
            xx = m[2, 0] * m[2, 0] + m[2, 1] * m[2, 1] + m[2, 2] * m[2, 2]
            xy = m[2, 0] * m[3, 0] + m[2, 1] * m[3, 1] + m[2, 2] * m[3, 2]
            yy = m[3, 0] * m[3, 0] + m[3, 1] * m[3, 1] + m[3, 2] * m[3, 2]
            c0 = m[2, 1] * m[3, 2] - m[2, 2] * m[3, 1]
            c1 = m[2, 2] * m[3, 0] - m[2, 0] * m[3, 2]
            c2 = m[2, 0] * m[3, 1] - m[2, 1] * m[3, 0]
            determinant = c0 * c0 + c1 * c1 + c2 * c2 + BLUR * (xx + yy) + BLUR * BLUR
            xx += BLUR
            yy += BLUR
            reach = math.sqrt(F(2) * math.log(opacity / LEAST_ALPHA))
            extent_x, extent_y = reach * math.sqrt(xx), reach * math.sqrt(yy)
            if not (
                center_x + extent_x > F(0)
                and center_x - extent_x < F(width)
                and center_y + extent_y > F(0)
                and center_y - extent_y < F(height)
                and determinant < F(1e30)
            ):
                continue
            radii[n] = max(extent_x, extent_y)
            record = records[n]
            record[CENTER_X], record[CENTER_Y] = center_x, center_y
            record[FACTOR_A] = SQRT_HALF * math.sqrt(yy / determinant)
            record[FACTOR_K] = xy / yy
            record[FACTOR_B] = SQRT_HALF / math.sqrt(yy)
            record[OPACITY] = opacity
            record[DEPTH] = z
            record[EXTENT_X], record[EXTENT_Y] = extent_x, extent_y
            record[WIDTH] = reach * math.sqrt(determinant / yy)
            record[HEIGHT] = reach * math.sqrt(determinant / xx)
            record[SLOPE_X], record[SLOPE_Y] = xy / yy, xy / xx

            dx, dy, dz = px - view[12], py - view[13], pz - view[14]
            scale = F(1) / max(math.sqrt(dx * dx + dy * dy + dz * dz), F(1e-12))
            basis(dx * scale, dy * scale, dz * scale, degree, values)
            red = F(0.5) + C0 * sh_dc[n, 0]
            green = F(0.5) + C0 * sh_dc[n, 1]
            blue = F(0.5) + C0 * sh_dc[n, 2]
            for k in range(1, coefficients):
                red += values[k] * sh_rest[n, k - 1, 0]
                green += values[k] * sh_rest[n, k - 1, 1]
                blue += values[k] * sh_rest[n, k - 1, 2]
            record[RED], record[GREEN], record[BLUE] = max(red, F(0)), max(green, F(0)), max(blue, F(0))


@kernel
def _color_gradient(
    n: int,
    record: Floats,
    gradient: Floats,
    direction: tuple[float, float, float],
    degree: int,
    sh_rest: Floats,
    scratch: Floats,
    g_dc: Floats,
    g_rest: Floats,
) -> tuple[float, float, float]:
    """Write the gradients of the coefficients; returns that of the direction."""
    # max(colour, 0) passes no gradient where it clamps.
    red = gradient[RED] if record[RED] > F(0) else F(0)
    green = gradient[GREEN] if record[GREEN] > F(0) else F(0)
    blue = gradient[BLUE] if record[BLUE] > F(0) else F(0)
    g_dc[n, 0], g_dc[n, 1], g_dc[n, 2] = C0 * red, C0 * green, C0 * blue
    used = (degree + 1) * (degree + 1)
    gx, gy, gz = F(0), F(0), F(0)
    if degree > 0:
        x, y, z = direction
        basis(x, y, z, degree, scratch[0])
        basis_derivatives(x, y, z, degree, scratch[1], scratch[2], scratch[3])
        for k in range(1, used):
            value = scratch[0, k]
            g_rest[n, k - 1, 0], g_rest[n, k - 1, 1], g_rest[n, k - 1, 2] = (
                value * red,
                value * green,
                value * blue,
            )
            along = sh_rest[n, k - 1, 0] * red + sh_rest[n, k - 1, 1] * green + sh_rest[n, k - 1, 2] * blue
            gx += scratch[1, k] * along
            gy += scratch[2, k] * along
            gz += scratch[3, k] * along
    for k in range(used - 1, g_rest.shape[1]):
        g_rest[n, k, 0] = g_rest[n, k, 1] = g_rest[n, k, 2] = F(0)
    return gx, gy, gz


@kernel
def _quaternion_gradient(q: Floats, inverse_norm: float, r: Floats, out: Floats) -> None:
    """Write the gradient of the unnormalised quaternion, given that of the rotation, ``r`` [3, 3]."""
    w, x, y, z = q[0] * inverse_norm, q[1] * inverse_norm, q[2] * inverse_norm, q[3] * inverse_norm
    gw = F(2) * (z * (r[1, 0] - r[0, 1]) + y * (r[0, 2] - r[2, 0]) + x * (r[2, 1] - r[1, 2]))
    gx = F(2) * (
        y * (r[0, 1] + r[1, 0])
        + z * (r[0, 2] + r[2, 0])
        + w * (r[2, 1] - r[1, 2])
        - F(2) * x * (r[1, 1] + r[2, 2])
    )
    gy = F(2) * (
        x * (r[0, 1] + r[1, 0])
        + z * (r[1, 2] + r[2, 1])
        + w * (r[0, 2] - r[2, 0])
        - F(2) * y * (r[0, 0] + r[2, 2])
    )
    gz = F(2) * (
        x * (r[0, 2] + r[2, 0])
        + y * (r[1, 2] + r[2, 1])
        + w * (r[1, 0] - r[0, 1])
        - F(2) * z * (r[0, 0] + r[1, 1])
    )
    along = gw * w + gx * x + gy * y + gz * z
    out[0], out[1] = (gw - along * w) * inverse_norm, (gx - along * x) * inverse_norm
    out[2], out[3] = (gy - along * y) * inverse_norm, (gz - along * z) * inverse_norm


@parallel_kernel
def project_backward(
    means: Floats,
    log_scales: Floats,
    quaternions: Floats,
    sh_rest: Floats,
    degree: int,
    view: Floats,
    size: tuple[int, int],
    records: Floats,
    radii: Floats,
    gradients: Floats,
    g_means: Floats,
    g_log_scales: Floats,
    g_quaternions: Floats,
    g_opacity_logits: Floats,
    g_dc: Floats,
    g_rest: Floats,
) -> None:
    """Carry ``gradients`` [N, 10] of the records to the parameters (every element of ``g_…`` is written)."""
    count = means.shape[0]
    width, height = size
    for chunk in numba.prange((count + CHUNK - 1) // CHUNK):
        axes = np.empty((3, 3), np.float32)
        m = np.empty((4, 3), np.float32)
        gm = np.empty((4, 3), np.float32)
        g_rotation = np.empty((3, 3), np.float32)
        scratch = np.empty((4, 16), np.float32)
        for n in range(chunk * CHUNK, min((chunk + 1) * CHUNK, count)):
            if radii[n] == F(0):
                g_means[n, :] = F(0)
                g_log_scales[n, :] = F(0)
                g_quaternions[n, :] = F(0)
                g_opacity_logits[n] = F(0)
                g_dc[n, :] = F(0)
                g_rest[n, :, :] = F(0)
                continue
            record, gradient = records[n], gradients[n]
            px, py, pz = means[n, 0], means[n, 1], means[n, 2]
            x = view[0] * px + view[1] * py + view[2] * pz + view[9]
            y = view[3] * px + view[4] * py + view[5] * pz + view[10]
            z = record[DEPTH]
            u, u_held = screen_direction(x, z, view[15], view[17], width)
            v, v_held = screen_direction(y, z, view[16], view[18], height)
            inverse_norm = _scaled_axes(quaternions[n], log_scales[n], axes)
            _screen_axes(axes, view, z, u, v, m)

            # Factors → screen covariance. With V = Σ_xx − Σ_xy² / Σ_yy: A = √½ V^−½.
            a, k, b = record[FACTOR_A], record[FACTOR_K], record[FACTOR_B]
            inverse_yy = F(2) * b * b
            g_v = -a * a * a * gradient[FACTOR_A]
            g_xx = g_v
            g_xy = gradient[FACTOR_K] * inverse_yy - F(2) * k * g_v
            g_yy = k * k * g_v - (k * gradient[FACTOR_K] + F(0.5) * b * gradient[FACTOR_B]) * inverse_yy
            # Screen covariance → its rows m → axes and the projection's rows t.
            for j in range(3):
                gm[2, j] = F(2) * g_xx * m[2, j] + g_xy * m[3, j]
                gm[3, j] = F(2) * g_yy * m[3, j] + g_xy * m[2, j]
                g_log_scales[n, j] = gm[2, j] * m[2, j] + gm[3, j] * m[3, j]
            for i in range(3):
                gm[0, i] = gm[2, 0] * axes[i, 0] + gm[2, 1] * axes[i, 1] + gm[2, 2] * axes[i, 2]
                gm[1, i] = gm[3, 0] * axes[i, 0] + gm[3, 1] * axes[i, 1] + gm[3, 2] * axes[i, 2]
            for j in range(3):
                scale = math.exp(log_scales[n, j])
                for i in range(3):
                    g_rotation[i, j] = scale * (gm[2, j] * m[0, i] + gm[3, j] * m[1, i])
            _quaternion_gradient(quaternions[n], inverse_norm, g_rotation, g_quaternions[n])

            # The projection's rows, the centre and the depth → the position in the camera's frame.
            inverse_z = F(1) / z
            fx_z, fy_z = view[15] * inverse_z, view[16] * inverse_z
            g_u = -fx_z * (gm[0, 0] * view[6] + gm[0, 1] * view[7] + gm[0, 2] * view[8])
            g_w = -fy_z * (gm[1, 0] * view[6] + gm[1, 1] * view[7] + gm[1, 2] * view[8])
            g_z = gradient[DEPTH]
            for j in range(3):
                g_z -= (gm[0, j] * m[0, j] + gm[1, j] * m[1, j]) * inverse_z
            if u_held:
                g_u = F(0)
            if v_held:
                g_w = F(0)
            g_x = (g_u + gradient[CENTER_X] * view[15]) * inverse_z
            g_y = (g_w + gradient[CENTER_Y] * view[16]) * inverse_z
            g_z -= (g_x * x + g_y * y) * inverse_z

            # The direction of view.
            dx, dy, dz = px - view[12], py - view[13], pz - view[14]
            scale = F(1) / max(math.sqrt(dx * dx + dy * dy + dz * dz), F(1e-12))
            direction = (dx * scale, dy * scale, dz * scale)
            sx, sy, sz = _color_gradient(
                n, record, gradient, direction, degree, sh_rest, scratch, g_dc, g_rest
            )
            along = sx * direction[0] + sy * direction[1] + sz * direction[2]
            g_means[n, 0] = (
                view[0] * g_x + view[3] * g_y + view[6] * g_z + (sx - along * direction[0]) * scale
            )
            g_means[n, 1] = (
                view[1] * g_x + view[4] * g_y + view[7] * g_z + (sy - along * direction[1]) * scale
            )
            g_means[n, 2] = (
                view[2] * g_x + view[5] * g_y + view[8] * g_z + (sz - along * direction[2]) * scale
            )
            opacity = record[OPACITY]
            g_opacity_logits[n] = gradient[OPACITY] * opacity * (F(1) - opacity)
