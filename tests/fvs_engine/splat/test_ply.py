from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from plyfile import PlyData, PlyElement

from fvs_engine.errors import InvalidInputError, StorageError
from fvs_engine.splat.gaussians import Gaussians
from fvs_engine.splat.ply import read_ply, write_ply

Make = Callable[..., Gaussians]


@pytest.mark.parametrize("sh_degree", [0, 1, 2, 3])
def test_round_trip_is_exact(make_gaussians: Make, tmp_path: Path, sh_degree: int) -> None:
    model = make_gaussians(17, sh_degree)
    write_ply(tmp_path / "model.ply", model)
    again = read_ply(tmp_path / "model.ply")
    for name, tensor in model.tensors().items():
        np.testing.assert_array_equal(again.tensors()[name].numpy(), tensor.numpy())


def test_layout_is_that_of_3dgs(make_gaussians: Make, tmp_path: Path) -> None:
    model = make_gaussians(4, 3)
    write_ply(tmp_path / "model.ply", model)
    vertices = PlyData.read(str(tmp_path / "model.ply"))["vertex"]
    names = [p.name for p in vertices.properties]
    assert names[:9] == ["x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2"]
    assert names[9:54] == [f"f_rest_{i}" for i in range(45)]
    assert names[54:] == ["opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"]
    # All fifteen coefficients of red come first: f_rest_16 is the second of green.
    np.testing.assert_array_equal(vertices["f_rest_16"], model.sh_rest[:, 1, 1].numpy())


@pytest.mark.parametrize("missing", ["x", "opacity", "rot_3", "f_dc_1", "f_rest_3"])
def test_a_missing_property_is_named(make_gaussians: Make, tmp_path: Path, missing: str) -> None:
    path = tmp_path / "model.ply"
    write_ply(path, make_gaussians(3, 1))
    table = PlyData.read(str(path))["vertex"].data
    names = [n if n != missing else "unrelated" for n in table.dtype.names]
    if missing.startswith("f_rest"):
        names = [n if n != missing else "f_rest_99" for n in table.dtype.names]
    renamed = table.copy()
    renamed.dtype.names = names
    PlyData([PlyElement.describe(renamed, "vertex")]).write(str(path))
    with pytest.raises(InvalidInputError, match=missing):
        read_ply(path)


def test_what_is_no_model_is_refused(make_gaussians: Make, tmp_path: Path) -> None:
    (tmp_path / "text.ply").write_text("hello")
    with pytest.raises(InvalidInputError, match=r"text\.ply"):
        read_ply(tmp_path / "text.ply")
    with pytest.raises(InvalidInputError, match="no such file"):
        read_ply(tmp_path / "none.ply")
    model = make_gaussians(3, 0)
    model.opacity_logits[1] = float("nan")
    write_ply(tmp_path / "nan.ply", model)
    with pytest.raises(InvalidInputError, match="opacity"):
        read_ply(tmp_path / "nan.ply")
    whole = (tmp_path / "nan.ply").read_bytes()
    (tmp_path / "cut.ply").write_bytes(whole[:-20])
    with pytest.raises(InvalidInputError, match=r"cut\.ply"):
        read_ply(tmp_path / "cut.ply")


def test_a_failed_write_leaves_the_old_file(make_gaussians: Make, tmp_path: Path) -> None:
    with pytest.raises(StorageError):
        write_ply(tmp_path / "absent" / "model.ply", make_gaussians(3, 0))
    (tmp_path / "taken").mkdir()
    with pytest.raises(StorageError):
        write_ply(tmp_path / "taken", make_gaussians(3, 0))
    assert [p.name for p in tmp_path.iterdir()] == ["taken"]
