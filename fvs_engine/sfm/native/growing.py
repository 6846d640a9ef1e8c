"""The native stages of growth: images registered into a standing model, and images placed in it."""

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pycolmap

from fvs_engine.errors import InvalidInputError
from fvs_engine.geometry.alignment.cameras import align_poses
from fvs_engine.sfm.colmap.database import VerifiedPair, image_ids, read_keypoints, read_verified_pairs
from fvs_engine.sfm.colmap.model import camera_poses, move
from fvs_engine.sfm.native.contradictions import Contradictions, Keypoints
from fvs_engine.sfm.verification.evidence import MIN_PAIR_MATCHES, check_pairs
from fvs_engine.sfm.verification.positions import Positions

Report = Callable[[int], None]

_MIN_POSE_INLIERS = 30
"""Points that an image must see for its pose to be estimated; COLMAP's own limit."""

_MAX_REFUSALS = 3
"""So often the place found for an image may be contradicted before it is left for another call."""


@dataclass(frozen=True)
class Adjustments:
    """When all cameras are adjusted together: by how much the model grew since the last time."""

    every: float
    images: int
    points: int

    def due(self, model: pycolmap.Reconstruction) -> bool:
        """Whether images or points grew by the share ``every``."""
        grown = 1.0 + self.every
        return bool(
            model.num_reg_images() >= grown * self.images or model.num_points3D() >= grown * self.points
        )


def grow(
    report: Report,
    *,
    database: str,
    image_dir: str,
    model_dir: str,
    out_dir: str,
    names: list[str],
    refine: bool,
    positions: dict[str, Any],
    min_image_support: float,
    adjust_every: float,
    adjusted_images: int,
    adjusted_points: int,
    seed: int,
    threads: int | None,
) -> dict[str, Any]:
    """Register ``names`` into the model as far as possible; the model that results goes to ``out_dir``.

    ``positions`` are ``Positions`` as JSON.

    Returns the names ``registered``, those ``refused`` with what contradicts them, the model's size when it
    was adjusted last, and, if that was now, the share of verified matches that it explains.
    """
    pycolmap.set_random_seed(seed)
    model = pycolmap.Reconstruction(model_dir)
    standing = set(model.point3D_ids())
    growth = _Growth(
        model,
        _load(database, [image.name for image in model.images.values()] + names),
        _pipeline_options(refine, seed, threads),
        Contradictions.read(database, min_image_support, Positions.from_json(positions)),
    )
    adjustments = Adjustments(adjust_every, adjusted_images, adjusted_points)
    adjusted = False
    for registered in growth.register(names):
        report(registered)
        if adjustments.due(model):
            growth.adjust_all()
            adjustments = Adjustments(adjust_every, model.num_reg_images(), model.num_points3D())
            adjusted = True
    growth.mapper.end_reconstruction(False)
    growth.take_out_contradicted()
    _color(model, image_dir, standing)
    model.update_point_3d_errors()
    model.write_binary(out_dir)
    posed = {image.name for image in model.images.values() if image.has_pose}
    return {
        "registered": [name for name in growth.registered if name in posed],
        "posed": sorted(posed),
        "refused": growth.refused,
        "adjusted_images": adjustments.images,
        "adjusted_points": adjustments.points,
        "support": growth.support() if adjusted else None,
    }


def _load(database: str, names: Sequence[str]) -> pycolmap.DatabaseCache:
    options = pycolmap.DatabaseCacheOptions()
    options.min_num_matches = MIN_PAIR_MATCHES
    options.image_names = set(names)
    with pycolmap.Database.open(database) as opened:
        return pycolmap.DatabaseCache.create(opened, options)


def _pipeline_options(refine: bool, seed: int, threads: int | None) -> pycolmap.IncrementalPipelineOptions:
    options = pycolmap.IncrementalPipelineOptions()
    options.random_seed = seed
    options.num_threads = -1 if threads is None else threads
    options.ba_refine_focal_length = options.ba_refine_extra_params = refine
    options.mapper.abs_pose_refine_focal_length = options.mapper.abs_pose_refine_extra_params = refine
    return options


class _Growth:
    """COLMAP's incremental mapper on a model that stands already."""

    def __init__(
        self,
        model: pycolmap.Reconstruction,
        cache: pycolmap.DatabaseCache,
        options: pycolmap.IncrementalPipelineOptions,
        contradictions: Contradictions,
    ) -> None:
        self.model = model
        self.registered: list[str] = []
        self.refused: dict[str, str] = {}
        self._refusals: Counter[str] = Counter()
        self._resting: set[str] = set()
        self._cache = cache
        self._options = options
        self._contradictions = contradictions
        self.mapper = self._begin()
        # What many images agreed on is not bent to fit one more; a camera that is new is estimated.
        self._local = options.get_mapper()
        self._local.constant_cameras = {image.camera_id for image in model.images.values() if image.has_pose}

    def register(self, names: Sequence[str]) -> Iterator[int]:
        """Register what can be registered, the most promising first; yields how many are, after each one."""
        while self._register_next(set(names)):
            yield len(self.registered)

    def _register_next(self, names: set[str]) -> bool:
        for structure_less in (False, True):
            for image_id in self.mapper.find_next_images(self._local, structure_less):
                name = self.model.image(image_id).name
                if name not in names or name in self._resting or self._refusals[name] >= _MAX_REFUSALS:
                    continue
                if self._register_one(image_id, structure_less):
                    self._resting.clear()  # the model has grown: they may be placed better now
                    return True
        return False

    def adjust_all(self) -> None:
        """Adjust all cameras and points together, and lay the result onto what stood before."""
        before = camera_poses(self.model)
        options = self._options
        self.mapper.iterative_global_refinement(
            options.ba_global_max_refinements,
            options.ba_global_max_refinement_change,
            options.get_mapper(),
            options.get_global_bundle_adjustment(),
            options.get_triangulation(),
            False,
        )
        self.mapper.filter_frames(options.get_mapper())
        try:
            move(self.model, align_poses(camera_poses(self.model), before))
        except InvalidInputError:  # all stand in one place: only the adjustment's own anchor holds them
            return

    def support(self) -> float | None:
        """The share of the verified matches within the model that its poses explain."""
        known = self._contradictions
        checks = check_pairs(self.model, known.pairs, known.keypoints, relative_poses=False)
        matches = sum(check.matches for check in checks)
        return sum(check.supported for check in checks) / matches if matches > 0 else None

    def _register_one(self, image_id: int, structure_less: bool) -> bool:
        """Register one image and what it shows, if its pairs agree with the place found for it."""
        image = self.model.image(image_id)
        camera = self.model.camera(image.camera_id)
        params = list(camera.params)
        find = (
            self.mapper.register_next_structure_less_image
            if structure_less
            else self.mapper.register_next_image
        )
        if not find(self._local, image_id):
            return False
        contradiction = self._contradictions.of(self.model, image_id)
        if contradiction is not None:
            self._refuse(image, contradiction)
            camera.params = params
            self.mapper.end_reconstruction(False)  # its books count the image; new ones do not
            self.mapper = self._begin()
            return False
        triangulation = self._options.get_triangulation()
        self.mapper.triangulate_image(triangulation, image_id)
        self.mapper.iterative_local_refinement(
            self._options.ba_local_max_refinements,
            self._options.ba_local_max_refinement_change,
            self._local,
            self._options.get_local_bundle_adjustment(),
            triangulation,
            image_id,
        )
        self.refused.pop(image.name, None)
        self.registered.append(image.name)
        return True

    def take_out_contradicted(self) -> None:
        """Look at the new cameras once more, where all adjustments have left them."""
        for name in self.registered:
            image = self.model.find_image_with_name(name)
            if image is not None and image.has_pose:
                contradiction = self._contradictions.of(self.model, image.image_id)
                if contradiction is not None:
                    self._refuse(image, contradiction)

    def _refuse(self, image: pycolmap.Image, contradiction: str) -> None:
        self.refused[image.name] = contradiction
        self._refusals[image.name] += 1
        self._resting.add(image.name)
        self.model.deregister_frame(image.frame_id)

    def _begin(self) -> pycolmap.IncrementalMapper:
        mapper = pycolmap.IncrementalMapper(self._cache)
        mapper.begin_reconstruction(self.model)
        return mapper


def _color(model: pycolmap.Reconstruction, image_dir: str, standing: set[int]) -> None:
    """Colour the new points, each from the first image that shows it."""
    images = {model.point3D(i).track.elements[0].image_id for i in model.point3D_ids() if i not in standing}
    for image_id in sorted(images):
        model.extract_colors_for_image(image_id, image_dir)


def copy_features(_report: Report, *, source: str, target: str, names: list[str]) -> None:
    """Copy keypoints and descriptors of images that both databases name; those that have them are skipped.

    Keypoints come last: an image that has them is complete, also after a kill.
    """
    numbers = image_ids(Path(source)), image_ids(Path(target))
    with pycolmap.Database.open(source) as read, pycolmap.Database.open(target) as written:
        for name in names:
            old, new = numbers[0][name], numbers[1][name]
            if not written.exists_descriptors(new):
                written.write_descriptors(new, read.read_descriptors(old))
            if not written.exists_keypoints(new):
                written.write_keypoints(new, read.read_keypoints(old))


def locate(
    report: Report,
    *,
    database: str,
    model_dir: str,
    neighbours: dict[str, list[str]],
    siblings: dict[str, str],
    positions: dict[str, Any],
    min_image_support: float,
    seed: int,
) -> dict[str, dict[str, Any]]:
    """Place images in a model from their matches with ``neighbours`` that stand in it; it stays as it is.

    ``siblings`` maps images to one in the model that was taken with the same camera; the focal length of the
    others is estimated. Returns, for those that could be placed, name → camera model, size, parameters and
    camera_from_model [3, 4].
    """
    model = pycolmap.Reconstruction(model_dir)
    ids = image_ids(Path(database))
    names = {image_id: name for name, image_id in ids.items()}
    wanted = {frozenset((ids[name], ids[other])) for name in neighbours for other in neighbours[name]}
    pairs = [
        pair
        for pair in read_verified_pairs(Path(database), MIN_PAIR_MATCHES)
        if frozenset((pair.first, pair.second)) in wanted
    ]
    keypoints = read_keypoints(Path(database), {i for pair in pairs for i in (pair.first, pair.second)})
    standing = {image.name: image_id for image_id, image in model.images.items()}
    # The database numbers its images in its own way; the model's numbers are put in their place.
    number = {i: standing[names[i]] for i in keypoints if names[i] in standing}
    guests = {name: max(standing.values()) + 1 + k for k, name in enumerate(sorted(neighbours))}
    number |= {ids[name]: guest for name, guest in guests.items()}
    translated = [VerifiedPair(number[pair.first], number[pair.second], pair.matches, None) for pair in pairs]
    features = {number[i]: xy for i, xy in keypoints.items()}
    cameras = {}
    with pycolmap.Database.open(database) as opened:
        for name in neighbours:
            cameras[name] = opened.read_camera(opened.read_image(ids[name]).camera_id)
    contradictions = Contradictions(translated, features, min_image_support, Positions.from_json(positions))
    placed: dict[str, dict[str, Any]] = {}
    for done, (name, guest) in enumerate(guests.items(), start=1):
        sibling = model.image(standing[siblings[name]]).camera if name in siblings else None
        own = [pair for pair in translated if guest in (pair.first, pair.second)]
        found = _place(model, name, guest, own, features, sibling, cameras[name], seed)
        if found and contradictions.of(model, guest) is None:
            image = model.image(guest)
            camera = model.camera(image.camera_id)
            placed[name] = {
                "model": camera.model_name,
                "size": [camera.width, camera.height],
                "params": list(camera.params),
                "camera_from_model": image.cam_from_world().matrix().tolist(),
            }
        if found:
            model.deregister_frame(model.image(guest).frame_id)
        report(done)
    return placed


def _place(
    model: pycolmap.Reconstruction,
    name: str,
    guest: int,
    pairs: Sequence[VerifiedPair],
    features: Keypoints,
    sibling: pycolmap.Camera | None,
    camera: pycolmap.Camera,
    seed: int,
) -> bool:
    """Add the image to the model with the pose that its matches give it; whether they give one."""
    seen = _points_seen(model, guest, pairs)
    if len(seen) < _MIN_POSE_INLIERS:
        return False
    if sibling is None:
        camera = pycolmap.Camera(camera.todict() | {"camera_id": max(model.cameras) + 1})
    else:
        camera = sibling
    mapper = pycolmap.IncrementalMapperOptions()
    estimation = pycolmap.AbsolutePoseEstimationOptions()
    estimation.estimate_focal_length = sibling is None and not camera.has_prior_focal_length
    estimation.ransac.max_error = mapper.abs_pose_max_error
    estimation.ransac.min_inlier_ratio = mapper.abs_pose_min_inlier_ratio
    estimation.ransac.random_seed = seed
    refinement = pycolmap.AbsolutePoseRefinementOptions()
    refinement.refine_focal_length = refinement.refine_extra_params = sibling is None
    answer = pycolmap.estimate_and_refine_absolute_pose(
        np.stack([features[guest][feature] for feature, _ in seen]),
        np.stack([model.point3D(point).xyz for _, point in seen]),
        camera,
        estimation,
        refinement,
    )
    if answer is None or answer["num_inliers"] < _MIN_POSE_INLIERS:
        return False
    if sibling is None:
        model.add_camera_with_trivial_rig(camera)
    image = pycolmap.Image(name=name, camera_id=camera.camera_id, image_id=guest)
    model.add_image_with_trivial_frame(image, answer["cam_from_world"])
    return True


def _points_seen(
    model: pycolmap.Reconstruction, guest: int, pairs: Sequence[VerifiedPair]
) -> list[tuple[int, int]]:
    """The (feature, point) of an image that its matches with standing images suggest, each once."""
    seen = set()
    for pair in pairs:
        other, column = (pair.second, 0) if pair.first == guest else (pair.first, 1)
        points = model.image(other).points2D
        for match in pair.matches:
            point = points[int(match[1 - column])]
            if point.has_point3D():
                seen.add((int(match[column]), int(point.point3D_id)))
    return sorted(seen)


GROWING_JOBS: Mapping[str, Callable[..., Any]] = {job.__name__: job for job in (grow, copy_features, locate)}
"""Name → job, as ``native.run_native`` calls them."""
