"""Gaussians in Niantic's SPZ: a tenth of a PLY, for viewers and for bad connections.

Little-endian, gzipped: a header, then all positions (three 24-bit fixed-point numbers each), opacities,
degree-0 colours, scales, rotations (version 3: the smallest three components of the quaternion, 10 bits
each, above them which one is missing) and harmonics (coefficient by coefficient, red, green and blue of
each). The axes in the file are right, up, back; those of PLY and of the engine are right, down, forward, so y
and z are negated, and with them the harmonics that are odd in y and z. Source: the format's description,
https://github.com/nianticlabs/spz (README), version 3.
"""

import gzip
import struct
import zlib
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from fvs_engine.errors import InvalidInputError
from fvs_engine.files.atomic import replacing
from fvs_engine.splat.gaussians import Gaussians
from fvs_engine.splat.settings import sh_coefficient_count

Floats = NDArray[np.float32]
Bytes = NDArray[np.uint8]

_HEADER = struct.Struct("<IIIBBBB")  # magic, version, Gaussians, degree, fractional bits, flags, reserved
_MAGIC, _VERSION = 0x5053474E, 3
_MAX_GAUSSIANS = 10_000_000
_MAX_FIXED = 2**23 - 1
_MAX_FRACTIONAL_BITS = 20
_COLOR_SCALE = 0.15
_SCALE_STEPS, _SCALE_OFFSET = 16.0, 10.0
_MAGNITUDE = 511.0
"""Of a quaternion's component at 1/√2, the most that one of the smallest three can have."""
_SH_STEPS = np.array([8.0] * 3 + [16.0] * 12, np.float32)[:, None]
"""Coarser steps than a byte has, 5 bits for degree 1 and 4 bits above, which compress better."""
_AXES = np.array([1.0, -1.0, -1.0], np.float32)
_SH_SIGNS = np.array([-1, -1, 1, -1, 1, 1, -1, 1, -1, 1, -1, -1, 1, -1, 1], np.float32)[:, None]
"""The parity of the harmonics of degree 1 to 3 when y and z are negated."""


def write_spz(path: Path, gaussians: Gaussians) -> None:
    """Write the Gaussians; the file appears whole or not at all.

    Positions get as many fractional bits as the farthest Gaussian leaves. Raises ``StorageError`` when the
    file cannot be written.
    """
    columns = {name: tensor.detach().cpu().numpy() for name, tensor in gaussians.tensors().items()}
    farthest = max(float(np.abs(columns["means"]).max(initial=0.0)), 1e-3)
    bits = int(np.clip(np.floor(np.log2(_MAX_FIXED / farthest)), 0, _MAX_FRACTIONAL_BITS))
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
    with replacing(path) as temporary:
        temporary.write_bytes(gzip.compress(content, compresslevel=6, mtime=0))


def read_spz(path: Path) -> Gaussians:
    """Read Gaussians of version 3 and any degree up to 3; opacities of 0 and 1 become nearly so.

    Raises ``InvalidInputError`` for anything else, and for files that are cut short or go on too long.
    """
    try:
        with gzip.open(path, "rb") as file:
            head = file.read(_HEADER.size)
            count, degree, bits = _require_header(path, head)
            size = count * (9 + 1 + 3 + 3 + 4 + 3 * (sh_coefficient_count(degree) - 1))
            body = np.frombuffer(file.read(size + 1), np.uint8)
    except FileNotFoundError:
        raise InvalidInputError(f"{path}: there is no such file.") from None
    except (OSError, EOFError, zlib.error) as error:
        raise InvalidInputError(f"{path} is not an SPZ file: {error}.") from error
    if len(body) != size:
        raise InvalidInputError(f"{path} is cut short, or longer than its header says.")
    widths = (9, 1, 3, 3, 4, size // max(count, 1) - 20)
    ends = np.cumsum([width * count for width in widths])
    means, opacities, colors, scales, rotations, rest = (
        part.reshape(count, width) for part, width in zip(np.split(body, ends[:-1]), widths, strict=True)
    )
    shares = np.clip(opacities[:, 0] / 255.0, 0.5 / 255.0, 254.5 / 255.0)
    coefficients = sh_coefficient_count(degree) - 1
    harmonics = (rest.astype(np.float32).reshape(count, coefficients, 3) - 128.0) / 128.0
    return Gaussians(
        means=_tensor(_from_fixed_point(means, bits) * _AXES),
        log_scales=_tensor(scales / _SCALE_STEPS - _SCALE_OFFSET),
        quaternions_wxyz=_tensor(_from_smallest_three(rotations)),
        opacity_logits=_tensor(np.log(shares / (1.0 - shares))),
        sh_dc=_tensor((colors / 255.0 - 0.5) / _COLOR_SCALE),
        sh_rest=_tensor(harmonics * _SH_SIGNS[:coefficients]),
    )


def _require_header(path: Path, head: bytes) -> tuple[int, int, int]:
    """The number of Gaussians, the degree and the fractional bits."""
    if len(head) < _HEADER.size:
        raise InvalidInputError(f"{path} is cut short.")
    magic, version, count, degree, bits, _flags, reserved = _HEADER.unpack(head)
    if magic != _MAGIC or reserved != 0:
        raise InvalidInputError(f"{path} is not an SPZ file.")
    if version != _VERSION:
        raise InvalidInputError(f"{path} is SPZ of version {version}; version {_VERSION} is read.")
    if count > _MAX_GAUSSIANS or degree > 3 or bits > 23:
        raise InvalidInputError(
            f"{path} says that it has {count} Gaussians of degree {degree} with {bits} fractional bits; "
            f"{_MAX_GAUSSIANS}, 3 and 23 are the most."
        )
    return count, degree, bits


def _byte(values: NDArray[np.floating]) -> Bytes:
    return np.clip(np.round(values), 0, 255).astype(np.uint8)


def _fixed_point(positions: Floats, bits: int) -> Bytes:
    fixed = np.clip(np.round(positions.astype(np.float64) * 2.0**bits), -_MAX_FIXED, _MAX_FIXED)
    return np.ascontiguousarray(fixed.astype("<i4").view(np.uint8).reshape(-1, 3, 4)[:, :, :3])


def _from_fixed_point(content: Bytes, bits: int) -> NDArray[np.float64]:
    parts = content.reshape(-1, 3, 3).astype(np.int32)
    unsigned = parts[:, :, 0] | parts[:, :, 1] << 8 | parts[:, :, 2] << 16
    return np.asarray(np.where(unsigned >= 1 << 23, unsigned - (1 << 24), unsigned) / 2.0**bits)


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


def _from_smallest_three(content: Bytes) -> NDArray[np.float64]:
    packed = np.ascontiguousarray(content).view("<u4")[:, 0].copy()
    largest = (packed >> 30).astype(np.int64)
    found = np.zeros((len(packed), 4))
    for component in (3, 2, 1, 0):
        stored = component != largest
        value = (packed & 511) / (np.sqrt(2.0) * _MAGNITUDE) * np.where(packed >> 9 & 1, -1.0, 1.0)
        found[:, component] = np.where(stored, value, 0.0)
        packed = np.where(stored, packed >> 10, packed)
    missing = np.sqrt(np.clip(1.0 - (found**2).sum(axis=1), 0.0, 1.0))
    np.put_along_axis(found, largest[:, None], missing[:, None], axis=1)
    found[:, :3] *= _AXES
    return np.roll(found, 1, axis=1)


def _harmonics(sh_rest: Floats) -> Bytes:
    """Bytes [N, K - 1, 3], 128 for 0."""
    count = sh_rest.shape[1]
    steps = _SH_STEPS[:count]
    values = np.round(sh_rest * _SH_SIGNS[:count] * 128.0) + 128.0
    return _byte(np.floor((values + steps / 2.0) / steps) * steps)


def _tensor(values: NDArray[np.floating]) -> torch.Tensor:
    return torch.from_numpy(np.ascontiguousarray(values, np.float32))
