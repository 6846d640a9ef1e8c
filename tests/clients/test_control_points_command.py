"""``fvs-client control-points``."""

import json
from collections.abc import Callable
from pathlib import Path

import pytest
from fvs_client import Client
from typer.testing import Result

Run = Callable[..., Result]

LINES = (
    "EPSG:25832",
    "537653.198 5260847.354 410.10 1102.7 2208.0 a.jpg G1",
    "537653.198 5260847.354 410.10 1195.7 2183.1 b.jpg G1",
    "537660.110 5260847.360 NaN 812.4 1765.9 a.jpg C1 check",
)


def test_a_gcp_list_becomes_the_control_points_of_a_scene(run: Run, client: Client, tmp_path: Path) -> None:
    scene = client.scenes.create("surveyed quarry")
    file = tmp_path / "gcp_list.txt"
    file.write_text("\n".join(LINES), encoding="utf-16")
    said = run("control-points", "surveyed quarry", "--gcp", str(file)).stdout
    assert said == "control points  1\ncheck points    1\n"
    points = scene.control_points()
    assert points.crs == "EPSG:25832"
    assert [(point.name, point.x, point.z, point.check) for point in points.points] == [
        ("G1", 537653.198, 410.1, False),
        ("C1", 537660.11, None, True),
    ]
    again = run("control-points", scene.id, "--gcp", str(file), "--json").stdout
    assert json.loads(again) == points.model_dump(mode="json")


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"EPSG:25832\n1 2 3 4 5", "line 2: it has 5 columns"),
        (b"EPSG:25832\n\xff\xfe\xfa", "not a text file"),
    ],
)
def test_a_gcp_list_that_cannot_be_used_is_refused(
    content: bytes, message: str, run: Run, tmp_path: Path
) -> None:
    file = tmp_path / "gcp_list.txt"
    file.write_bytes(content)
    said = run("control-points", "surveyed quarry", "--gcp", str(file), expect=2).stderr
    assert message in " ".join(said.replace("│", " ").split())
