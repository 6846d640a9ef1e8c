"""Decides which unregistered images to try again: those whose inputs have changed since the last try."""

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
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


class RegistrationInputs:
    """What the registration of unregistered images in a model depends on.

    That is an image's own prior and its camera as far as registered images determine it, whether priors can
    judge poses, and the registered images ``around`` it (image → others, with the numbers of their verified
    matches): their poses, cameras, priors and numbers of points. With the same inputs a try has the same
    result, but for the luck of RANSAC and for what all images share: the spread of their centres, and the
    frame of their priors. ``cameras``: image → id of its camera.
    """

    def __init__(
        self,
        model_dir: Path,
        around: Mapping[str, Mapping[str, int]],
        cameras: Mapping[str, int],
        priors: PosePriors,
        *,
        informative: bool = True,
    ) -> None:
        self._model_dir = model_dir
        self._around = around
        self._cameras = cameras
        self._priors = priors
        self._informative = informative

    def of(self, name: str) -> str:
        """Digest of an image's inputs."""
        registered = self._registered
        camera = registered.cameras.get(self._cameras[name])
        facts = [f"{self._informative} {camera} {self._prior(name)}"]
        for other, matches in sorted(self._around[name].items()):
            if other in registered.images:
                facts.append(f"{other} {matches} {registered.images[other]} {self._prior(other)}")
        return hashlib.sha256("\n".join(facts).encode()).hexdigest()

    def changed(self, name: str, tried: Mapping[str, str]) -> bool:
        """Whether an image was not ``tried`` (image → digest at the last try) with its present inputs."""
        return name not in tried or tried[name] != self.of(name)

    def due(self, tried: Mapping[str, str]) -> list[str]:
        """The images whose inputs have changed, or may when one of these is registered.

        The latter match one of them, or match the same image.
        """
        due = {name for name in self._around if self.changed(name, tried)}
        beside = due
        while beside:
            near = beside.union(*(self._around[name] for name in beside))
            others = self._around.keys() - due
            beside = {name for name in others if name in near or not near.isdisjoint(self._around[name])}
            due |= beside
        return [name for name in self._around if name in due]

    def _prior(self, name: str) -> str | None:
        prior = self._priors.by_name.get(name)
        return None if prior is None else prior.model_dump_json()

    @cached_property
    def _registered(self) -> "_Registered":
        return _Registered.of(open_colmap(self._model_dir))


@dataclass(frozen=True)
class _Registered:
    """The registered images by name, with pose, camera and number of points, and their cameras by id.

    All numbers are written to the last digit.
    """

    images: Mapping[str, str]
    cameras: Mapping[int, str]

    @staticmethod
    def of(model: pycolmap.Reconstruction) -> "_Registered":
        posed = [image for image in model.images.values() if image.has_pose]
        cameras = {}
        for camera_id in {image.camera_id for image in posed}:
            camera = model.camera(camera_id)
            cameras[camera_id] = f"{camera.model_name} {camera.params.tolist()}"
        images = {}
        for image in posed:
            pose = image.cam_from_world().matrix().tolist()
            images[image.name] = f"{pose} {cameras[image.camera_id]} {image.num_points3D}"
        return _Registered(images, cameras)
