"""Which unregistered images to try again: those whose chances of a pose have changed since the last try."""

import hashlib
from collections.abc import Mapping, Sequence
from functools import cached_property
from pathlib import Path

import pycolmap

from fvs_engine.sfm.colmap.model import open_colmap
from fvs_engine.sfm.pose_priors import PosePriors

Pairs = Mapping[tuple[str, str], int]
"""Pairs of images → the number of their verified matches."""


def matches_of(names: Sequence[str], pairs: Pairs) -> dict[str, dict[str, int]]:
    """Those of ``names`` that are in ``pairs`` → the images that they match, with the number of matches."""
    found: dict[str, dict[str, int]] = {name: {} for name in names}
    for (first, second), count in pairs.items():
        for name, other in ((first, second), (second, first)):
            if name in found:
                found[name][other] = count
    return {name: others for name, others in found.items() if others}


class Chances:
    """What decides whether unregistered images get a pose in a model.

    These are an image's own prior, whether priors can judge poses, and the registered images ``around`` it
    (image → others, with a weight each), by their poses, cameras and numbers of points. With the same chances
    a try has the same result.
    """

    def __init__(
        self,
        model_dir: Path,
        around: Mapping[str, Mapping[str, int]],
        priors: PosePriors,
        *,
        informative: bool = True,
    ) -> None:
        self._model_dir = model_dir
        self._around = around
        self._priors = priors
        self._informative = informative

    def of(self, name: str) -> str:
        """Digest of an image's chances."""
        prior = self._priors.by_name.get(name)
        digest = hashlib.sha256()
        digest.update(f"{self._informative} {prior and prior.model_dump_json()}".encode())
        for other, weight in sorted(self._around[name].items()):
            if other in self._states:
                digest.update(f" {other} {weight} {self._states[other]}".encode())
        return digest.hexdigest()

    def changed(self, name: str, tried: Mapping[str, str]) -> bool:
        """Whether an image was not ``tried`` (image → digest at the last try) with its present chances."""
        return name not in tried or tried[name] != self.of(name)

    def due(self, tried: Mapping[str, str]) -> list[str]:
        """The images whose chances have changed, or will if one of these is registered.

        The latter match one of them, or match the same image.
        """
        due = {name for name in self._around if self.changed(name, tried)}
        beside = due
        while beside:
            near = beside.union(*(self._around[name] for name in beside))
            waiting = self._around.keys() - due
            beside = {name for name in waiting if name in near or not near.isdisjoint(self._around[name])}
            due |= beside
        return [name for name in self._around if name in due]

    @cached_property
    def _states(self) -> dict[str, str]:
        model = open_colmap(self._model_dir)
        return {image.name: _state(image) for image in model.images.values() if image.has_pose}


def _state(image: pycolmap.Image) -> str:
    """Pose, camera and number of points of a registered image, to the last digit."""
    camera = image.camera
    assert camera is not None
    pose, params = image.cam_from_world().matrix().tolist(), camera.params.tolist()
    return f"{pose} {camera.model_name} {params} {image.num_points3D}"
