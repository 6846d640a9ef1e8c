import importlib.util
from pathlib import Path
from typing import Any

import pytest
from fvs_client import Client, Orbit
from PIL import Image

_DEMO = Path(__file__).resolve().parent.parent.parent / "demo"


@pytest.mark.system
def test_its_pictures_can_be_drawn(client: Client, gateway: Any, tmp_path: Path) -> None:
    spec = importlib.util.spec_from_file_location("pictures_of_the_demonstration", _DEMO / "pictures.py")
    assert spec is not None
    assert spec.loader is not None
    pictures = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(pictures)
    scene = client.scenes.create("quarry")
    gateway.model(scene.id)
    ranking = scene.rank(generator=Orbit(count=5))
    snapshot = scene.snapshots.latest()
    assert snapshot is not None
    model = snapshot.download("point_cloud.ply", tmp_path)
    pictures.draw_contact_sheet(tmp_path / "sheet.png", ranking)
    pictures.draw_trajectory(tmp_path / "trajectory.png", snapshot.cameras(), ranking, model)
    for name in ("sheet.png", "trajectory.png"):
        with Image.open(tmp_path / name) as picture:
            assert min(picture.size) > 200
            assert len(picture.convert("RGB").getcolors(1 << 24)) > 50, name
