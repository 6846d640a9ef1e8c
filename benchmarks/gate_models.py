"""Right and wrong models for the calibration of the gate: mapped from subsets, or perturbed.

A scene's features and matches are computed once; every subset gets a copy without the other images. What a
folder holds is not computed again.
"""

import contextlib
import json
import random
import shutil
import sqlite3
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import pycolmap
from numpy.typing import NDArray

from fvs_engine.errors import ReconstructionError
from fvs_engine.geometry.alignment.cameras import centre_spread
from fvs_engine.hold_out import hold_out
from fvs_engine.monitor import Monitor
from fvs_engine.scene.dataset import read_dataset
from fvs_engine.sfm.batch.mapping import calibrate_view_graph, load_models, run_mapper
from fvs_engine.sfm.batch.reconstruct import reconstruct
from fvs_engine.sfm.matching.features import extract_features
from fvs_engine.sfm.matching.match import match_features
from fvs_engine.sfm.pose_priors import ImageSet
from fvs_engine.sfm.settings import FeatureSettings, MapperName, SfmSettings
from fvs_engine.sfm.stages import SfmFolder, Stages

Centres = Mapping[str, NDArray[np.float64]]

MAPPERS: tuple[MapperName, ...] = ("incremental", "global")
SETTINGS = SfmSettings(threads=1, features_of_many=FeatureSettings())
"""Features as those of small sets, which most subsets are: they are computed once for the whole scene."""
_MOST = 55
"""Images of a scene that are used: the first ten, and those that are farthest from one another."""
_FEWEST = 20
"""Scenes with fewer images give the whole, runs of neighbours alone and with any others, and the sets of
``far_spread.py``."""
_SPREAD_SETS = 10
_RUNS_AND_OTHERS = 20
_SHIFT = 0.3
"""Displacement of spoilt models, in shares of the spread of the cameras."""
_STRETCH = 1.3
_TURN_DEG = 10.0


@dataclass(frozen=True)
class Scene:
    """A scene with true camera centres, or those of the model of all its photographs."""

    name: str
    image_dir: Path
    centres: Centres

    @staticmethod
    def read(data: Path, name: str) -> "Scene":
        """One of bonsai, fox and the two Strecha scenes; raises for data that is not there."""
        folder = data / name
        if name == "bonsai":
            centres = read_dataset(folder / "images", colmap=folder / "reference").centres()
        elif name == "fox":
            centres = read_dataset(folder / "images", transforms=folder / "transforms.json").centres()
        else:
            centres = _strecha(folder)
        return Scene(name, folder / "images", centres)

    @staticmethod
    def of_all(data: Path, name: str, cache: Path) -> "Scene":
        """A scene without true poses, with the centres of an accepted model of all its photographs.

        Their EXIF's GPS positions, where there are any, are its priors. ``cache`` keeps the model.
        """
        image_dir = data / name / "images"
        names = sorted(path.name for path in image_dir.iterdir())
        result = reconstruct(ImageSet(image_dir, names), cache / name / "reference", SETTINGS, Monitor())
        if result.report.verdict != "accepted":
            raise ReconstructionError(f"The model of all photographs of {name} is {result.report.verdict}.")
        return Scene(name, image_dir, result.reconstruction.centres())

    def pool(self) -> list[str]:
        """The images that subsets are drawn from."""
        names = sorted(self.centres)
        if len(names) <= _FEWEST:
            return names
        kept = list(hold_out(names, 8)[0])
        return sorted(self.farthest(kept, kept[:10], min(_MOST, len(kept))))

    def farthest(self, names: Sequence[str], first: Sequence[str], count: int) -> list[str]:
        """The ``first`` images, and then always the one farthest from all before."""
        chosen = list(first)
        while len(chosen) < count:
            others = [name for name in names if name not in chosen]
            gaps = [min(np.linalg.norm(self.centres[n] - self.centres[c]) for c in chosen) for n in others]
            chosen.append(others[int(np.argmax(gaps))])
        return chosen

    def far_spread(self, count: int, draw: random.Random) -> list[str]:
        """Far-spread images of a random three quarters of the scene, at most four fifths of these."""
        pool = sorted(draw.sample(sorted(self.centres), round(0.75 * len(self.centres))))
        return self.farthest(pool, [draw.choice(pool)], min(count, round(0.8 * len(pool))))

    def subsets(self) -> dict[str, list[str]]:
        """Name → images: neighbours, neighbours and far ones, far ones, any."""
        pool = self.pool()
        if len(pool) < _FEWEST:
            starts = range(0, len(pool) - 7, 2)
            return (
                {"all": pool}
                | {f"run8_{k}": pool[k : k + 8] for k in starts}
                | {f"runany_{k}": _run_and_others(pool, random.Random(k)) for k in range(_RUNS_AND_OTHERS)}
                | {f"spread_{k}": self.far_spread(15, random.Random(f"0 {k}")) for k in range(_SPREAD_SETS)}
            )
        middle = np.mean([self.centres[name] for name in pool], axis=0)
        central = min(pool, key=lambda name: float(np.linalg.norm(self.centres[name] - middle)))
        found = {f"near10far{k}": self.farthest(pool, pool[:10], 10 + k) for k in (5, 10)}
        found |= {f"far{k}": self.farthest(pool, [central], k) for k in (12, 16, 20)} | {"all": pool}
        for seed in range(4):
            draw = random.Random(seed)
            found[f"random15_{seed}"] = sorted(draw.sample(pool, 15))
            start = draw.randrange(len(pool) - 12)
            found[f"run12_{seed}"] = pool[start : start + 12]
            found[f"farfrom_{seed}"] = self.farthest(pool, [draw.choice(pool)], 14)
            start = draw.randrange(len(pool) - 10)
            found[f"runfar_{seed}"] = self.farthest(pool, pool[start : start + 8], 14)
        return found


def _run_and_others(names: Sequence[str], draw: random.Random) -> list[str]:
    """Ten neighbours, and up to five of the other images."""
    start = draw.randrange(max(len(names) - 9, 1))
    run = names[start : start + 10]
    others = [name for name in names if name not in run]
    return sorted([*run, *draw.sample(others, min(5, len(others)))])


def prepare(scene: Scene, folder: Path) -> Stages:
    """Features and matches of the scene's pool, in ``folder``."""
    stages = Stages(SfmFolder(folder), scene.image_dir, SETTINGS, Monitor())
    names = stages.open(scene.pool(), 2)
    extract_features(stages, names)
    match_features(stages, names)
    return stages


def map_subset(scene: Scene, names: Sequence[str], whole: SfmFolder, folder: Path) -> SfmFolder:
    """The models of both mappers of some images; ``whole`` has the features and matches of the scene."""
    target = SfmFolder(folder)
    if not (folder / "mapped").exists():
        folder.mkdir(parents=True, exist_ok=True)
        with contextlib.closing(sqlite3.connect(whole.database)) as database:
            database.execute("PRAGMA wal_checkpoint(TRUNCATE)")
        shutil.copyfile(whole.database, target.database)
        shutil.copyfile(whole.state, target.state)
        stages = Stages(target, scene.image_dir, SETTINGS, Monitor())
        stages.open(names, 2)
        calibrate_view_graph(stages)
        for mapper in MAPPERS:
            run_mapper(stages, mapper, len(names))
        (folder / "mapped").write_text(json.dumps(list(names)))
    return target


def mapped(folder: SfmFolder) -> dict[str, Callable[[], pycolmap.Reconstruction]]:
    """Mapper → its largest model, for mappers that made one; each call reads the files again."""
    paths = {mapper: folder.mapping(mapper) for mapper in MAPPERS}
    return {mapper: partial(_largest, path) for mapper, path in paths.items() if load_models(path)}


def spoilt(sound: Callable[[], pycolmap.Reconstruction]) -> dict[str, Callable[[], pycolmap.Reconstruction]]:
    """Kind → a wrong model made of a sound one, anew at each call."""
    return {spoil.__name__: partial(_spoil, sound, spoil) for spoil in SPOILS}


def _largest(path: Path) -> pycolmap.Reconstruction:
    return load_models(path)[0]


def _spoil(
    sound: Callable[[], pycolmap.Reconstruction], spoil: Callable[[pycolmap.Reconstruction], None]
) -> pycolmap.Reconstruction:
    model = sound()
    spoil(model)
    return model


def shifted(model: pycolmap.Reconstruction) -> None:
    """The last third of the images, moved together along the row of cameras as by a repeated pattern.

    Where all cameras are in one line, the epipolar geometry of every pair stays.
    """
    images, centres = _in_order(model)
    for image in images[2 * len(images) // 3 :]:
        _move(image, image.projection_center() + _along_row(centres))


def slid(model: pycolmap.Reconstruction) -> None:
    """One image in the middle of the capture, moved along the row of cameras."""
    images, centres = _in_order(model)
    image = images[len(images) // 2]
    _move(image, image.projection_center() + _along_row(centres))


def stretched(model: pycolmap.Reconstruction) -> None:
    """The second half of the images, larger by a factor about the first of them."""
    images, centres = _in_order(model)
    half = len(images) // 2
    for image, centre in zip(images[half:], centres[half:], strict=True):
        _move(image, centres[half] + _STRETCH * (centre - centres[half]))


def turned(model: pycolmap.Reconstruction) -> None:
    """The second half of the images, turned together about the first of them, across the row of cameras."""
    images, centres = _in_order(model)
    half = len(images) // 2
    across = np.linalg.svd(centres - centres.mean(axis=0))[2][2]
    turn = pycolmap.Rotation3d(np.radians(_TURN_DEG) * across)
    about = centres[half]
    moved = pycolmap.Rigid3d(turn, about - turn.matrix() @ about)
    for image in images[half:]:
        image.frame.set_cam_from_world(image.camera_id, image.cam_from_world() * moved.inverse())


def mirrored(model: pycolmap.Reconstruction) -> None:
    """All cameras mirrored at the plane across their mean viewing direction: a relief read the other way."""
    images = [image for image in model.images.values() if image.has_pose]
    axis = np.sum([image.viewing_direction() for image in images], axis=0)
    axis /= np.linalg.norm(axis)
    mirror, depth = np.eye(3) - 2.0 * np.outer(axis, axis), np.diag([1.0, 1.0, -1.0])
    for image in images:
        rotation = depth @ image.cam_from_world().rotation.matrix() @ mirror
        centre = mirror @ image.projection_center()
        pose = pycolmap.Rigid3d(pycolmap.Rotation3d(rotation), -rotation @ centre)
        image.frame.set_cam_from_world(image.camera_id, pose)


SPOILS = (shifted, slid, stretched, turned, mirrored)
"""All ways to make a sound model wrong."""


def _in_order(model: pycolmap.Reconstruction) -> tuple[list[pycolmap.Image], NDArray[np.float64]]:
    """The posed images in order of capture, and their centres [N, 3]."""
    images = sorted(
        (image for image in model.images.values() if image.has_pose), key=lambda image: image.name
    )
    return images, np.stack([image.projection_center() for image in images])


def _along_row(centres: NDArray[np.float64]) -> NDArray[np.float64]:
    """A share of the spread, along the row of cameras."""
    direction = np.linalg.svd(centres - centres.mean(axis=0))[2][0]
    return np.asarray(_SHIFT * centre_spread(centres) * direction)


def _move(image: pycolmap.Image, centre: NDArray[np.float64]) -> None:
    rotation = image.cam_from_world().rotation
    pose = pycolmap.Rigid3d(rotation, -rotation.matrix() @ centre)
    image.frame.set_cam_from_world(image.camera_id, pose)


def _strecha(folder: Path) -> Centres:
    centres = {}
    for file in (folder / "gt_dense_cameras").glob("*.camera"):
        rows = [line.split() for line in file.read_text().splitlines() if line.strip()]
        centres[file.name.removesuffix(".camera")] = np.array(rows[7], dtype=np.float64)
    return centres
