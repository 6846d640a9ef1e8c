"""Gaussians as binary glTF 2.0 with the extension KHR_gaussian_splatting.

Values are as the extension has them: unit quaternions x, y, z, w, linear sizes and opacities, harmonics with
the signs of 3DGS. Colours are sRGB as the photographs have them. ``COLOR_0`` shows points where a program
does not know the extension. Sources: https://github.com/KhronosGroup/glTF, glTF 2.0 and
extensions/2.0/Khronos/KHR_gaussian_splatting; for tiles the draft KHR_gaussian_splatting_compression_spz_2 in
pull request 2531, as CesiumJS reads it.
"""

import importlib.metadata
import json
import struct
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fvs_engine.files.atomic import write_bytes_atomically
from fvs_engine.geometry import SimilarityTransform
from fvs_engine.splat.gaussians import Gaussians
from fvs_engine.splat.moved import moved
from fvs_engine.splat.spherical_harmonics import SH_C0
from fvs_engine.splat.spz import spz_content

EXTENSION = "KHR_gaussian_splatting"
SPZ_EXTENSION = "KHR_gaussian_splatting_compression_spz_2"

GLTF_FROM_WORLD = SimilarityTransform(
    1.0, np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]]), np.zeros(3)
)
"""glTF has y up: x east, y up, z south."""
GLTF_FROM_CAMERA_AXES = SimilarityTransform(1.0, np.diag([1.0, -1.0, -1.0]), np.zeros(3))
"""From a frame whose y is down, as models and cameras have it; it is its own inverse."""

_COMPONENTS = {"f4": 5126, "u2": 5123, "u1": 5121}
_ARRAY_BUFFER = 34962
_POINTS = 0
_KINDS = {1: "SCALAR", 3: "VEC3", 4: "VEC4"}
_CHUNK = struct.Struct("<I4s")
_HEADER = struct.Struct("<4sII")

Columns = Mapping[str, NDArray[Any]]


def write_gltf(path: Path, gaussians: Gaussians) -> None:
    """Write Gaussians in glTF's axes (y up) as a GLB, in float32, whole or not at all.

    Raises ``StorageError`` when the file cannot be written.
    """
    columns = {**_colors(gaussians), **_attributes(gaussians)}
    buffer, views, accessors = bytearray(), [], []
    for values in columns.values():
        views.append(
            {"buffer": 0, "byteOffset": len(buffer), "byteLength": values.nbytes, "target": _ARRAY_BUFFER}
        )
        accessors.append({**_accessor(values), "bufferView": len(views) - 1})
        buffer += values.tobytes()
    extension = {"kernel": "ellipse", "colorSpace": "srgb_rec709_display"}
    document = _document(list(columns), accessors, extension) | {"bufferViews": views}
    write_bytes_atomically(path, _glb(document, bytes(buffer)))


def write_spz_gltf(path: Path, gaussians: Gaussians) -> None:
    """Write Gaussians in glTF's axes as a GLB that holds an SPZ, the only one that CesiumJS reads in tiles.

    It takes what SPZ stores for glTF's coordinates, colours and opacities from ``COLOR_0``, and a node's
    matrix even where it changes nothing. Raises ``StorageError`` when the file cannot be written.
    """
    content = spz_content(moved(gaussians, GLTF_FROM_CAMERA_AXES))
    hidden = {f"{EXTENSION}:OPACITY", f"{EXTENSION}:SH_DEGREE_0_COEF_0"}
    colors = {"COLOR_0": np.zeros((len(gaussians), 4), np.uint8)}  # bytes, or CesiumJS fails
    columns = {**colors, **_attributes(gaussians)}
    shown = {name: values for name, values in columns.items() if name not in hidden}
    extension = {
        "kernel": "ellipse",
        "colorSpace": "srgb_rec709_display",
        "extensions": {SPZ_EXTENSION: {"bufferView": 0}},
    }
    document = _document(list(shown), [_accessor(values) for values in shown.values()], extension)
    document["extensionsUsed"] = document["extensionsRequired"] = [EXTENSION, SPZ_EXTENSION]
    document["bufferViews"] = [{"buffer": 0, "byteLength": len(content)}]
    document["nodes"][0]["matrix"] = np.eye(4).ravel().tolist()
    write_bytes_atomically(path, _glb(document, content))


def _colors(gaussians: Gaussians) -> Columns:
    """Colours and opacities for programs without the extension; glTF's colours are linear."""
    shown = np.clip(_numpy(gaussians, "sh_dc") * SH_C0 + 0.5, 0.0, 1.0)
    linear = np.where(shown <= 0.04045, shown / 12.92, ((shown + 0.055) / 1.055) ** 2.4)
    colors = np.concatenate([linear, _opacities(gaussians)[:, None]], axis=1)
    return {"COLOR_0": np.round(colors * 65_535.0).astype("<u2")}


def _attributes(gaussians: Gaussians) -> Columns:
    quaternions = _numpy(gaussians, "quaternions_wxyz")
    lengths = np.linalg.norm(quaternions, axis=1, keepdims=True)
    unit = np.where(lengths > 0, quaternions / np.where(lengths > 0, lengths, 1.0), [1.0, 0.0, 0.0, 0.0])
    columns = {
        "POSITION": _numpy(gaussians, "means"),
        f"{EXTENSION}:ROTATION": np.roll(unit, -1, axis=1),
        f"{EXTENSION}:SCALE": np.exp(_numpy(gaussians, "log_scales")),
        f"{EXTENSION}:OPACITY": _opacities(gaussians),
        f"{EXTENSION}:SH_DEGREE_0_COEF_0": _numpy(gaussians, "sh_dc"),
    }
    rest = _numpy(gaussians, "sh_rest")
    for degree in range(1, gaussians.sh_degree + 1):
        for order in range(2 * degree + 1):
            columns[f"{EXTENSION}:SH_DEGREE_{degree}_COEF_{order}"] = rest[:, degree**2 - 1 + order]
    return {name: np.ascontiguousarray(values, dtype="<f4") for name, values in columns.items()}


def _numpy(gaussians: Gaussians, name: str) -> NDArray[np.float64]:
    return np.asarray(gaussians.tensors()[name].detach().cpu().numpy(), dtype=np.float64)


def _opacities(gaussians: Gaussians) -> NDArray[np.float64]:
    return np.asarray(1.0 / (1.0 + np.exp(-_numpy(gaussians, "opacity_logits"))))


def _accessor(values: NDArray[Any]) -> dict[str, Any]:
    accessor: dict[str, Any] = {
        "componentType": _COMPONENTS[values.dtype.str[1:]],
        "count": len(values),
        "type": _KINDS[values.shape[1] if values.ndim == 2 else 1],
    }
    if values.dtype.kind == "u":
        accessor["normalized"] = True
    elif values.ndim == 2:
        accessor |= {"min": values.min(axis=0).tolist(), "max": values.max(axis=0).tolist()}
    return accessor


def _document(names: list[str], accessors: list[dict[str, Any]], extension: Any) -> dict[str, Any]:
    return {
        "asset": {"version": "2.0", "generator": f"fvs {importlib.metadata.version('fvs')}"},
        "extensionsUsed": [EXTENSION],
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [
            {
                "primitives": [
                    {
                        "attributes": {name: index for index, name in enumerate(names)},
                        "mode": _POINTS,
                        "extensions": {EXTENSION: extension},
                    }
                ]
            }
        ],
        "accessors": accessors,
    }


def _glb(document: dict[str, Any], buffer: bytes) -> bytes:
    binary = buffer + b"\0" * (-len(buffer) % 4)
    text = json.dumps({**document, "buffers": [{"byteLength": len(buffer)}]}, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    chunks = (_CHUNK.pack(len(text), b"JSON"), text, _CHUNK.pack(len(binary), b"BIN\0"), binary)
    return _HEADER.pack(b"glTF", 2, _HEADER.size + sum(map(len, chunks))) + b"".join(chunks)
