"""Fixtures that several packages' tests share."""

import math
import os
import shutil
from pathlib import Path

import hypothesis
import numpy as np
import pytest
from PIL import Image

# How long an example takes says how busy the machine is.
hypothesis.settings.register_profile("fvs", deadline=None)
hypothesis.settings.load_profile("fvs")

_REPOSITORY = Path(__file__).resolve().parent.parent


@pytest.fixture(scope="session")
def data_dir() -> Path:
    """The folder of real photographs: $FVS_DATA, or ../shared/data beside the repository."""
    folder = Path(os.environ.get("FVS_DATA", _REPOSITORY.parent / "shared" / "data"))
    if not folder.is_dir():
        pytest.skip(f"the real photographs are not here: {folder} is missing (set FVS_DATA to their folder)")
    return folder


@pytest.fixture(scope="session")
def kermit_dir(data_dir: Path) -> Path:
    """Eleven photographs of 640×480 px, read-only."""
    return data_dir / "kermit" / "images"


@pytest.fixture
def kermit_copy(kermit_dir: Path, tmp_path: Path) -> Path:
    """The same photographs in a folder that the test may change."""
    folder = tmp_path / "kermit"
    folder.mkdir()
    for photograph in sorted(kermit_dir.iterdir()):
        shutil.copyfile(photograph, folder / photograph.name)
    return folder


@pytest.fixture(scope="session")
def room_dir(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A made-up dataset, read-only: photographs of a tiled room, and a COLMAP model that is exactly right.

    Twenty-four views of 96 × 72 px, two rounds about the middle, 0.8 units from each to the next; ``images/``
    and ``sparse/0``. The room is convex: whoever faces a point sees it.
    """
    from fvs_engine.geometry import PinholeCamera, look_at, quaternion_from_matrix

    folder = tmp_path_factory.mktemp("room")
    model = folder / "sparse" / "0"
    model.mkdir(parents=True)
    (folder / "images").mkdir()
    half, views, points = 4.0, 24, 300
    draw = np.random.default_rng(0)
    camera = PinholeCamera(96, 72, 77.0, 77.0, 48.0, 36.0)
    tiles, grain = draw.uniform(0, 1, (6, 16, 16, 3)), draw.uniform(0, 1, (6, 64, 64, 3))

    def colors(on_walls: np.ndarray) -> np.ndarray:
        axis = np.abs(on_walls).argmax(axis=-1)
        wall = 2 * axis + (np.take_along_axis(on_walls, axis[..., None], -1)[..., 0] > 0)
        across = np.array([[1, 2], [0, 2], [0, 1]])[axis]
        place = np.clip((np.take_along_axis(on_walls, across, -1) + half) / (2 * half), 0, 1 - 1e-9)
        coarse, fine = (place * 16).astype(int), (place * 64).astype(int)
        return (
            0.65 * tiles[wall, coarse[..., 0], coarse[..., 1]]
            + 0.35 * grain[wall, fine[..., 0], fine[..., 1]]
        )

    axis = draw.integers(0, 6, points)
    xyz = draw.uniform(-half, half, (points, 3))
    xyz[np.arange(points), axis // 2] = np.where(axis % 2 == 0, half, -half)
    y, x = np.mgrid[:144, :192] / 2 + 0.25  # four rays per pixel
    rays = camera.unproject(np.stack([x, y], axis=-1))
    images, tracks = [], [""] * points
    for i in range(views):
        angle = 4 * math.pi * i / views
        centre = [1.55 * math.cos(angle), 1.55 * math.sin(angle), 0.3 + 0.6 * i / views]
        model_from_camera = look_at(centre, [0, 0, 0], [0, 0, 1])
        directions = rays @ model_from_camera.rotation.T
        lengths = ((np.sign(directions) * half - centre) / directions).min(axis=-1, keepdims=True)
        pixels = colors(centre + lengths * directions).reshape(72, 2, 96, 2, 3).mean(axis=(1, 3))
        Image.fromarray((255 * pixels).round().astype(np.uint8)).save(folder / "images" / f"{i:02d}.png")

        camera_from_model = model_from_camera.inverse()
        seen_at = camera.project(camera_from_model.apply(xyz))
        seen = np.flatnonzero((seen_at > 0).all(axis=1) & (seen_at < [96, 72]).all(axis=1))
        for number, point in enumerate(seen):
            tracks[point] += f" {i + 1} {number}"
        pose = [*quaternion_from_matrix(camera_from_model.rotation), *camera_from_model.translation]
        images += [" ".join(map(str, [i + 1, *pose, 1, f"{i:02d}.png"]))]
        images += [" ".join(f"{seen_at[p][0]} {seen_at[p][1]} {p + 1}" for p in seen)]
    rgb = (255 * colors(xyz)).round().astype(int)
    lines = [
        f"{p + 1} {' '.join(map(str, [*xyz[p], *rgb[p]]))} 0.1{tracks[p]}"
        for p in range(points)
        if tracks[p].count(" ") >= 4
    ]
    (model / "cameras.txt").write_text("1 PINHOLE 96 72 77 77 48 36\n")
    (model / "images.txt").write_text("\n".join(images) + "\n")
    (model / "points3D.txt").write_text("\n".join(lines) + "\n")
    return folder
