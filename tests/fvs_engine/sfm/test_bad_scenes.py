"""Photographs that support no whole model: no wrong one is believed, and a sentence says what is missing."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from fvs_engine.errors import ReconstructionError
from fvs_engine.geometry import DistortedCamera, RigidTransform, look_at
from fvs_engine.geometry.alignment.cameras import centre_spread
from fvs_engine.geometry.alignment.similarity import robust_umeyama
from fvs_engine.lab.simulate import (
    Rectangle,
    SimulatedCamera,
    World,
    courtyard,
    lookalike_courtyard,
    orbit,
    write_photographs,
)
from fvs_engine.lab.simulate.textures import dead_leaves
from fvs_engine.monitor import Monitor
from fvs_engine.sfm.batch.reconstruct import SfmResult, reconstruct
from fvs_engine.sfm.pose_priors import ImageSet, PosePriors
from fvs_engine.sfm.settings import SfmSettings
from fvs_schema.findings import FindingCode

pytestmark = [pytest.mark.slow, pytest.mark.process, pytest.mark.timeout(900)]

DRONE = SimulatedCamera.like_a_drone(640, 480)
HALF_ORBIT = orbit(12, turns=0.5)
ALONG_THE_WALL = [
    look_at([x, 0.3 * np.sin(3 * x), 0.5 + 0.1 * np.cos(5 * x)], [x, 4.0, 0.5], [0.0, 0.0, 1.0])
    for x in np.linspace(-5.0, 5.0, 30)
]
MAX_SHARE = 0.03
Centres = Mapping[str, NDArray[np.float64]]


def photographed(
    folder: Path, world: World, cameras: Sequence[SimulatedCamera], poses: Sequence[RigidTransform]
) -> list[Path]:
    """One photograph by each camera from each pose."""
    return [
        write_photographs(folder / f"{index:03d}", world, camera, [pose], Monitor(), seed=index)[0]
        for index, (camera, pose) in enumerate(zip(cameras, poses, strict=True))
    ]


def gathered(folder: Path, photographs: Sequence[Path], *, exif: bool = True) -> tuple[Path, list[str]]:
    """The photographs in one folder, named in order."""
    folder.mkdir()
    names = [f"{index:03d}.jpg" for index in range(len(photographs))]
    for name, path in zip(names, photographs, strict=True):
        with Image.open(path) as image:
            image.save(folder / name, quality=95, exif=image.getexif() if exif else Image.Exif())
    return folder, names


def reconstructed(tmp_path: Path, photographs: Sequence[Path], *, exif: bool = True) -> SfmResult:
    folder, names = gathered(tmp_path / "images", photographs, exif=exif)
    return reconstruct(
        ImageSet(folder, names, PosePriors()), tmp_path / "sfm", SfmSettings(threads=1), Monitor()
    )


def largest_error(result: SfmResult, truth: Centres) -> float:
    """The largest error of a camera centre, in shares of their spread."""
    found = result.reconstruction.centres()
    ours, theirs = (np.stack([centres[name] for name in sorted(found)]) for centres in (found, truth))
    moved = robust_umeyama(ours, theirs).transform.apply(ours)
    return float(np.linalg.norm(moved - theirs, axis=1).max() / centre_spread(theirs))


def centres(poses: Sequence[RigidTransform], step: int = 1) -> Centres:
    return {f"{step * index:03d}.jpg": pose.translation for index, pose in enumerate(poses)}


def test_every_second_photograph_is_of_another_place(tmp_path: Path):
    places = [
        photographed(tmp_path / str(seed), courtyard(seed), 12 * [DRONE], HALF_ORBIT) for seed in (0, 7)
    ]
    mixed = [path for both in zip(*places, strict=True) for path in both]
    result = reconstructed(tmp_path, mixed)
    first = centres(HALF_ORBIT, step=2)
    second = {f"{2 * index + 1:03d}.jpg": pose.translation for index, pose in enumerate(HALF_ORBIT)}
    found = set(result.reconstruction.centres())
    assert found in (set(first), set(second))
    assert largest_error(result, {**first, **second}) < MAX_SHARE
    (warning,) = result.report.warnings
    assert (warning.code, warning.numbers) == (FindingCode.SEPARATE_MODEL, {"of": 24})
    assert set(warning.images) == {*first, *second} - found


def test_a_zoom_makes_cameras_of_their_own_if_exif_tells_it_and_is_never_believed_otherwise(tmp_path: Path):
    lenses = [
        DistortedCamera("RADIAL", 640, 480, (416.0 * (1 + index / 12), 320.0, 240.0, -0.02, 0.001))
        for index in range(12)
    ]
    cameras = [replace(DRONE, camera=lens) for lens in lenses]
    photographs = photographed(tmp_path / "zoomed", courtyard(), cameras, HALF_ORBIT)
    result = reconstructed(tmp_path, photographs)
    assert result.report.verdict == "accepted"
    assert result.report.registered == 12
    assert largest_error(result, centres(HALF_ORBIT)) < MAX_SHARE

    (tmp_path / "unknown").mkdir()
    result = reconstructed(tmp_path / "unknown", photographs, exif=False)
    assert largest_error(result, centres(HALF_ORBIT)) > MAX_SHARE
    assert result.report.verdict == "doubtful"


def along_a_wall(folder: Path, tiles: int) -> list[Path]:
    """Thirty photographs of a wall whose texture repeats itself so many times."""
    random = np.random.default_rng(3)
    tile = dead_leaves(125 if tiles > 1 else 625, 2000 // tiles, np.array([0.4, 0.4, 0.35]), random)
    texture = np.tile(tile, (625 // len(tile), tiles, 1))
    wall = Rectangle(np.array([-8.0, 4, -2]), np.array([16.0, 0, 0]), np.array([0, 0, 5.0]), texture)
    return photographed(folder, World((wall,)), 30 * [DRONE], ALONG_THE_WALL)


def test_a_wall_from_the_front_is_doubtful(tmp_path: Path):
    result = reconstructed(tmp_path, along_a_wall(tmp_path / "wall", tiles=1))
    assert result.report.verdict == "doubtful"
    assert FindingCode.UNLIKELY_FOCAL_LENGTH in {warning.code for warning in result.report.warnings}


def test_a_wall_that_repeats_itself_is_refused(tmp_path: Path):
    with pytest.raises(ReconstructionError) as refused:
        reconstructed(tmp_path, along_a_wall(tmp_path / "wall", tiles=16))
    assert "Take photographs from farther away" in refused.value.hint


def test_two_equal_walls_before_different_ground_are_doubtful(tmp_path: Path):
    """Ten photographs in a row and five far ones, of which some are registered at the opposite wall."""
    tour = orbit(28)
    poses = [tour[k] for k in (1, 2, 3, 4, 5, 6, 7, 9, 10, 11, 15, 18, 20, 23, 25)]
    camera = SimulatedCamera.like_a_drone(720, 540)
    result = reconstructed(
        tmp_path, photographed(tmp_path, lookalike_courtyard("two"), [camera] * len(poses), poses)
    )
    assert largest_error(result, centres(poses)) > MAX_SHARE
    assert result.report.verdict == "doubtful"
    assert FindingCode.CONFLICTING_VIEWS in {warning.code for warning in result.report.warnings}
