"""Carry gradients of screen records back to the parameters of the Gaussians: ``projection`` differentiated.

Bytes per Gaussian and camera that sees it: reads 28 of its gradient, 20 of its record and 40 of its
parameters; 4 where it is culled. Reads 12 and writes 44 per Gaussian, once for all cameras.
"""

import torch
import triton
import triton.language as tl
from torch import Tensor

from fvs_engine.splat.conventions import (
    CENTER_X,
    CENTER_Y,
    DEPTH,
    FACTOR_A,
    FACTOR_B,
    FACTOR_K,
    GRADIENT_SIZE,
    OPACITY,
    RECORD_SIZE,
)  # fmt: skip
from fvs_engine.splat.gaussians import Gaussians
from fvs_engine.splat.triton_kernels.colors_backward import colors_backward
from fvs_engine.splat.triton_kernels.projection import (
    CAMERA_SIZE,
    Projected,
    load_3,
    load_4,
    load_camera,
    scaled_axes,
    screen_axes,
    screen_direction,
    store_3,
)
from fvs_engine.splat.triton_kernels.rows import row_of_4

BLOCK = 128

_CAMERA_SIZE, _RECORD_SIZE = tl.constexpr(CAMERA_SIZE), tl.constexpr(RECORD_SIZE)
_GRADIENT_SIZE = tl.constexpr(GRADIENT_SIZE)
_CENTER_X, _CENTER_Y, _DEPTH = tl.constexpr(CENTER_X), tl.constexpr(CENTER_Y), tl.constexpr(DEPTH)
_A, _K, _B, _OPACITY = (
    tl.constexpr(FACTOR_A), tl.constexpr(FACTOR_K), tl.constexpr(FACTOR_B), tl.constexpr(OPACITY)
)  # fmt: skip


def project_backward(
    gaussians: Gaussians,
    cameras: Tensor,
    size: tuple[int, int],
    degree: int,
    projected: Projected,
    gradients: Tensor,
) -> dict[str, Tensor]:
    """Name → gradient, named as by ``Gaussians.tensors``, given ``gradients`` [C, N, 10] of the records.

    It is the sum over the cameras. The other arguments are those of ``project``, and what it returned.
    """
    found = {name: torch.empty_like(tensor) for name, tensor in gaussians.tensors().items()}
    count = len(gaussians)
    if count:
        colors_backward(gaussians, cameras, degree, projected, gradients, found)
        project_backward_kernel[(triton.cdiv(count, BLOCK),)](
            gaussians.means, gaussians.log_scales, gaussians.quaternions_wxyz,
            cameras, len(cameras), count, *size, projected.records, projected.radii, gradients,
            found["means"], found["log_scales"], found["quaternions_wxyz"], found["opacity_logits"],
            BLOCK=BLOCK,
        )  # fmt: skip
    return found


@triton.jit
def linearise(px, py, pz, log_scales, quaternion, z, camera, width, height):
    """What gradients go through: (x, y), (are u, v held), R S and 1 / |quaternion|, t₁, t₂, m₁, m₂."""
    x = camera[0] * px + camera[1] * py + camera[2] * pz + camera[9]
    y = camera[3] * px + camera[4] * py + camera[5] * pz + camera[10]
    u, u_held = screen_direction(x, z, camera[15], camera[17], width)
    v, v_held = screen_direction(y, z, camera[16], camera[18], height)
    axes, inverse_norm = scaled_axes(
        quaternion, tl.exp(log_scales[0]), tl.exp(log_scales[1]), tl.exp(log_scales[2])
    )
    t, s, m, k = screen_axes(axes, camera, z, u, v)
    return (x, y), (u_held, v_held), axes, inverse_norm, t, s, m, k


@triton.jit
def covariance_gradient(a, k, b, g_a, g_k, g_b, m1, m2):
    """The gradients of m₁ and m₂, given those of the factors A, k and B."""
    # With V = Σ_xx − Σ_xy² / Σ_yy: A = √½ V^−½.
    inverse_yy = 2.0 * b * b
    g_v = -a * a * a * g_a
    g_xy = g_k * inverse_yy - 2.0 * k * g_v
    g_yy = k * k * g_v - (k * g_k + 0.5 * b * g_b) * inverse_yy
    g_m1 = (
        2.0 * g_v * m1[0] + g_xy * m2[0],
        2.0 * g_v * m1[1] + g_xy * m2[1],
        2.0 * g_v * m1[2] + g_xy * m2[2],
    )  # fmt: skip
    g_m2 = (
        2.0 * g_yy * m2[0] + g_xy * m1[0],
        2.0 * g_yy * m2[1] + g_xy * m1[1],
        2.0 * g_yy * m2[2] + g_xy * m1[2],
    )  # fmt: skip
    return g_m1, g_m2


@triton.jit
def position_gradient(xy, z, held, axes, t1, t2, g_m1, g_m2, g_center_x, g_center_y, g_depth, camera):
    """The gradient of the position in the model frame, given those of m₁, m₂, the centre and the depth."""
    p0 = g_m1[0] * axes[0] + g_m1[1] * axes[1] + g_m1[2] * axes[2]
    p1 = g_m1[0] * axes[3] + g_m1[1] * axes[4] + g_m1[2] * axes[5]
    p2 = g_m1[0] * axes[6] + g_m1[1] * axes[7] + g_m1[2] * axes[8]
    q0 = g_m2[0] * axes[0] + g_m2[1] * axes[1] + g_m2[2] * axes[2]
    q1 = g_m2[0] * axes[3] + g_m2[1] * axes[4] + g_m2[2] * axes[5]
    q2 = g_m2[0] * axes[6] + g_m2[1] * axes[7] + g_m2[2] * axes[8]
    inverse_z = 1.0 / z
    g_u = -camera[15] * inverse_z * (p0 * camera[6] + p1 * camera[7] + p2 * camera[8])
    g_v = -camera[16] * inverse_z * (q0 * camera[6] + q1 * camera[7] + q2 * camera[8])
    g_u, g_v = tl.where(held[0], 0.0, g_u), tl.where(held[1], 0.0, g_v)
    g_z = g_depth - inverse_z * (p0 * t1[0] + q0 * t2[0] + p1 * t1[1] + q1 * t2[1] + p2 * t1[2] + q2 * t2[2])
    g_x = (g_u + g_center_x * camera[15]) * inverse_z
    g_y = (g_v + g_center_y * camera[16]) * inverse_z
    g_z -= (g_x * xy[0] + g_y * xy[1]) * inverse_z
    return (
        camera[0] * g_x + camera[3] * g_y + camera[6] * g_z,
        camera[1] * g_x + camera[4] * g_y + camera[7] * g_z,
        camera[2] * g_x + camera[5] * g_y + camera[8] * g_z,
    )


@triton.jit
def quaternion_gradient(quaternion, inverse_norm, scales, t1, t2, g_m1, g_m2):
    """The gradient of the unnormalised quaternion, given those of m₁ and m₂."""
    g0, g1, g2 = scales[0] * g_m1[0], scales[1] * g_m1[1], scales[2] * g_m1[2]
    h0, h1, h2 = scales[0] * g_m2[0], scales[1] * g_m2[1], scales[2] * g_m2[2]
    r00, r01, r02 = g0 * t1[0] + h0 * t2[0], g1 * t1[0] + h1 * t2[0], g2 * t1[0] + h2 * t2[0]
    r10, r11, r12 = g0 * t1[1] + h0 * t2[1], g1 * t1[1] + h1 * t2[1], g2 * t1[1] + h2 * t2[1]
    r20, r21, r22 = g0 * t1[2] + h0 * t2[2], g1 * t1[2] + h1 * t2[2], g2 * t1[2] + h2 * t2[2]
    w, x, y, z = quaternion
    w, x, y, z = w * inverse_norm, x * inverse_norm, y * inverse_norm, z * inverse_norm
    gw = 2.0 * (z * (r10 - r01) + y * (r02 - r20) + x * (r21 - r12))
    gx = 2.0 * (y * (r01 + r10) + z * (r02 + r20) + w * (r21 - r12) - 2.0 * x * (r11 + r22))
    gy = 2.0 * (x * (r01 + r10) + z * (r12 + r21) + w * (r02 - r20) - 2.0 * y * (r00 + r22))
    gz = 2.0 * (x * (r02 + r20) + y * (r12 + r21) + w * (r10 - r01) - 2.0 * z * (r00 + r11))
    along = gw * w + gx * x + gy * y + gz * z
    return (
        (gw - along * w) * inverse_norm, (gx - along * x) * inverse_norm,
        (gy - along * y) * inverse_norm, (gz - along * z) * inverse_norm,
    )  # fmt: skip


@triton.jit(do_not_specialize=["camera_count", "count", "width", "height"])
def project_backward_kernel(
    means, log_scales, quaternions,
    cameras, camera_count, count, width, height, records, radii, gradients,
    g_means, g_log_scales, g_quaternions, g_opacity_logits,
    BLOCK: tl.constexpr,
):  # fmt: skip
    """One program carries the gradients of ``BLOCK`` Gaussians back; adds to ``g_means``."""
    n = tl.program_id(0) * BLOCK + tl.arange(0, BLOCK)
    here = n < count
    zero = tl.zeros((BLOCK,), tl.float32)
    mean_0, mean_1, mean_2 = load_3(g_means, n, here)
    scale_0, scale_1, scale_2 = zero, zero, zero
    quaternion_0, quaternion_1, quaternion_2, quaternion_3 = zero, zero, zero, zero
    logit = zero
    for index in range(camera_count):
        at = index * count.to(tl.int64) + n
        seen = here & (tl.load(radii + at, mask=here, other=0.0) > 0.0)
        camera = load_camera(cameras + index * _CAMERA_SIZE)
        record, gradient = records + at * _RECORD_SIZE, gradients + at * _GRADIENT_SIZE
        # What is not seen reads zeros, and a depth of 1: all that it adds is zero.
        px, py, pz = load_3(means, n, seen)
        quaternion = load_4(quaternions, n, seen)
        log_scale = load_3(log_scales, n, seen)
        z = tl.load(record + _DEPTH, mask=seen, other=1.0)
        xy, held, axes, inverse_norm, t1, t2, m1, m2 = linearise(
            px, py, pz, log_scale, quaternion, z, camera, width, height
        )
        g_m1, g_m2 = covariance_gradient(
            tl.load(record + _A, mask=seen, other=0.0),
            tl.load(record + _K, mask=seen, other=0.0),
            tl.load(record + _B, mask=seen, other=0.0),
            tl.load(gradient + _A, mask=seen, other=0.0),
            tl.load(gradient + _K, mask=seen, other=0.0),
            tl.load(gradient + _B, mask=seen, other=0.0),
            m1, m2,
        )  # fmt: skip
        scale_0 += g_m1[0] * m1[0] + g_m2[0] * m2[0]
        scale_1 += g_m1[1] * m1[1] + g_m2[1] * m2[1]
        scale_2 += g_m1[2] * m1[2] + g_m2[2] * m2[2]
        scales = (tl.exp(log_scale[0]), tl.exp(log_scale[1]), tl.exp(log_scale[2]))
        g_quaternion = quaternion_gradient(quaternion, inverse_norm, scales, t1, t2, g_m1, g_m2)
        quaternion_0 += g_quaternion[0]
        quaternion_1 += g_quaternion[1]
        quaternion_2 += g_quaternion[2]
        quaternion_3 += g_quaternion[3]
        g_mean = position_gradient(
            xy, z, held, axes, t1, t2, g_m1, g_m2,
            tl.load(gradient + _CENTER_X, mask=seen, other=0.0),
            tl.load(gradient + _CENTER_Y, mask=seen, other=0.0),
            tl.load(gradient + _DEPTH, mask=seen, other=0.0),
            camera,
        )  # fmt: skip
        mean_0 += g_mean[0]
        mean_1 += g_mean[1]
        mean_2 += g_mean[2]
        opacity = tl.load(record + _OPACITY, mask=seen, other=0.0)
        logit += tl.load(gradient + _OPACITY, mask=seen, other=0.0) * opacity * (1.0 - opacity)

    store_3(g_means, n, mean_0, mean_1, mean_2, here)
    store_3(g_log_scales, n, scale_0, scale_1, scale_2, here)
    columns = tl.arange(0, 4)
    row = row_of_4(quaternion_0, quaternion_1, quaternion_2, quaternion_3)
    tl.store(g_quaternions + 4 * n[:, None] + columns[None, :], row, mask=here[:, None])
    tl.store(g_opacity_logits + n, logit, mask=here)
