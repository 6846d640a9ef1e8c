"""Spherical harmonics of one direction and their derivatives, for kernels."""

import numpy as np
from numpy.typing import NDArray

from fvs_engine.compilation.kernels import F, kernel
from fvs_engine.splat.spherical_harmonics import SH_C0, SH_C1, SH_C2, SH_C3

Row = NDArray[np.float32]

C0, C1 = F(SH_C0), F(SH_C1)
C2A, C2B, C2C = F(SH_C2[0]), F(SH_C2[1]), F(SH_C2[2])
C3A, C3B, C3C, C3D, C3E = F(SH_C3[0]), F(SH_C3[1]), F(SH_C3[2]), F(SH_C3[3]), F(SH_C3[4])


@kernel
def basis(x: float, y: float, z: float, degree: int, out: Row) -> None:
    """Write the (degree + 1)² basis values of the unit direction (x, y, z) to ``out`` [16]."""
    out[0] = C0
    if degree < 1:
        return
    out[1] = -C1 * y
    out[2] = C1 * z
    out[3] = -C1 * x
    if degree < 2:
        return
    xx, yy, zz = x * x, y * y, z * z
    out[4] = C2A * x * y
    out[5] = -C2A * y * z
    out[6] = C2B * (zz + zz - xx - yy)
    out[7] = -C2A * x * z
    out[8] = C2C * (xx - yy)
    if degree < 3:
        return
    out[9] = -C3A * y * (F(3) * xx - yy)
    out[10] = C3B * x * y * z
    out[11] = -C3C * y * (F(4) * zz - xx - yy)
    out[12] = C3D * z * (F(2) * zz - F(3) * (xx + yy))
    out[13] = -C3C * x * (F(4) * zz - xx - yy)
    out[14] = C3E * z * (xx - yy)
    out[15] = -C3A * x * (xx - F(3) * yy)


@kernel
def basis_derivatives(x: float, y: float, z: float, degree: int, dx: Row, dy: Row, dz: Row) -> None:
    """Write the derivatives of ``basis`` along x, y and z to three rows [16]."""
    dx[0] = dy[0] = dz[0] = F(0)
    if degree < 1:
        return
    dx[1], dy[1], dz[1] = F(0), -C1, F(0)
    dx[2], dy[2], dz[2] = F(0), F(0), C1
    dx[3], dy[3], dz[3] = -C1, F(0), F(0)
    if degree < 2:
        return
    dx[4], dy[4], dz[4] = C2A * y, C2A * x, F(0)
    dx[5], dy[5], dz[5] = F(0), -C2A * z, -C2A * y
    dx[6], dy[6], dz[6] = F(-2) * C2B * x, F(-2) * C2B * y, F(4) * C2B * z
    dx[7], dy[7], dz[7] = -C2A * z, F(0), -C2A * x
    dx[8], dy[8], dz[8] = F(2) * C2C * x, F(-2) * C2C * y, F(0)
    if degree < 3:
        return
    xx, yy, zz = x * x, y * y, z * z
    dx[9], dy[9], dz[9] = F(-6) * C3A * x * y, F(-3) * C3A * (xx - yy), F(0)
    dx[10], dy[10], dz[10] = C3B * y * z, C3B * x * z, C3B * x * y
    dx[11], dy[11], dz[11] = F(2) * C3C * x * y, -C3C * (F(4) * zz - xx - F(3) * yy), F(-8) * C3C * y * z
    dx[12], dy[12] = F(-6) * C3D * x * z, F(-6) * C3D * y * z
    dz[12] = C3D * (F(6) * zz - F(3) * (xx + yy))
    dx[13], dy[13], dz[13] = -C3C * (F(4) * zz - F(3) * xx - yy), F(2) * C3C * x * y, F(-8) * C3C * x * z
    dx[14], dy[14], dz[14] = F(2) * C3E * x * z, F(-2) * C3E * y * z, C3E * (xx - yy)
    dx[15], dy[15], dz[15] = F(-3) * C3A * (xx - yy), F(6) * C3A * x * y, F(0)
