"""Project Gaussians to screen records. The mathematics is that of ``raster.reference_projection``.

A camera is a float32 vector [19]: rotation (9, row-major) and translation (3) of camera_from_model, the
camera's centre in the model frame (3), and fx, fy, cx, cy.

Bytes per Gaussian and camera: reads 44, for a visible one of degree 3 236; writes 68, for a culled one 4.
"""

import math
from dataclasses import dataclass

import torch
import triton
import triton.language as tl
from torch import Tensor

from fvs_engine.splat.conventions import ALPHA_MIN, BLUR_PX2, NEAR_PLANE, RECORD_SIZE
from fvs_engine.splat.gaussians import Gaussians
from fvs_engine.splat.triton_kernels.harmonics import C0, basis, coefficient
from fvs_engine.splat.triton_kernels.rows import row_of_16

CAMERA_SIZE = 19
BLOCK = 128

NEAR, BLUR, LEAST_ALPHA = tl.constexpr(NEAR_PLANE), tl.constexpr(BLUR_PX2), tl.constexpr(ALPHA_MIN)
MARGIN = tl.constexpr(0.15)
SQRT_HALF = tl.constexpr(math.sqrt(0.5))
_CAMERA_SIZE, _RECORD_SIZE = tl.constexpr(CAMERA_SIZE), tl.constexpr(RECORD_SIZE)


@dataclass(frozen=True)
class Projected:
    """N Gaussians seen by C cameras of one size.

    ``records`` float32 [C, N, 16], laid out as ``splat.conventions`` says, unset where culled; ``radii``
    float32 [C, N] px, half the larger side of the screen box, 0 where culled.
    """

    records: Tensor
    radii: Tensor


def project(gaussians: Gaussians, cameras: Tensor, size: tuple[int, int], degree: int) -> Projected:
    """Project for ``cameras`` [C, 19], all of ``size`` (width, height), with ``degree`` degrees of colour."""
    count, camera_count, device = len(gaussians), len(cameras), gaussians.device
    projected = Projected(
        torch.empty((camera_count, count, RECORD_SIZE), dtype=torch.float32, device=device),
        torch.empty((camera_count, count), dtype=torch.float32, device=device),
    )
    programs = camera_count * triton.cdiv(count, BLOCK)
    if programs:
        project_kernel[(programs,)](
            *gaussians.tensors().values(), cameras, camera_count, count, *size,
            projected.records, projected.radii,
            DEGREE=degree, REST=gaussians.sh_rest.shape[1], BLOCK=BLOCK,
        )  # fmt: skip
    return projected


@triton.jit
def load_camera(camera):
    """The 19 numbers of a camera."""
    return (
        tl.load(camera), tl.load(camera + 1), tl.load(camera + 2), tl.load(camera + 3), tl.load(camera + 4),
        tl.load(camera + 5), tl.load(camera + 6), tl.load(camera + 7), tl.load(camera + 8),
        tl.load(camera + 9), tl.load(camera + 10), tl.load(camera + 11),
        tl.load(camera + 12), tl.load(camera + 13), tl.load(camera + 14),
        tl.load(camera + 15), tl.load(camera + 16), tl.load(camera + 17), tl.load(camera + 18),
    )  # fmt: skip


@triton.jit
def load_3(rows, n, mask):
    """Three columns [B] of rows [N, 3]."""
    return (
        tl.load(rows + 3 * n, mask=mask, other=0.0),
        tl.load(rows + 3 * n + 1, mask=mask, other=0.0),
        tl.load(rows + 3 * n + 2, mask=mask, other=0.0),
    )


@triton.jit
def load_4(rows, n, mask):
    """Four columns [B] of rows [N, 4]."""
    return (
        tl.load(rows + 4 * n, mask=mask, other=0.0),
        tl.load(rows + 4 * n + 1, mask=mask, other=0.0),
        tl.load(rows + 4 * n + 2, mask=mask, other=0.0),
        tl.load(rows + 4 * n + 3, mask=mask, other=0.0),
    )


@triton.jit
def store_3(rows, n, a, b, c, mask):
    """Write three columns [B] to rows [N, 3]."""
    tl.store(rows + 3 * n, a, mask=mask)
    tl.store(rows + 3 * n + 1, b, mask=mask)
    tl.store(rows + 3 * n + 2, c, mask=mask)


@triton.jit
def screen_direction(offset, depth, focal, principal, size):
    """The ratio x / z, held within 15 % of the image beyond its border, and whether it had to be held."""
    margin = size * MARGIN / focal
    low, high = -principal / focal - margin, (size - principal) / focal + margin
    direction = offset / depth
    held = (direction < low) | (direction > high)
    return tl.minimum(tl.maximum(direction, low), high), held


@triton.jit
def view_direction(px, py, pz, camera):
    """The unit direction from the camera's centre to (px, py, pz), and 1 / the distance."""
    dx, dy, dz = px - camera[12], py - camera[13], pz - camera[14]
    scale = 1.0 / tl.maximum(tl.sqrt(dx * dx + dy * dy + dz * dz), 1e-12)
    return dx * scale, dy * scale, dz * scale, scale


@triton.jit
def scaled_axes(quaternion, s0, s1, s2):
    """R S, row-major, and 1 / |quaternion|."""
    w, x, y, z = quaternion
    inverse_norm = 1.0 / tl.maximum(tl.sqrt(w * w + x * x + y * y + z * z), 1e-12)
    w, x, y, z = w * inverse_norm, x * inverse_norm, y * inverse_norm, z * inverse_norm
    axes = (
        s0 * (1.0 - 2.0 * (y * y + z * z)), s1 * 2.0 * (x * y - w * z), s2 * 2.0 * (x * z + w * y),
        s0 * 2.0 * (x * y + w * z), s1 * (1.0 - 2.0 * (x * x + z * z)), s2 * 2.0 * (y * z - w * x),
        s0 * 2.0 * (x * z - w * y), s1 * 2.0 * (y * z + w * x), s2 * (1.0 - 2.0 * (x * x + y * y)),
    )  # fmt: skip
    return axes, inverse_norm


@triton.jit
def screen_axes(axes, camera, z, u, v):
    """t₁ and t₂, the projection's rows, and m₁ and m₂, the screen's axes: four times three."""
    fx_z, fy_z = camera[15] / z, camera[16] / z
    t0 = fx_z * (camera[0] - u * camera[6])
    t1 = fx_z * (camera[1] - u * camera[7])
    t2 = fx_z * (camera[2] - u * camera[8])
    t3 = fy_z * (camera[3] - v * camera[6])
    t4 = fy_z * (camera[4] - v * camera[7])
    t5 = fy_z * (camera[5] - v * camera[8])
    m0 = t0 * axes[0] + t1 * axes[3] + t2 * axes[6]
    m1 = t0 * axes[1] + t1 * axes[4] + t2 * axes[7]
    m2 = t0 * axes[2] + t1 * axes[5] + t2 * axes[8]
    m3 = t3 * axes[0] + t4 * axes[3] + t5 * axes[6]
    m4 = t3 * axes[1] + t4 * axes[4] + t5 * axes[7]
    m5 = t3 * axes[2] + t4 * axes[5] + t5 * axes[8]
    return (t0, t1, t2), (t3, t4, t5), (m0, m1, m2), (m3, m4, m5)


@triton.jit
def above_zero(channel):
    """A channel, clamped at 0. A NaN stays one: the loss must show it."""
    return tl.maximum(channel, 0.0, propagate_nan=tl.PropagateNan.ALL)


@triton.jit(do_not_specialize=["camera_count", "count", "width", "height"])
def project_kernel(
    means, log_scales, quaternions, opacity_logits, sh_dc, sh_rest,
    cameras, camera_count, count, width, height, records, radii,
    DEGREE: tl.constexpr, REST: tl.constexpr, BLOCK: tl.constexpr,
):  # fmt: skip
    """One program projects ``BLOCK`` Gaussians for one camera; those for all cameras are neighbours."""
    index = tl.program_id(0) % camera_count
    n = tl.program_id(0) // camera_count * BLOCK + tl.arange(0, BLOCK)
    here = n < count
    camera = load_camera(cameras + index * _CAMERA_SIZE)
    px, py, pz = load_3(means, n, here)
    l0, l1, l2 = load_3(log_scales, n, here)
    quaternion = load_4(quaternions, n, here)
    opacity = 1.0 / (1.0 + tl.exp(-tl.load(opacity_logits + n, mask=here, other=0.0)))

    x = camera[0] * px + camera[1] * py + camera[2] * pz + camera[9]
    y = camera[3] * px + camera[4] * py + camera[5] * pz + camera[10]
    depth = camera[6] * px + camera[7] * py + camera[8] * pz + camera[11]
    # Comparisons are such that a NaN is culled.
    visible = here & (depth >= NEAR) & (opacity >= LEAST_ALPHA)
    z = tl.where(visible, depth, 1.0)
    u, _ = screen_direction(x, z, camera[15], camera[17], width)
    v, _ = screen_direction(y, z, camera[16], camera[18], height)
    center_x = camera[15] * x / z + camera[17]
    center_y = camera[16] * y / z + camera[18]

    axes, _ = scaled_axes(quaternion, tl.exp(l0), tl.exp(l1), tl.exp(l2))
    _, _, m, k = screen_axes(axes, camera, z, u, v)
    xx = m[0] * m[0] + m[1] * m[1] + m[2] * m[2]
    xy = m[0] * k[0] + m[1] * k[1] + m[2] * k[2]
    yy = k[0] * k[0] + k[1] * k[1] + k[2] * k[2]
    c0 = m[1] * k[2] - m[2] * k[1]
    c1 = m[2] * k[0] - m[0] * k[2]
    c2 = m[0] * k[1] - m[1] * k[0]
    determinant = c0 * c0 + c1 * c1 + c2 * c2 + (xx + yy) * BLUR + BLUR * BLUR
    xx += BLUR
    yy += BLUR
    reach = tl.sqrt(2.0 * tl.log(tl.maximum(opacity / LEAST_ALPHA, 1.0)))
    extent_x, extent_y = reach * tl.sqrt(xx), reach * tl.sqrt(yy)
    visible &= (center_x + extent_x > 0.0) & (center_x - extent_x < width)
    visible &= (center_y + extent_y > 0.0) & (center_y - extent_y < height)
    visible &= determinant < 1e30

    at = index * count.to(tl.int64) + n
    tl.store(radii + at, tl.where(visible, tl.maximum(extent_x, extent_y), 0.0), mask=here)

    red, green, blue = load_3(sh_dc, n, visible)
    red, green, blue = 0.5 + red * C0, 0.5 + green * C0, 0.5 + blue * C0
    if DEGREE > 0:
        dx, dy, dz, _ = view_direction(px, py, pz, camera)
        values = basis(dx, dy, dz, DEGREE)
        for k in tl.static_range((DEGREE + 1) * (DEGREE + 1) - 1):
            red += values[k] * coefficient(sh_rest, n, k, 0, visible, REST)
            green += values[k] * coefficient(sh_rest, n, k, 1, visible, REST)
            blue += values[k] * coefficient(sh_rest, n, k, 2, visible, REST)
    record = row_of_16(
        center_x, center_y, tl.sqrt(yy / determinant) * SQRT_HALF, xy / yy, tl.sqrt(1.0 / yy) * SQRT_HALF,
        opacity, above_zero(red), above_zero(green), above_zero(blue), depth,
        extent_x, extent_y, reach * tl.sqrt(determinant / yy), reach * tl.sqrt(determinant / xx),
        xy / yy, xy / xx,
    )  # fmt: skip
    columns = tl.arange(0, _RECORD_SIZE)
    tl.store(records + at[:, None] * _RECORD_SIZE + columns[None, :], record, mask=visible[:, None])
