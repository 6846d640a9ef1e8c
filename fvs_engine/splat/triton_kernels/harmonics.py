"""Spherical harmonics of directions and their derivatives, for kernels in which a thread has a direction.

Values are tuples of 15 columns [B], those behind the constant; columns beyond the degree are zero.
Constants stand behind what they multiply: in front of it, Triton's interpreter makes no tensors of them.
"""

import triton
import triton.language as tl

from fvs_engine.splat.spherical_harmonics import SH_C0, SH_C1, SH_C2, SH_C3

C0, C1 = tl.constexpr(SH_C0), tl.constexpr(SH_C1)
C2A, C2B, C2C = tl.constexpr(SH_C2[0]), tl.constexpr(SH_C2[1]), tl.constexpr(SH_C2[2])
C3A, C3B, C3C = tl.constexpr(SH_C3[0]), tl.constexpr(SH_C3[1]), tl.constexpr(SH_C3[2])
C3D, C3E = tl.constexpr(SH_C3[3]), tl.constexpr(SH_C3[4])


@triton.jit
def basis(x, y, z, DEGREE: tl.constexpr):
    """The basis in the unit directions (x, y, z); ``DEGREE`` at least 1."""
    xx, yy, zz = x * x, y * y, z * z
    o = tl.zeros_like(x)
    v4, v5, v6, v7, v8, v9, v10, v11, v12, v13, v14, v15 = o, o, o, o, o, o, o, o, o, o, o, o
    v1 = y * -C1
    v2 = z * C1
    v3 = x * -C1
    if DEGREE >= 2:
        v4 = x * y * C2A
        v5 = y * z * -C2A
        v6 = (zz + zz - xx - yy) * C2B
        v7 = x * z * -C2A
        v8 = (xx - yy) * C2C
    if DEGREE >= 3:
        v9 = y * (3.0 * xx - yy) * -C3A
        v10 = x * y * z * C3B
        v11 = y * (4.0 * zz - xx - yy) * -C3C
        v12 = z * (2.0 * zz - 3.0 * (xx + yy)) * C3D
        v13 = x * (4.0 * zz - xx - yy) * -C3C
        v14 = z * (xx - yy) * C3E
        v15 = x * (xx - 3.0 * yy) * -C3A
    return (v1, v2, v3, v4, v5, v6, v7, v8, v9, v10, v11, v12, v13, v14, v15)


@triton.jit
def basis_derivatives(x, y, z, DEGREE: tl.constexpr):
    """The derivatives of ``basis`` along x, y and z."""
    xx, yy, zz = x * x, y * y, z * z
    o = tl.zeros_like(x)
    x4, x5, x6, x7, x8, x9, x10, x11, x12, x13, x14, x15 = o, o, o, o, o, o, o, o, o, o, o, o
    y4, y5, y6, y7, y8, y9, y10, y11, y12, y13, y14, y15 = o, o, o, o, o, o, o, o, o, o, o, o
    z4, z5, z6, z7, z8, z9, z10, z11, z12, z13, z14, z15 = o, o, o, o, o, o, o, o, o, o, o, o
    q = o + C1
    if DEGREE >= 2:
        x4, y4 = y * C2A, x * C2A
        y5, z5 = z * -C2A, y * -C2A
        x6, y6, z6 = x * (-2.0 * C2B), y * (-2.0 * C2B), z * (4.0 * C2B)
        x7, z7 = z * -C2A, x * -C2A
        x8, y8 = x * (2.0 * C2C), y * (-2.0 * C2C)
    if DEGREE >= 3:
        x9, y9 = x * y * (-6.0 * C3A), (xx - yy) * (-3.0 * C3A)
        x10, y10, z10 = y * z * C3B, x * z * C3B, x * y * C3B
        x11, y11 = x * y * (2.0 * C3C), (4.0 * zz - xx - 3.0 * yy) * -C3C
        z11 = y * z * (-8.0 * C3C)
        x12, y12 = x * z * (-6.0 * C3D), y * z * (-6.0 * C3D)
        z12 = (6.0 * zz - 3.0 * (xx + yy)) * C3D
        x13, y13 = (4.0 * zz - 3.0 * xx - yy) * -C3C, x * y * (2.0 * C3C)
        z13 = x * z * (-8.0 * C3C)
        x14, y14 = x * z * (2.0 * C3E), y * z * (-2.0 * C3E)
        z14 = (xx - yy) * C3E
        x15, y15 = (xx - yy) * (-3.0 * C3A), x * y * (6.0 * C3A)
    dx = (o, o, -q, x4, x5, x6, x7, x8, x9, x10, x11, x12, x13, x14, x15)
    dy = (-q, o, o, y4, y5, y6, y7, y8, y9, y10, y11, y12, y13, y14, y15)
    dz = (o, q, o, z4, z5, z6, z7, z8, z9, z10, z11, z12, z13, z14, z15)
    return dx, dy, dz


@triton.jit
def coefficient(sh_rest, n, number, channel, mask, REST: tl.constexpr):
    """A coefficient [B] of ``sh_rest`` [N, REST, 3]. Neighbours in a row come from the cache."""
    return tl.load(sh_rest + (3 * REST) * n + (3 * number + channel), mask=mask, other=0.0)
