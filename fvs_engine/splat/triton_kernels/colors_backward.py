"""Carry gradients of the colours of records back to the spherical harmonics and to the positions.

Bytes per Gaussian and camera that sees it: reads 12 each of its gradient and record, and with degree 3
192 of its parameters; 4 where it is culled. Writes 204 per Gaussian, once for all cameras.
"""

import triton
import triton.language as tl
from torch import Tensor

from fvs_engine.splat.conventions import BLUE, GRADIENT_SIZE, GREEN, RECORD_SIZE, RED
from fvs_engine.splat.gaussians import Gaussians
from fvs_engine.splat.triton_kernels.harmonics import C0, basis, basis_derivatives, coefficient
from fvs_engine.splat.triton_kernels.projection import (
    CAMERA_SIZE,
    Projected,
    load_3,
    load_camera,
    store_3,
    view_direction,
)  # fmt: skip
from fvs_engine.splat.triton_kernels.rows import row_of_16

BLOCK = 128

_CAMERA_SIZE, _RECORD_SIZE = tl.constexpr(CAMERA_SIZE), tl.constexpr(RECORD_SIZE)
_GRADIENT_SIZE = tl.constexpr(GRADIENT_SIZE)
_RED, _GREEN, _BLUE = tl.constexpr(RED), tl.constexpr(GREEN), tl.constexpr(BLUE)


def colors_backward(
    gaussians: Gaussians, cameras: Tensor, degree: int, projected: Projected, gradients: Tensor,
    found: dict[str, Tensor],
) -> None:  # fmt: skip
    """Write "sh_dc", "sh_rest" and the part of "means" of ``found``; see ``project_backward``."""
    count = len(gaussians)
    for index, camera in enumerate(cameras):
        colors_backward_kernel[(triton.cdiv(count, BLOCK),)](
            gaussians.means, gaussians.sh_rest, camera, count,
            projected.records[index], projected.radii[index], gradients[index],
            found["means"], found["sh_dc"], found["sh_rest"],
            DEGREE=degree, REST=gaussians.sh_rest.shape[1], ADD=index > 0, BLOCK=BLOCK,
        )  # fmt: skip


@triton.jit
def unclamped(gradient, record, column, mask):
    """The gradient [B] of a channel: max(colour, 0) passes none where it clamps."""
    mask = mask & (tl.load(record + column, mask=mask, other=0.0) > 0.0)
    return tl.load(gradient + column, mask=mask, other=0.0)


@triton.jit
def basis_row(x, y, z, DEGREE: tl.constexpr):
    """The basis behind the constant in the unit directions (x, y, z), [B, 16]; the last column is zero."""
    if DEGREE == 0:
        row = tl.zeros((x.shape[0], 16), tl.float32)
    else:
        v = basis(x, y, z, DEGREE)
        row = row_of_16(
            v[0], v[1], v[2], v[3], v[4], v[5], v[6], v[7],
            v[8], v[9], v[10], v[11], v[12], v[13], v[14], tl.zeros_like(x),
        )  # fmt: skip
    return row


@triton.jit
def store_rest(rest, n, row, red, green, blue, mask, REST: tl.constexpr, ADD: tl.constexpr):
    """Write ``row`` [B, 16] times each channel [B] to ``rest`` [N, REST, 3], or add it to what is there."""
    k = tl.arange(0, 16)
    inside = mask[:, None] & (k < REST)[None, :]
    at = rest + (3 * REST) * n[:, None] + (3 * k)[None, :]
    of_red, of_green, of_blue = row * red[:, None], row * green[:, None], row * blue[:, None]
    if ADD:
        of_red += tl.load(at, mask=inside, other=0.0)
        of_green += tl.load(at + 1, mask=inside, other=0.0)
        of_blue += tl.load(at + 2, mask=inside, other=0.0)
    tl.store(at, of_red, mask=inside)
    tl.store(at + 1, of_green, mask=inside)
    tl.store(at + 2, of_blue, mask=inside)


@triton.jit(do_not_specialize=["count"])
def colors_backward_kernel(
    means, sh_rest, camera, count, records, radii, gradients, g_means, g_dc, g_rest,
    DEGREE: tl.constexpr, REST: tl.constexpr, ADD: tl.constexpr, BLOCK: tl.constexpr,
):  # fmt: skip
    """One program carries the gradients of ``BLOCK`` Gaussians back: writes all, or adds to those seen."""
    n = tl.program_id(0) * BLOCK + tl.arange(0, BLOCK)
    here = n < count
    seen = here & (tl.load(radii + n, mask=here, other=0.0) > 0.0)
    record, gradient = records + n.to(tl.int64) * _RECORD_SIZE, gradients + n.to(tl.int64) * _GRADIENT_SIZE
    red = unclamped(gradient, record, _RED, seen)
    green = unclamped(gradient, record, _GREEN, seen)
    blue = unclamped(gradient, record, _BLUE, seen)
    written = here
    mean_0, mean_1, mean_2 = tl.zeros_like(red), tl.zeros_like(red), tl.zeros_like(red)
    dc_0, dc_1, dc_2 = red * C0, green * C0, blue * C0
    if ADD:
        written = seen
        mean_0, mean_1, mean_2 = load_3(g_means, n, seen)
        old_0, old_1, old_2 = load_3(g_dc, n, seen)
        dc_0, dc_1, dc_2 = dc_0 + old_0, dc_1 + old_1, dc_2 + old_2
    store_3(g_dc, n, dc_0, dc_1, dc_2, written)
    rest = tl.zeros((BLOCK, 16), tl.float32)
    if DEGREE > 0:
        # What is not seen reads zeros, and all that it adds is zero.
        px, py, pz = load_3(means, n, seen)
        x, y, z, scale = view_direction(px, py, pz, load_camera(camera))
        dx, dy, dz = basis_derivatives(x, y, z, DEGREE)
        g_x, g_y, g_z = tl.zeros_like(x), tl.zeros_like(x), tl.zeros_like(x)
        for k in tl.static_range((DEGREE + 1) * (DEGREE + 1) - 1):
            along = red * coefficient(sh_rest, n, k, 0, seen, REST)
            along += green * coefficient(sh_rest, n, k, 1, seen, REST)
            along += blue * coefficient(sh_rest, n, k, 2, seen, REST)
            g_x += dx[k] * along
            g_y += dy[k] * along
            g_z += dz[k] * along
        radial = g_x * x + g_y * y + g_z * z
        mean_0 += (g_x - radial * x) * scale
        mean_1 += (g_y - radial * y) * scale
        mean_2 += (g_z - radial * z) * scale
        rest = basis_row(x, y, z, DEGREE)
    store_3(g_means, n, mean_0, mean_1, mean_2, written)
    if REST > 0:
        store_rest(g_rest, n, rest, red, green, blue, written, REST, ADD)
