from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.collections import LineCollection
from PIL import Image
from scipy.spatial.transform import Rotation

from fvs_engine.geometry import PinholeCamera, RigidTransform, look_at
from fvs_engine.scene.dataset import Dataset
from fvs_engine.select.trajectory import draw_trajectory, top_view
from fvs_engine.views import View

pytestmark = pytest.mark.usefixtures("coarse_pictures")


CAMERA = PinholeCamera(40, 30, 30.0, 30.0, 20.0, 15.0)
TILT = RigidTransform(Rotation.random(rng=0).as_matrix(), np.array([5.0, -3.0, 9.0]))


def dataset(poses: list[RigidTransform]) -> Dataset:
    views = [View(f"{i:02d}", CAMERA, pose.inverse()) for i, pose in enumerate(poses)]
    return Dataset("made up", Path("nowhere"), tuple(views))


def ring(count: int = 12) -> list[RigidTransform]:
    """About the z axis, at two heights."""
    angles = 2 * np.pi * np.arange(count) / count
    centres = [[3 * np.cos(a), 2 * np.sin(a), i % 2] for i, a in enumerate(angles)]
    return [look_at(centre, [0, 0, 0.5], [0, 0, 1]) for centre in centres]


def on_map(data: Dataset) -> np.ndarray:
    return np.stack(list(top_view(data).values()))


def test_from_above_heights_vanish_and_distances_stay_in_any_frame() -> None:
    flat = np.stack([pose.translation[:2] for pose in ring()])
    expected = np.linalg.norm(flat[:, None] - flat[None], axis=-1)
    for frame in (RigidTransform.identity(), TILT):
        seen = on_map(dataset([frame @ pose for pose in ring()]))
        np.testing.assert_allclose(np.linalg.norm(seen[:, None] - seen[None], axis=-1), expected, atol=1e-9)


def _turn(points: np.ndarray) -> float:
    """Twice the signed area that points [N, 2] go round: positive when they turn left."""
    x, y = (points - points.mean(axis=0)).T
    return float((x * np.roll(y, -1) - y * np.roll(x, -1)).sum())


def test_the_map_is_not_mirrored() -> None:
    assert _turn(on_map(dataset(ring()))) > 0
    assert _turn(on_map(dataset(ring()[::-1]))) < 0


def test_a_block_of_cameras_that_look_down_is_seen_from_above() -> None:
    down = [np.diag([1.0, -1.0, -1.0]), np.diag([-1.0, 1.0, -1.0])]  # flown there and back
    corners = np.array([[0, 0], [4, 0], [4, 1], [0, 1]])
    poses = [RigidTransform(down[i % 2], np.array([x, y, 50.0])) for i, (x, y) in enumerate(corners)]
    seen = on_map(dataset(poses))
    assert _turn(seen) == pytest.approx(8.0)


def test_the_picture_shows_what_was_chosen(tmp_path: Path) -> None:
    data = dataset(ring())
    pictures = []
    for chosen in ((), ("05",), ("05", "07", "09")):
        path = tmp_path / f"{len(chosen)}.png"
        draw_trajectory(path, data, initial=("01", "02"), chosen=chosen, test=("00", "08"), title="A title")
        with Image.open(path) as picture:
            picture.load()
            assert min(picture.size) > 200
            pictures.append(picture.tobytes())
    assert len(set(pictures)) == 3


def test_every_vehicle_has_its_own_path(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    data = dataset(ring())
    plane = top_view(data)
    drawn: list[np.ndarray] = []

    def kept(legs: list[np.ndarray], **options: Any) -> LineCollection:
        drawn.append(np.array(legs))
        return LineCollection(legs, **options)

    monkeypatch.setattr("fvs_engine.select.trajectory.LineCollection", kept)
    for vehicles in ((1, 2, 1, 2), None):
        draw_trajectory(
            tmp_path / "path.png",
            data,
            initial=("01", "02"),
            chosen=("03", "04", "05", "06"),
            vehicles=vehicles,
            test=(),
            title="",
        )
    ways = [("02", "03"), ("02", "04"), ("03", "05"), ("04", "06")]
    np.testing.assert_allclose(drawn[0], [[plane[a], plane[b]] for a, b in ways])
    ways = [("02", "03"), ("03", "04"), ("04", "05"), ("05", "06")]
    np.testing.assert_allclose(drawn[1], [[plane[a], plane[b]] for a, b in ways])
