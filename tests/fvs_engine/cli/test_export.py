import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pycolmap
import pyproj
import pytest
from georeferenced_folder import GeoreferencedFolder
from PIL import Image

from fvs_engine.cli.exit_codes import EXIT_CODES, USAGE
from fvs_engine.geometry.geodetic import GeodeticPosition
from fvs_engine.images.metadata import read_priors

Fvs = Callable[..., Any]


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("made")
    GeoreferencedFolder(root, GeodeticPosition(50.82, -0.14, 80.0))
    return root


def test_files_go_beside_the_model(fvs: Fvs, made: Path, tmp_path: Path) -> None:
    root = shutil.copytree(made, tmp_path / "made")
    run = fvs("export", root, "--format", "ply, geojson", "--json")
    files = [root / "export" / name for name in ("point_cloud.ply", "cameras.geojson", "georeference.json")]
    assert run.document == {"files": list(map(str, files))}
    assert all(file.is_file() for file in files)


def test_the_height_of_a_geoid_may_be_negative(fvs: Fvs, made: Path, tmp_path: Path) -> None:
    fvs("export", made, "--format", "laz", "--geoid", "-27.5", "--out", tmp_path)
    assert json.loads((tmp_path / "georeference.json").read_text())["geoid_height_m"] == -27.5


@pytest.mark.parametrize(
    ("options", "status", "fragment"),
    [
        (("--format", "ply,lax"), USAGE, "lax"),
        (("--frame", "model", "--epsg", 32630), USAGE, "--frame world"),
        (("--geoid", "4500"), USAGE, "120 m"),
        (("--epsg", 99_999), EXIT_CODES["invalid-input"], "EPSG:99999"),
        (("--geoid", "none.gtx"), EXIT_CODES["invalid-input"], "none.gtx"),
    ],
)
def test_what_cannot_be_exported(
    fvs: Fvs, made: Path, options: tuple[object, ...], status: int, fragment: str
) -> None:
    run = fvs("export", made, *options)
    assert run.status == status
    assert fragment in run.stderr
    assert not (made / "export").exists()


@pytest.mark.system
@pytest.mark.usefixtures("native_here")
def test_photographs_of_a_drone_are_exported_where_they_were_taken(
    fvs: Fvs, data_dir: Path, tmp_path: Path
) -> None:
    """Other programs find the cameras within a millimetre of ours, and these within two metres of GPS."""
    photographs = tmp_path / "photographs"
    photographs.mkdir()
    for path in sorted((data_dir / "brighton" / "images").iterdir()):
        with Image.open(path) as image:
            exif = image.info["exif"]
            image.reduce(4).save(photographs / path.name, quality=95, exif=exif)
    root, out = tmp_path / "out", tmp_path / "exported"
    options = ("--iterations", 5, "--long-side", 128, "--test-every", 0)
    assert fvs("reconstruct", photographs, "--out", root, *options).status == 0
    assert fvs("export", root, "--format", "cameras,colmap,geojson", "--out", out).status == 0
    place = np.array(json.loads((out / "georeference.json").read_text())["ecef_from_world"])
    ours = {
        camera["img_name"]: place[:3] @ [*camera["position"], 1.0]
        for camera in json.loads((out / "cameras.json").read_text())
    }
    assert len(ours) == 18
    to_ecef = pyproj.Transformer.from_crs(4979, 4978, always_xy=True)
    for feature in json.loads((out / "cameras.geojson").read_text())["features"][::2]:
        height = feature["properties"]["altitude_m"]
        found = to_ecef.transform(*feature["geometry"]["coordinates"], height)
        np.testing.assert_allclose(found, ours[feature["properties"]["name"]], atol=1e-3)
    for image in pycolmap.Reconstruction(out / "colmap").images.values():
        np.testing.assert_allclose(place[:3] @ [*image.projection_center(), 1.0], ours[image.name], atol=1e-3)
    for name, position in ours.items():
        with (photographs / name).open("rb") as file:
            fix = read_priors(file)
        taken_at = to_ecef.transform(fix.longitude_deg, fix.latitude_deg, fix.altitude_m)
        assert np.linalg.norm(taken_at - position) < 2.0
