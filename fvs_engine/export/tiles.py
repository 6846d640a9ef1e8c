"""3D Tiles 1.1: one tile with the Gaussians, placed on the globe by its transform.

The vertices stay small, in metres from the origin; the transform is in double precision. CesiumJS shows
Gaussians if the tileset says that its content requires the extensions. Source: OGC 22-025r4.
"""

import json
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from fvs_engine.export.gltf import EXTENSION, GLTF_FROM_WORLD, SPZ_EXTENSION, write_spz_gltf
from fvs_engine.export.placement import Placement
from fvs_engine.files.atomic import write_text_atomically
from fvs_engine.splat.gaussians import Gaussians
from fvs_engine.splat.moved import moved

CONTENT = "tile.glb"

_REACH = 3.0
"""Standard deviations to which the extension draws a Gaussian."""


def write_tiles(path: Path, in_world: Gaussians, placement: Placement) -> None:
    """Write the tileset ``path`` of Gaussians in the world frame, and beside it its content.

    Raises ``StorageError`` when a file cannot be written.
    """
    write_spz_gltf(path.parent / CONTENT, moved(in_world, GLTF_FROM_WORLD))
    extensions = [EXTENSION, SPZ_EXTENSION]
    box, size_m = _box(in_world)
    document = {
        "asset": {"version": "1.1"},
        "extensionsUsed": ["3DTILES_content_gltf"],
        "extensions": {
            "3DTILES_content_gltf": {"extensionsUsed": extensions, "extensionsRequired": extensions}
        },
        "geometricError": size_m,
        "root": {
            "transform": placement.ecef_from_world.matrix.T.ravel().tolist(),  # column by column
            "boundingVolume": {"box": box},
            "geometricError": 0.0,
            "refine": "ADD",
            "content": {"uri": CONTENT},
        },
    }
    write_text_atomically(path, json.dumps(document, indent=1) + "\n")


def _box(gaussians: Gaussians) -> tuple[list[float], float]:
    """The box around all Gaussians as a centre and half axes, and its diagonal."""
    means = _numpy(gaussians.means)
    reach = _REACH * np.exp(_numpy(gaussians.log_scales).max(axis=1, keepdims=True))
    lower, upper = (means - reach).min(axis=0), (means + reach).max(axis=0)
    half = (upper - lower) / 2.0
    box = np.concatenate([(lower + upper) / 2.0, np.diag(half).ravel()])
    return box.tolist(), float(2.0 * np.linalg.norm(half))


def _numpy(tensor: Tensor) -> NDArray[np.float64]:
    return np.asarray(tensor.detach().cpu().numpy(), dtype=np.float64)
