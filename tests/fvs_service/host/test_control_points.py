"""What a runner makes of the control points of a scene, in a model of known cameras."""

import hashlib
import io
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from fvs_service.host.protocol.messages import ControlOutcome
from fvs_service.host.runner.control_points import StoredImages, control_outcome
from fvs_service.storage.blob_keys import image_key
from fvs_service.storage.blobs import Blobs
from PIL import Image

from fvs_engine.geometry import PinholeCamera, look_at
from fvs_engine.geometry.geodetic import GeodeticPosition, geodetic_from_enu
from fvs_engine.monitor import Monitor
from fvs_engine.sfm.colmap.model import write_colmap
from fvs_engine.sfm.reconstruction import Reconstruction
from fvs_engine.views import View
from fvs_schema.control_points import ControlPoint, ControlPoints, Mark
from fvs_schema.findings import Finding, FindingCode
from fvs_schema.scenes import Origin

ORIGIN = Origin(latitude_deg=47.5, longitude_deg=9.5, altitude_m=400.0)
PLACES = {
    "G1": (-3.0, -3.0, 0.0),
    "G2": (3.0, -2.5, 0.4),
    "G3": (2.8, 3.0, 1.0),
    "G4": (-3.0, 2.8, 0.2),
    "C1": (0.4, 0.2, 0.8),
}
CAMERA = PinholeCamera(80, 60, 50.0, 50.0, 40.0, 30.0)


class Model:
    """Five images, of which the second is stored on its side, and the marks of five points in them."""

    def __init__(self, root: Path) -> None:
        self.sparse, folder, blobs = root / "sparse", root / "images", Blobs(root / "blobs")
        folder.mkdir()
        views, files = [], {}
        self.marks: dict[str, list[Mark]] = {name: [] for name in PLACES}
        for number, angle in enumerate(np.linspace(0.0, 4.0, 5)):
            file, turned = f"{number:06d}.png", number == 1
            eye = np.array([6.0 * np.cos(angle), 6.0 * np.sin(angle), 5.0])
            camera_from_model = look_at(eye, np.zeros(3), np.array([0.0, 0.0, 1.0])).inverse()
            views.append(View(file, CAMERA, camera_from_model))
            Image.new("L", (80, 60), number).save(folder / file)
            content = _on_its_side(number) if turned else (folder / file).read_bytes()
            sha256 = hashlib.sha256(content).hexdigest()
            blobs.put(content, image_key("scn", sha256))
            image = SimpleNamespace(
                scene_id="scn", sha256=sha256, digest=f"sha256:{sha256}", name=f"DJI_{number}.PNG"
            )
            files[file] = cast(Any, image)
            for name, place in PLACES.items():
                x, y = CAMERA.project(camera_from_model.apply(np.array(place))).tolist()
                if 0 <= x <= 80 and 0 <= y <= 60:
                    by = image.digest if number == 3 else image.name
                    x, y = (y, 80 - x) if turned else (x, y)
                    self.marks[name].append(Mark(image=by, x_px=x, y_px=y))
        write_colmap(Reconstruction.of_views(views), self.sparse)
        self.images = StoredImages(files, folder, blobs)
        self.findings: list[Finding] = []

    def outcome(self, crs: str = "EPSG:4326") -> ControlOutcome | None:
        """What the marks make of the model."""
        home = GeodeticPosition(ORIGIN.latitude_deg, ORIGIN.longitude_deg, ORIGIN.altitude_m)
        at = {name: geodetic_from_enu(10.0 * np.array(place), home) for name, place in PLACES.items()}
        points = ControlPoints(
            crs=crs,
            points=tuple(
                ControlPoint(
                    name=name,
                    x=at[name].longitude_deg,
                    y=at[name].latitude_deg,
                    z=at[name].altitude_m,
                    check=name == "C1",
                    marks=tuple(self.marks[name]),
                )
                for name in PLACES
            ),
        )
        monitor = Monitor(on_warning=self.findings.append)
        return control_outcome(points, ORIGIN, self.images, self.sparse, monitor)


@pytest.fixture
def model(tmp_path: Path) -> Model:
    return Model(tmp_path)


def _on_its_side(number: int) -> bytes:
    exif, out = Image.Exif(), io.BytesIO()
    exif[0x0112] = 6
    Image.new("L", (60, 80), number).save(out, "JPEG", exif=exif)
    return out.getvalue()


def test_marks_by_name_and_digest_align_the_model(model: Model) -> None:
    """Also those of an image that is stored on its side."""
    made = model.outcome()
    assert made is not None
    assert made.alignment.scale == pytest.approx(10.0, rel=1e-5)
    np.testing.assert_allclose(made.alignment.translation, 0.0, atol=1e-3)
    assert made.residuals.check_rms_m == pytest.approx(0.0, abs=1e-3)
    assert all(point.wrong_marks == () for point in made.residuals.points)
    assert model.findings == []


def test_wrong_marks_have_digests_and_unknown_images_are_named(model: Model) -> None:
    wrong, unknown = model.marks["C1"][0], model.marks["G1"][-1]
    model.marks["C1"][0] = wrong.model_copy(update={"x_px": wrong.x_px + 25.0})
    model.marks["G1"].append(unknown.model_copy(update={"image": "other.png"}))
    made = model.outcome()
    assert made is not None
    check = made.residuals.points[-1]
    assert check.wrong_marks == (model.images.files["000000.png"].digest,)
    off = Finding.of(FindingCode.CONTROL_MARK_OFF, ["000000.png"], point="C1")
    assert model.findings == [Finding.of(FindingCode.MARKED_IMAGES_UNKNOWN, ["other.png"]), off]


def test_points_that_determine_nothing_leave_the_alignment_to_positions(model: Model) -> None:
    model.marks["G1"], model.marks["G2"] = [], []
    assert model.outcome() is None
    (finding,) = model.findings
    assert finding.code is FindingCode.CONTROL_POINTS_UNUSED
    assert "seen-once: G1, G2" in finding.texts["why"]
