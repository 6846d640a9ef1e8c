import gzip
import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from random_gaussians import random_gaussians

from fvs_engine.export.gltf import write_gltf, write_spz_gltf
from fvs_engine.splat.gaussians import Gaussians

PREFIX = "KHR_gaussian_splatting:"
TYPES = {5126: "<f4", 5123: "<u2"}
WIDTHS = {"SCALAR": 1, "VEC3": 3, "VEC4": 4}


def _read(path: Path) -> tuple[Any, bytes]:
    content = path.read_bytes()
    magic, version, length = struct.unpack_from("<4sII", content)
    assert (magic, version, length) == (b"glTF", 2, len(content))
    size, kind = struct.unpack_from("<I4s", content, 12)
    assert (size % 4, kind) == (0, b"JSON")
    binary_size, kind = struct.unpack_from("<I4s", content, 20 + size)
    assert (binary_size, kind) == (len(content) - 28 - size, b"BIN\0")
    return json.loads(content[20 : 20 + size]), content[28 + size :]


def _attributes(path: Path) -> dict[str, np.ndarray]:
    document, binary = _read(path)
    found = {}
    for name, index in document["meshes"][0]["primitives"][0]["attributes"].items():
        accessor = document["accessors"][index]
        view = document["bufferViews"][accessor["bufferView"]]
        width = WIDTHS[accessor["type"]]
        kind = np.dtype(TYPES[accessor["componentType"]])
        assert view["byteOffset"] % 4 == 0
        assert view["byteLength"] == accessor["count"] * width * kind.itemsize
        values = np.frombuffer(binary, kind, accessor["count"] * width, view["byteOffset"])
        found[name] = values.reshape(-1, width)
        if "min" in accessor:
            np.testing.assert_array_equal(found[name].min(axis=0), np.float32(accessor["min"]))
            np.testing.assert_array_equal(found[name].max(axis=0), np.float32(accessor["max"]))
    return found


@pytest.mark.parametrize("degree", [0, 1, 2, 3])
def test_attributes_are_those_of_the_extension(tmp_path: Path, degree: int) -> None:
    model = random_gaussians(30, degree)
    write_gltf(tmp_path / "model.glb", model)
    found = _attributes(tmp_path / "model.glb")
    coefficients = [f"{PREFIX}SH_DEGREE_{d}_COEF_{n}" for d in range(degree + 1) for n in range(2 * d + 1)]
    names = ["COLOR_0", "POSITION", *(PREFIX + name for name in ("ROTATION", "SCALE", "OPACITY"))]
    assert list(found) == [*names, *coefficients]
    np.testing.assert_array_equal(found["POSITION"], model.means)
    quaternions = torch.nn.functional.normalize(model.quaternions_wxyz, dim=1)
    np.testing.assert_allclose(found[f"{PREFIX}ROTATION"], quaternions.roll(-1, dims=1), atol=1e-6)
    np.testing.assert_allclose(found[f"{PREFIX}SCALE"], model.log_scales.exp(), rtol=1e-6)
    np.testing.assert_allclose(found[f"{PREFIX}OPACITY"][:, 0], model.opacity_logits.sigmoid(), atol=1e-6)
    harmonics = np.stack([found[name] for name in coefficients], axis=1)
    np.testing.assert_array_equal(harmonics, torch.cat([model.sh_dc[:, None], model.sh_rest], dim=1))


def test_programs_without_the_extension_see_colours(tmp_path: Path) -> None:
    model = random_gaussians(1, 0)
    model.sh_dc = (torch.tensor([[0.5, 1.5, 0.0]]) - 0.5) / 0.28209479
    model.opacity_logits = torch.zeros(1)
    write_gltf(tmp_path / "model.glb", model)
    # glTF's colours are linear: sRGB's half is a fifth of the light.
    shown = _attributes(tmp_path / "model.glb")["COLOR_0"] / 65_535
    np.testing.assert_allclose(shown, [[0.21404, 1.0, 0.0, 0.5]], atol=1e-4)


def test_a_tile_has_an_spz_with_the_axes_of_gltf(tmp_path: Path) -> None:
    """As CesiumJS wants it: bytes for colours, harmonics from degree 1 on, and a matrix."""
    model = random_gaussians(20, 1)
    model.means = torch.tensor([[1.0, 2.0, 4.0]] * 20)
    write_spz_gltf(tmp_path / "tile.glb", model)
    document, binary = _read(tmp_path / "tile.glb")
    primitive = document["meshes"][0]["primitives"][0]
    assert list(primitive["attributes"]) == [
        *("COLOR_0", "POSITION", f"{PREFIX}ROTATION", f"{PREFIX}SCALE"),
        *(f"{PREFIX}SH_DEGREE_1_COEF_{n}" for n in range(3)),
    ]
    assert document["accessors"][0]["componentType"] == 5121
    assert all("bufferView" not in accessor for accessor in document["accessors"])
    extension = primitive["extensions"]["KHR_gaussian_splatting"]
    assert extension["extensions"] == {"KHR_gaussian_splatting_compression_spz_2": {"bufferView": 0}}
    assert np.array_equal(np.reshape(document["nodes"][0]["matrix"], (4, 4)), np.eye(4))
    content = gzip.decompress(binary[: document["bufferViews"][0]["byteLength"]])
    bits = content[13]
    stored = [int.from_bytes(content[16 + 3 * k : 19 + 3 * k], "little", signed=True) for k in range(3)]
    np.testing.assert_allclose(np.array(stored) / 2.0**bits, [1.0, 2.0, 4.0], atol=1e-5)


def test_a_rotation_of_length_0_is_none(tmp_path: Path) -> None:
    model = Gaussians(**random_gaussians(2, 0).tensors())
    model.quaternions_wxyz = torch.zeros(2, 4)
    write_gltf(tmp_path / "model.glb", model)
    rotations = _attributes(tmp_path / "model.glb")[f"{PREFIX}ROTATION"]
    np.testing.assert_array_equal(rotations, [[0.0, 0.0, 0.0, 1.0]] * 2)
