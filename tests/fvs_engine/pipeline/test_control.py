"""Control points of an output folder with known cameras."""

import hashlib
import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pyproj
import pytest
from georeferenced_folder import CAMERA, GeoreferencedFolder
from PIL import Image

from fvs_engine.errors import InvalidInputError
from fvs_engine.geometry.geodetic import GeodeticPosition, geodetic_from_enu
from fvs_engine.monitor import Monitor
from fvs_engine.pipeline.control import align_folder
from fvs_engine.pipeline.export import export_model
from fvs_engine.pipeline.workspace import Workspace
from fvs_schema.control_points import PointStatus
from fvs_schema.findings import Finding, FindingCode

HOME = GeodeticPosition(50.82, -0.14, 80.0)
SURVEYED = GeodeticPosition(50.83, -0.12, 95.0)
"""Where the survey has the site: a mile from where its photographs' GPS has it."""
PLACES = {
    "G1": (-20.0, -18.0, 0.0),
    "G2": (22.0, -17.0, 1.0),
    "G3": (19.0, 20.0, 3.0),
    "G4": (-21.0, 18.0, -1.0),
    "G5": (2.0, 1.0, 6.0),
    "C1": (8.0, -6.0, 0.5),
}
_ORIENTATION_TAG = 0x0112


class _Warnings(Monitor):
    def __init__(self) -> None:
        self.findings: list[Finding] = []

    def warn(self, finding: Finding) -> None:
        self.findings.append(finding)


@pytest.fixture
def made(tmp_path: Path) -> GeoreferencedFolder:
    return GeoreferencedFolder(tmp_path / "made", HOME)


def _list(made: GeoreferencedFolder, *, turned: Sequence[str] = ()) -> Path:
    """A ``gcp_list.txt`` of the points; photographs that are ``turned`` are stored on their side."""
    to_utm = pyproj.Transformer.from_crs(4326, 32630, always_xy=True)
    lines = ["WGS84 UTM 30N"]
    for point, place in PLACES.items():
        position = geodetic_from_enu(np.array(place), SURVEYED)
        east, north = to_utm.transform(position.longitude_deg, position.latitude_deg)
        for name, world_from_camera in made.cameras.items():
            x, y = CAMERA.project(world_from_camera.inverse().apply(np.array(place)))
            if not (0 <= x <= CAMERA.width and 0 <= y <= CAMERA.height):
                continue
            if name in turned:  # orientation 6: to be turned clockwise
                x, y = y, CAMERA.width - x
            lines.append(f"{east:.4f} {north:.4f} {position.altitude_m:.4f} {x:.4f} {y:.4f} {name} {point}")
    path = made.root.parent / "gcp_list.txt"
    path.write_text("\ufeff" + "\r\n".join(lines))
    return path


def test_exports_are_where_the_points_were_surveyed(made: GeoreferencedFolder, tmp_path: Path) -> None:
    record = align_folder(made.root, _list(made), check=("C*",))
    assert record.residuals.control_rms_m < 1e-3
    assert record.residuals.check_rms_m is not None
    assert record.residuals.check_rms_m < 1e-3
    export_model(made.root, formats=["cameras"], out=tmp_path / "export")
    place = np.array(json.loads((tmp_path / "export/georeference.json").read_text())["ecef_from_world"])
    to_ecef = pyproj.Transformer.from_crs(4979, 4978, always_xy=True)
    for camera in json.loads((tmp_path / "export/cameras.json").read_text()):
        position = geodetic_from_enu(made.cameras[camera["img_name"]].translation, SURVEYED)
        true = to_ecef.transform(position.longitude_deg, position.latitude_deg, position.altitude_m)
        # A grid's scale of 1.0004 and its convergence are no part of the truth above: none is left.
        np.testing.assert_allclose(place[:3] @ [*camera["position"], 1.0], true, atol=2e-3)


def test_marks_are_in_pixels_of_the_stored_file(made: GeoreferencedFolder, tmp_path: Path) -> None:
    """A photograph that its EXIF turns has marks in the pixels before the turn."""
    workspace, photographs = Workspace(made.root), tmp_path / "photographs"
    photographs.mkdir()
    exif = Image.Exif()
    exif[_ORIENTATION_TAG] = 6
    Image.new("RGB", (CAMERA.height, CAMERA.width)).save(photographs / "3.jpg", exif=exif)
    sha256 = hashlib.sha256((photographs / "3.jpg").read_bytes()).hexdigest()
    manifest = workspace.read_manifest()
    assert manifest is not None
    records = tuple(
        record.model_copy(update={"sha256": sha256}) if record.name == "3.jpg" else record
        for record in manifest.images.photographs
    )
    images = manifest.images.model_copy(update={"folder": str(photographs), "photographs": records})
    workspace.write_manifest(manifest.model_copy(update={"images": images}))
    record = align_folder(made.root, _list(made, turned=["3.jpg"]))
    assert all(point.wrong_marks == () for point in record.residuals.points)
    (photographs / "3.jpg").unlink()
    with pytest.raises(InvalidInputError, match="which way"):
        align_folder(made.root, made.root.parent / "gcp_list.txt")


def test_an_unknown_image_costs_its_marks_alone(made: GeoreferencedFolder) -> None:
    path, monitor = _list(made), _Warnings()
    path.write_text(path.read_text(encoding="utf-8-sig").replace(" 4.jpg", " DJI_4.jpg"), encoding="utf-8")
    record = align_folder(made.root, path, monitor=monitor)
    assert Finding.of(FindingCode.MARKED_IMAGES_UNKNOWN, ["DJI_4.jpg"]) in monitor.findings
    statuses = {point.status for point in record.residuals.points}
    assert statuses == {PointStatus.USED, PointStatus.SEEN_ONCE}


def test_a_failure_keeps_the_earlier_alignment(made: GeoreferencedFolder) -> None:
    path = _list(made)
    align_folder(made.root, path)
    before = Workspace(made.root).control.read_bytes()
    text = path.read_text(encoding="utf-8-sig")
    for bad, message in (
        (text.replace("WGS84 UTM 30N", "EPSG:99999"), "EPSG:99999"),
        ("\n".join(text.splitlines()[:2]), "3 control points .* there are 0.* seen-once: G1"),
        (text + "\n651000 5632000 3 900 20 1.jpg G6", "900, 20 px"),
    ):
        path.write_text(bad)
        with pytest.raises(InvalidInputError, match=message):
            align_folder(made.root, path)
    assert Workspace(made.root).control.read_bytes() == before


def test_points_of_another_zone_than_gps_are_refused(made: GeoreferencedFolder) -> None:
    file = _list(made)
    file.write_text(file.read_text().replace("30N", "31N"))
    with pytest.raises(InvalidInputError, match="km from where GPS or the origin"):
        align_folder(made.root, file)
