"""Gaussians in the PLY layout of the 3DGS release, which every splat viewer reads.

Properties, all float32: x y z, nx ny nz (zero), f_dc_0..2, f_rest_0..3(K − 1) − 1 (all of red, then green,
then blue), opacity (a logit), scale_0..2 (logarithms), rot_0..3 (wxyz).
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from plyfile import PlyData, PlyElement

from fvs_engine.errors import InvalidInputError
from fvs_engine.files.atomic import replacing
from fvs_engine.splat.gaussians import Gaussians
from fvs_engine.splat.settings import sh_coefficient_count

_MEANS = ("x", "y", "z")
_NORMALS = ("nx", "ny", "nz")
_DC = tuple(f"f_dc_{i}" for i in range(3))
_SCALES = tuple(f"scale_{i}" for i in range(3))
_ROTATION = tuple(f"rot_{i}" for i in range(4))


def write_ply(path: Path, gaussians: Gaussians, origin: Sequence[float] = (0.0, 0.0, 0.0)) -> None:
    """Write the Gaussians; the file appears whole or not at all.

    An ``origin`` [3] other than zero is in a comment of the header: ``origin X Y Z``. Raises
    ``StorageError`` when the file cannot be written.
    """
    count, rest = len(gaussians), gaussians.sh_rest.shape[1] * 3
    columns = {name: tensor.detach().cpu().numpy() for name, tensor in gaussians.tensors().items()}
    names = (*_MEANS, *_NORMALS, *_DC, *(f"f_rest_{i}" for i in range(rest)), "opacity", *_SCALES, *_ROTATION)
    table = np.concatenate(
        [
            columns["means"],
            np.zeros((count, 3), np.float32),
            columns["sh_dc"],
            columns["sh_rest"].transpose(0, 2, 1).reshape(count, rest),
            columns["opacity_logits"][:, None],
            columns["log_scales"],
            columns["quaternions_wxyz"],
        ],
        axis=1,
        dtype=np.float32,
    )
    vertices = table.view([(name, "<f4") for name in names]).reshape(count)
    comments = ["origin {!r} {!r} {!r}".format(*map(float, origin))] if any(origin) else []
    with replacing(path) as temporary:
        PlyData([PlyElement.describe(vertices, "vertex")], byte_order="<", comments=comments).write(
            str(temporary)
        )


def read_ply(path: Path) -> Gaussians:
    """Read Gaussians of any degree up to 3.

    Raises ``InvalidInputError`` naming what is wrong with the file: not a PLY, a property that is
    missing, a number of harmonics that fits no degree, or a value that is not finite.
    """
    try:
        vertices = PlyData.read(str(path))["vertex"].data
    except FileNotFoundError:
        raise InvalidInputError(f"{path}: there is no such file.", path=path) from None
    except Exception as error:  # damaged bytes can make the parser raise anything
        raise InvalidInputError(
            f"{path} cannot be read as a PLY with vertices: {error}",
            hint="Give a file in the 3DGS layout, such as `fvs` writes.",
            path=path,
        ) from error
    available = set(vertices.dtype.names or ())
    for name in (*_MEANS, *_DC, "opacity", *_SCALES, *_ROTATION):
        if name not in available:
            raise InvalidInputError(
                f"{path} has no vertex property {name!r}.", hint="Give a PLY in the 3DGS layout.", path=path
            )
    rest = sum(1 for name in available if name.startswith("f_rest_"))
    if rest not in {3 * (sh_coefficient_count(degree) - 1) for degree in range(4)}:
        raise InvalidInputError(
            f"{path} has {rest} f_rest_ properties; degrees 0 to 3 have 0, 9, 24 or 45.",
            hint="Give a PLY in the 3DGS layout.",
            path=path,
        )

    def columns(*names: str) -> torch.Tensor:
        values: NDArray[np.float32] = np.empty((len(vertices), len(names)), np.float32)
        for i, name in enumerate(names):
            if name not in available:
                raise InvalidInputError(
                    f"{path} has no vertex property {name!r}.",
                    hint="Give a PLY in the 3DGS layout.",
                    path=path,
                )
            values[:, i] = vertices[name]
        if not np.isfinite(values).all():
            bad = names[int(np.argmin(np.isfinite(values).all(axis=0)))]
            raise InvalidInputError(f"{path} holds a value of {bad!r} that is not finite.", path=path)
        return torch.from_numpy(values)

    sh_rest = columns(*(f"f_rest_{i}" for i in range(rest)))
    return Gaussians(
        means=columns(*_MEANS),
        log_scales=columns(*_SCALES),
        quaternions_wxyz=columns(*_ROTATION),
        opacity_logits=columns("opacity")[:, 0].contiguous(),
        sh_dc=columns(*_DC),
        sh_rest=sh_rest.reshape(len(vertices), 3, rest // 3).transpose(1, 2).contiguous(),
    )
