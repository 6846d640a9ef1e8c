import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fvs_engine.cli.exit_codes import EXIT_CODES
from fvs_engine.geometry import OPENGL_FROM_OPENCV, DistortedCamera, RigidTransform
from fvs_engine.geometry.geodetic import GeodeticPosition, geodetic_from_enu

Fvs = Callable[..., Any]
HOME = GeodeticPosition(47.5, 9.5, 410.0)
PLACES = {
    "G1": (-3.5, -3.5, 0.1),
    "G2": (3.4, -3.2, 0.4),
    "G3": (3.3, 3.6, 0.0),
    "G4": (-3.2, 3.3, 1.8),
    "G5": (0.2, 0.1, 0.9),
    "G6": (1.0, -1.5, 1.2),
    "C1": (-1.5, 0.8, 0.3),
    "C2": (2.0, 2.0, 1.0),
}


def _list(transforms: Path, names: dict[str, str]) -> str:
    """Marks of the points in the true cameras; ``names``: of the points whose coordinates another has."""
    truth = json.loads(transforms.read_text())
    coefficients = tuple(truth[name] for name in ("fl_x", "fl_y", "cx", "cy", "k1", "k2", "p1", "p2"))
    lens = DistortedCamera("OPENCV", truth["w"], truth["h"], coefficients)
    lines = ["EPSG:4326"]
    for name, place in PLACES.items():
        at = geodetic_from_enu(np.array(PLACES[names.get(name, name)]), HOME)
        for frame in truth["frames"]:
            matrix = np.array(frame["transform_matrix"])
            camera = RigidTransform(matrix[:3, :3], matrix[:3, 3]) @ OPENGL_FROM_OPENCV.inverse()
            x, y = lens.project(camera.inverse().apply(np.array(place)))
            if 0 <= x <= lens.width and 0 <= y <= lens.height:
                photograph = Path(frame["file_path"]).name
                where = f"{at.longitude_deg:.10f} {at.latitude_deg:.10f} {at.altitude_m:.4f}"
                lines.append(f"{where} {x:.3f} {y:.3f} {photograph} {name}")
    return "\n".join(lines)


@pytest.mark.system
@pytest.mark.usefixtures("native_here")
def test_simulated_photographs_lie_within_millimetres_of_the_survey(fvs: Fvs, tmp_path: Path) -> None:
    yard, root, file = tmp_path / "yard", tmp_path / "out", tmp_path / "gcp_list.txt"
    assert fvs("simulate", yard, "--images", 12, "--size", "480x360").status == 0
    options = ("--iterations", 5, "--long-side", 128, "--test-every", 0)
    assert fvs("reconstruct", yard / "images", "--out", root, *options).status == 0
    file.write_text(_list(yard / "transforms.json", {}))
    run = fvs("align", root, "--gcp", file, "--check", "C*", "--json")
    residuals = run.document["residuals"]
    assert residuals["control_rms_m"] < 0.01
    assert residuals["check_rms_m"] < 0.01
    assert run.document["alignment"]["source"] == "control-points"
    assert "C1" in fvs("align", root, "--gcp", file, "--check", "C*").stdout
    file.write_text(_list(yard / "transforms.json", {"G2": "G4", "G4": "G2"}))
    run = fvs("align", root, "--gcp", file, "--check", "C*")
    assert "G2 and G4 are swapped" in run.stderr
    assert fvs("export", root, "--format", "cameras").status == 0


def test_a_file_that_cannot_be_used(fvs: Fvs, tmp_path: Path) -> None:
    run = fvs("align", tmp_path, "--gcp", tmp_path / "none.txt")
    assert run.status == EXIT_CODES["invalid-input"]
    assert "manifest.json" in run.stderr
