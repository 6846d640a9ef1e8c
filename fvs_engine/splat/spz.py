"""Gaussians in Niantic's SPZ: a tenth of a PLY, for viewers and slow connections.

Little-endian, gzipped: a header, then all positions (three 24-bit fixed-point numbers each), opacities,
degree-0 colours, scales, rotations (version 3: the smallest three components of the quaternion, 10 bits
each, above them which one is missing) and harmonics (coefficient by coefficient, red, green and blue of
each). The axes in the file are right, up, back; those of PLY and of the engine are right, down, forward, so y
and z are negated, and with them the harmonics that are odd in y and z. Source: the format's description,
https://github.com/nianticlabs/spz (README), version 3.
"""

import gzip
import struct
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fvs_engine.files.atomic import write_bytes_atomically
from fvs_engine.splat.gaussians import Gaussians

Floats = NDArray[np.float32]
Bytes = NDArray[np.uint8]

_HEADER = struct.Struct("<IIIBBBB")  # magic, version, Gaussians, degree, fractional bits, flags, reserved
_MAGIC, _VERSION = 0x5053474E, 3
_MAX_FIXED = 2**23 - 1
_MAX_FRACTIONAL_BITS = 20
_COLOR_SCALE = 0.15
_SCALE_STEPS, _SCALE_OFFSET = 16.0, 10.0
_MAGNITUDE = 511.0
"""Code of a quaternion component of 1/√2, the largest possible value of the three smallest ones."""
_SH_STEPS = np.array([8.0] * 3 + [16.0] * 12, np.float32)[:, None]
"""Steps of the harmonics, coarser than a byte's, which compress better: 5 bits for degree 1, 4 bits above."""
_AXES = np.array([1.0, -1.0, -1.0], np.float32)
_SH_SIGNS = np.array([-1, -1, 1, -1, 1, 1, -1, 1, -1, 1, -1, -1, 1, -1, 1], np.float32)[:, None]
"""The parity of the harmonics of degree 1 to 3 when y and z are negated."""


def write_spz(path: Path, gaussians: Gaussians) -> None:
    """Write the Gaussians; the file appears whole or not at all.

    Raises ``StorageError`` when the file cannot be written.
    """
    write_bytes_atomically(path, spz_content(gaussians))


def spz_content(gaussians: Gaussians) -> bytes:
    """The bytes of a file with the Gaussians.

    Positions get as many fractional bits as the farthest Gaussian leaves.
    """
    columns = {name: tensor.detach().cpu().numpy() for name, tensor in gaussians.tensors().items()}
    bits = _fractional_bits(columns["means"])
    header = _HEADER.pack(_MAGIC, _VERSION, len(gaussians), gaussians.sh_degree, bits, 0, 0)
    opacities = 1.0 / (1.0 + np.exp(-columns["opacity_logits"].astype(np.float64)))
    parts = (
        _fixed_point(columns["means"] * _AXES, bits),
        _byte(opacities * 255.0),
        _byte((columns["sh_dc"] * _COLOR_SCALE + 0.5) * 255.0),
        _byte((columns["log_scales"] + _SCALE_OFFSET) * _SCALE_STEPS),
        _smallest_three(columns["quaternions_wxyz"]),
        _harmonics(columns["sh_rest"]),
    )
    content = header + b"".join(part.tobytes() for part in parts)
    return gzip.compress(content, compresslevel=6, mtime=0)


def position_step(gaussians: Gaussians) -> float:
    """The step to which a file with these Gaussians rounds their positions, in their unit."""
    return float(2.0 ** -_fractional_bits(gaussians.means.detach().cpu().numpy()))


def _fractional_bits(means: Floats) -> int:
    farthest = max(float(np.abs(means).max(initial=0.0)), 1e-3)
    return int(np.clip(np.floor(np.log2(_MAX_FIXED / farthest)), 0, _MAX_FRACTIONAL_BITS))


def _byte(values: NDArray[np.floating]) -> Bytes:
    return np.clip(np.round(values), 0, 255).astype(np.uint8)


def _fixed_point(positions: Floats, bits: int) -> Bytes:
    fixed = np.clip(np.round(positions.astype(np.float64) * 2.0**bits), -_MAX_FIXED, _MAX_FIXED)
    return np.ascontiguousarray(fixed.astype("<i4").view(np.uint8).reshape(-1, 3, 4)[:, :, :3])


def _smallest_three(quaternions_wxyz: Floats) -> NDArray[np.uint32]:
    """Which of x, y, z, w is largest, in the two highest bits; below them sign and magnitude of the rest."""
    quaternions = np.roll(quaternions_wxyz.astype(np.float64), -1, axis=1)
    quaternions[:, :3] *= _AXES
    lengths = np.linalg.norm(quaternions, axis=1, keepdims=True)
    unit = np.where(lengths > 0, quaternions / np.where(lengths > 0, lengths, 1.0), [0.0, 0.0, 0.0, 1.0])
    largest = np.abs(unit).argmax(axis=1)
    unit *= np.where(np.take_along_axis(unit, largest[:, None], axis=1) < 0, -1.0, 1.0)
    packed = largest.astype("<u4")
    for component in range(4):
        value = unit[:, component]
        magnitude = np.minimum(np.round(np.abs(value) * np.sqrt(2.0) * _MAGNITUDE), _MAGNITUDE)
        bits = (value < 0).astype("<u4") << 9 | magnitude.astype("<u4")
        packed = np.where(component == largest, packed, packed << 10 | bits).astype("<u4")
    return np.asarray(packed, np.uint32)


def _harmonics(sh_rest: Floats) -> Bytes:
    """Bytes [N, K - 1, 3], 128 for 0."""
    count = sh_rest.shape[1]
    steps = _SH_STEPS[:count]
    values = np.round(sh_rest * _SH_SIGNS[:count] * 128.0) + 128.0
    return _byte(np.floor((values + steps / 2.0) / steps) * steps)
