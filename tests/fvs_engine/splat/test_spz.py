import gzip
import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from fvs_engine.splat.gaussians import Gaussians
from fvs_engine.splat.spherical_harmonics import sh_colors
from fvs_engine.splat.spz import write_spz

Make = Callable[..., Gaussians]
_AXES = np.array([1.0, -1.0, -1.0])


def _read(path: Path) -> Gaussians:
    """The Gaussians of an SPZ file, with the axes of the engine."""
    content = gzip.decompress(path.read_bytes())
    _magic, _version, count, degree, bits, _flags, _reserved = struct.unpack("<4sIIBBBB", content[:16])
    coefficients = (degree + 1) ** 2 - 1
    ends = np.cumsum([count * width for width in (9, 1, 3, 3, 4, 3 * coefficients)])
    parts = np.split(np.frombuffer(content[16:], np.uint8), ends)
    assert len(parts.pop()) == 0
    means, opacities, colors, scales, rotations, rest = (part.reshape(count, -1) for part in parts)
    whole = np.pad(means.reshape(-1, 3, 3), ((0, 0), (0, 0), (1, 0))).view("<i4")[:, :, 0] >> 8
    odd = np.array([-1, -1, 1, -1, 1, 1, -1, 1, -1, 1, -1, -1, 1, -1, 1])  # in y and z
    return Gaussians(
        means=torch.from_numpy((whole / 2.0**bits * _AXES).astype(np.float32)),
        log_scales=torch.from_numpy(scales.astype(np.float32) / 16 - 10),
        quaternions_wxyz=torch.from_numpy(_rotations(rotations.copy().view("<u4")[:, 0])),
        opacity_logits=torch.logit(torch.from_numpy(opacities[:, 0] / np.float32(255)), eps=1e-6),
        sh_dc=torch.from_numpy((colors / np.float32(255) - np.float32(0.5)) / np.float32(0.15)),
        sh_rest=torch.from_numpy(
            (rest.reshape(count, coefficients, 3).astype(np.float32) - 128)
            / 128
            * odd[:coefficients, None].astype(np.float32)
        ),
    )


def _rotations(packed: np.ndarray) -> np.ndarray:
    """Quaternions w, x, y, z from the smallest three of x, y, z, w."""
    found = np.zeros((len(packed), 4))
    for row, bits in zip(found, packed.tolist(), strict=True):
        largest = bits >> 30
        for component in (3, 2, 1, 0):
            if component != largest:
                row[component] = (bits & 511) / 511 / np.sqrt(2) * (-1 if bits >> 9 & 1 else 1)
                bits >>= 10
        row[largest] = np.sqrt(1 - (row**2).sum())
    found[:, :3] *= _AXES
    return np.roll(found, 1, axis=1).astype(np.float32)


def _angles_deg(one: torch.Tensor, other: torch.Tensor) -> np.ndarray:
    first, second = (Rotation.from_quat(np.roll(q.numpy(), -1, axis=1)) for q in (one, other))
    return np.rad2deg((first.inv() * second).magnitude())


@pytest.mark.parametrize("sh_degree", [0, 1, 2, 3])
def test_round_trip_is_within_the_quantisation(make_gaussians: Make, tmp_path: Path, sh_degree: int) -> None:
    model = make_gaussians(200, sh_degree)
    write_spz(tmp_path / "model.spz", model)
    again = _read(tmp_path / "model.spz")
    assert len(again) == 200
    assert again.sh_degree == sh_degree
    step = float(model.means.abs().max()) / 2**22
    np.testing.assert_allclose(again.means.numpy(), model.means.numpy(), atol=step)
    scales = model.log_scales.clamp(-10, 255 / 16 - 10)
    np.testing.assert_allclose(again.log_scales.numpy(), scales.numpy(), atol=1 / 32 + 1e-5)
    assert _angles_deg(again.quaternions_wxyz, model.quaternions_wxyz).max() < 0.25
    shown, wanted = torch.sigmoid(again.opacity_logits), torch.sigmoid(model.opacity_logits)
    np.testing.assert_allclose(shown.numpy(), wanted.numpy(), atol=0.51 / 255 + 1e-6)
    colors = model.sh_dc.clamp(-0.5 / 0.15, 0.5 / 0.15)
    np.testing.assert_allclose(again.sh_dc.numpy(), colors.numpy(), atol=0.51 / (255 * 0.15))
    rest = model.sh_rest.clamp(-1, 1)
    bounds = torch.tensor([4.5 / 128] * 3 + [8.5 / 128] * 12)[: rest.shape[1], None]
    assert ((again.sh_rest - rest).abs() <= bounds + 8 / 128 * (rest.abs() > 0.93)).all()


def test_the_bytes_are_those_of_the_format(tmp_path: Path) -> None:
    model = Gaussians(
        means=torch.tensor([[1.0, 2.0, 4.0]]),
        log_scales=torch.tensor([[-10.0, 0.0, 2.0]]),
        quaternions_wxyz=torch.tensor([[1.0, 0.0, 0.0, 0.0]]),
        opacity_logits=torch.tensor([0.0]),
        sh_dc=torch.zeros((1, 3)),
        sh_rest=torch.tensor([[[0.25, 0.5, -0.25], [0.5, 0.0, 0.0], [0.75, 0.0, 0.0]]]),
    )
    write_spz(tmp_path / "model.spz", model)
    content = gzip.decompress((tmp_path / "model.spz").read_bytes())
    assert struct.unpack("<4sIIBBBB", content[:16]) == (b"NGSP", 3, 1, 1, 20, 0, 0)
    x, y, z = (int.from_bytes(content[16 + 3 * k : 19 + 3 * k], "little", signed=True) for k in range(3))
    assert (x, y, z) == (1 << 20, -2 << 20, -4 << 20)  # right, up, back
    assert content[25] == 128
    assert list(content[26:29]) == [128] * 3
    assert list(content[29:32]) == [0, 160, 192]
    assert content[32:36] == b"\x00\x00\x00\xc0"  # the identity, as the reference reads it
    # y and z are negated, and with them their harmonics, which are the first and the second.
    assert list(content[36:]) == [96, 64, 160, 64, 128, 128, 224, 128, 128]


def test_a_model_looks_the_same_along_the_turned_axes(make_gaussians: Make, tmp_path: Path) -> None:
    """What the file says, read without turning the axes back, is the model turned by 180° about x."""
    model = make_gaussians(50, 3)
    model.sh_rest.uniform_(-0.9, 0.9, generator=torch.Generator().manual_seed(1))
    write_spz(tmp_path / "model.spz", model)
    content = gzip.decompress((tmp_path / "model.spz").read_bytes())
    stored = np.frombuffer(content[-50 * 45 :], np.uint8).reshape(50, 15, 3)
    sh_rest = torch.from_numpy((stored.astype(np.float32) - 128) / 128)
    directions = torch.nn.functional.normalize(torch.randn(50, 3, generator=torch.Generator().manual_seed(0)))
    turned = directions * torch.tensor([1.0, -1.0, -1.0])
    dc = torch.full((50, 3), 8.0)  # bright, so that no colour is clamped
    difference = sh_colors(dc, sh_rest, turned, 3) - sh_colors(dc, model.sh_rest, directions, 3)
    assert difference.abs().max() < 0.3
    unturned = sh_colors(dc, sh_rest, directions, 3) - sh_colors(dc, model.sh_rest, directions, 3)
    assert unturned.abs().max() > 1.0
