"""Rankings and plans of an output folder over a terrain."""

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rasterio
from georeferenced_folder import MODEL_FROM_WORLD, GeoreferencedFolder
from rasterio.transform import Affine
from rasterio.warp import transform

from fvs_engine.errors import InvalidInputError
from fvs_engine.geometry import quaternion_from_matrix
from fvs_engine.geometry.geodetic import GeodeticPosition, camera_at
from fvs_engine.monitor import Monitor
from fvs_engine.pipeline.plan import plan_next_views
from fvs_engine.pipeline.rank import rank_candidates
from fvs_engine.pipeline.workspace import Workspace
from fvs_engine.plan.tours import Budget
from fvs_schema.candidates import CandidateStatus
from fvs_schema.findings import Finding, FindingCode

HOME = GeodeticPosition(50.82, -0.14, 80.0)
SPOTS = {"high": (10.0, 0.0, 20.0), "over": (-10.0, 0.0, 3.0), "under": (10.0, 5.0, -3.0)}
"""East, north and up of home, whose ground is level."""


class _Findings(Monitor):
    def __init__(self) -> None:
        super().__init__()
        self.found: list[Finding] = []

    def warn(self, finding: Finding) -> None:
        self.found.append(finding)

    def candidates(self, code: FindingCode) -> tuple[str, ...]:
        return next((finding.candidates for finding in self.found if finding.code is code), ())


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Its poses are given, so that nothing need be registered: no image saw its points."""
    folder = tmp_path_factory.mktemp("made")
    GeoreferencedFolder(folder, HOME)
    workspace = Workspace(folder)
    manifest = workspace.read_manifest()
    assert manifest is not None
    assert manifest.cameras is not None
    cameras = manifest.cameras.model_copy(update={"source": "colmap"})
    workspace.write_manifest(manifest.model_copy(update={"cameras": cameras}))
    return folder


@pytest.fixture(scope="module")
def candidates(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return _written(tmp_path_factory.mktemp("candidates") / "candidates.json", tuple(SPOTS))


def _written(path: Path, names: Sequence[str]) -> Path:
    document = []
    for name in names:
        camera = MODEL_FROM_WORLD.move_camera(camera_at(np.array(SPOTS[name]), 30.0, -80.0))
        pose = {
            "position": camera.translation.tolist(),
            "orientation_wxyz": quaternion_from_matrix(camera.rotation).tolist(),
        }
        document.append({"id": name, "pose": pose})
    path.write_text(json.dumps(document))
    return path


@pytest.fixture
def height_model(tmp_path: Path) -> Callable[..., Path]:
    """Level ground as high as home, in British National Grid."""

    def make(hole: Any = None, place: GeodeticPosition = HOME) -> Path:
        (x,), (y,) = transform("EPSG:4326", "EPSG:27700", [place.longitude_deg], [place.latitude_deg])
        heights = np.full((60, 60), HOME.altitude_m, np.float32)
        if hole is not None:
            heights[hole] = -9999.0
        path = tmp_path / "ground.tif"
        profile = {"driver": "GTiff", "width": 60, "height": 60, "count": 1, "dtype": "float32"}
        corner = Affine(2.0, 0.0, x - 60.0, 0.0, -2.0, y + 60.0)
        with rasterio.open(path, "w", **profile, crs="EPSG:27700", transform=corner, nodata=-9999.0) as file:
            file.write(heights, 1)
        return path

    return make


@pytest.mark.parametrize("by", ["file", "points"])
def test_candidates_under_the_ground_have_no_rank_and_are_not_planned(
    root: Path, candidates: Path, height_model: Callable[..., Path], by: str, tmp_path: Path
) -> None:
    terrain = str(height_model()) if by == "file" else "points"
    ranking, _ = rank_candidates(root, candidates, terrain=terrain, rank_all=True, out=tmp_path / "ranking")
    found = {item.name: (item.status, item.rank) for item in ranking.candidates}
    assert found.keys() == SPOTS.keys()
    assert found["under"] == (CandidateStatus.UNDER_GROUND, None)
    assert CandidateStatus.UNDER_GROUND not in (found["high"][0], found["over"][0])
    monitor = _Findings()
    result, _ = plan_next_views(
        *(root, Budget(3)),
        candidates_file=candidates,
        terrain=terrain,
        out=tmp_path / "plan",
        monitor=monitor,
    )
    assert {pose.name for pose in result.poses} <= {"high", "over"}
    assert monitor.candidates(FindingCode.UNDER_GROUND) == ("under",)
    assert FindingCode.UNDER_GROUND in {finding.code for finding in result.plan.warnings}


def test_a_hole_of_the_height_model_is_told(
    root: Path, candidates: Path, height_model: Callable[..., Path], tmp_path: Path
) -> None:
    monitor = _Findings()
    eastern_half = np.s_[:, 30:]
    terrain = str(height_model(eastern_half))
    ranking, _ = rank_candidates(root, candidates, terrain=terrain, out=tmp_path, monitor=monitor)
    assert monitor.candidates(FindingCode.GROUND_UNKNOWN) == ("high", "under")
    assert CandidateStatus.UNDER_GROUND not in {item.status for item in ranking.candidates}


def test_what_is_no_ground_for_a_model_is_refused(
    root: Path, candidates: Path, height_model: Callable[..., Path], tmp_path: Path
) -> None:
    elsewhere = str(height_model(place=GeodeticPosition(51.5, -0.1, 0.0)))
    for given, terrain, said in (
        (candidates, elsewhere, r"no height around 50\.82"),
        (candidates, str(candidates), "is no height model"),
        (_written(tmp_path / "under.json", ["under"]), "points", "All 1 candidates are under the ground"),
    ):
        with pytest.raises(InvalidInputError, match=said):
            rank_candidates(root, given, terrain=terrain, out=tmp_path / "ranking")


def test_a_model_without_a_place_on_earth_has_no_ground(candidates: Path, tmp_path: Path) -> None:
    made = GeoreferencedFolder(tmp_path, HOME)
    for photograph in (tmp_path / "images").iterdir():
        photograph.write_bytes(b"")
    assert made.root == tmp_path
    with pytest.raises(InvalidInputError, match="no place on Earth") as raised:
        rank_candidates(tmp_path, candidates, terrain="points")
    assert raised.value.hint.startswith("Leave the terrain out")
