"""Seed points of a new model: the sparse points that its views share, or guesses."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fvs_engine.sfm.growing.two_view_points import TwoViewPoints
from fvs_engine.sfm.reconstruction import PointCloud
from fvs_engine.splat.gaussians import Gaussians
from fvs_engine.splat.initialise import initialise_from_points, point_spacing
from fvs_engine.splat.views import TrainingView, points_that_count, scene_extent

Array = NDArray[np.float64]

MIN_POINTS = 100
"""With fewer sparse points than this a model also starts from guessed seeds."""

GUESSES_PER_VIEW = 2_000
_DEPTHS = (0.3, 4.0)
"""Nearest and farthest guess, in typical depths of the scene."""


@dataclass(frozen=True, eq=False)
class Seeds:
    """Seed points with the distances ``spacing`` [P] to their neighbours."""

    points: PointCloud
    spacing: Array

    def __len__(self) -> int:
        return len(self.points)

    def and_also(self, others: "Seeds") -> "Seeds":
        """The union of these and ``others``."""
        spacing = np.concatenate([self.spacing, others.spacing])
        return Seeds(self.points.and_also(others.points), spacing)

    def gaussians(self, sh_degree: int) -> Gaussians:
        """An isotropic Gaussian of low opacity at each seed."""
        return initialise_from_points(self.points.xyz, self.points.colors, sh_degree, self.spacing)


def initial_seeds(points: PointCloud, views: Sequence[TrainingView], room: int, seed: int) -> Seeds:
    """The seeds of a new model of ``views``: their sparse ``points``, with guesses when those are few.

    At most ``room``, and none that masked pixels alone show. They depend neither on the points' order nor on
    the views'.
    """
    counts = points_that_count(points.xyz, views)
    seeds = seeds_on_points(PointCloud(points.xyz[counts], points.colors[counts]), room)
    if len(seeds) >= MIN_POINTS:
        return seeds
    ordered = sorted(views, key=lambda view: view.name)
    return seeds.and_also(guessed_seeds(ordered, room - len(seeds), seed))


def seeds_on_points(points: PointCloud, room: int) -> Seeds:
    """Seeds on ``points``, ordered by position; at most ``room``, those with the largest spacing."""
    finite = np.isfinite(points.xyz).all(axis=1)
    xyz, colors = points.xyz[finite], points.colors[finite]
    if len(xyz) == 0:
        return Seeds(PointCloud(xyz, colors), np.zeros(0))
    spacing = point_spacing(xyz)
    order = np.lexsort(xyz.T)
    if len(order) > room:
        order = order[np.sort(np.argsort(-spacing[order], kind="stable")[:room])]
    return Seeds(PointCloud(xyz[order], colors[order]), spacing[order])


def guessed_seeds(views: Sequence[TrainingView], room: int, seed: int) -> Seeds:
    """Seeds on random rays through the images of ``views``, where they count, with their colours.

    At most ``room``. Depths are log-uniform around the distance to the views' common focus. Only the visited
    images and their views are used. Training moves, prunes and replaces these seeds.
    """
    generator = np.random.default_rng([seed, len(views)])
    look_at = _common_focus(views)
    nearest, farthest = _DEPTHS
    count = min(GUESSES_PER_VIEW, room // len(views))
    xyz, colors = [], []
    for view in views:
        camera = view.camera
        pixels = generator.uniform(size=(count, 2)) * [camera.width, camera.height]
        typical = float(np.linalg.norm(view.centre - look_at))
        depths = typical * np.exp(generator.uniform(np.log(nearest), np.log(farthest), count))
        columns, rows = pixels.astype(np.int64).T
        if view.mask is not None:
            counts = view.mask[rows, columns]
            pixels, depths, columns, rows = pixels[counts], depths[counts], columns[counts], rows[counts]
        xyz.append(view.camera_from_model.inverse().apply(camera.unproject(pixels, depths)))
        colors.append(view.image[rows, columns])
    points = PointCloud(np.concatenate(xyz), np.concatenate(colors))
    return Seeds(points, point_spacing(points.xyz))


def _common_focus(views: Sequence[TrainingView]) -> Array:
    """The point nearest to all optical axes; ahead of the cameras by their spread when it is behind one."""
    centres = np.stack([view.centre for view in views])
    forward = np.stack([view.camera_from_model.rotation[2] for view in views])
    across = np.eye(3) - forward[:, :, None] * forward[:, None, :]
    target = (across @ centres[:, :, None]).sum(axis=0)[:, 0]
    focus = np.linalg.lstsq(across.sum(axis=0), target, rcond=1e-6)[0]
    ahead = ((focus - centres) * forward).sum(axis=1)
    if (ahead > 0).all():
        return np.asarray(focus)
    spread = scene_extent(views, (centres + forward).astype(np.float32))
    return np.asarray(centres.mean(axis=0) + spread * forward.mean(axis=0))


def colored(points: TwoViewPoints, views: Sequence[TrainingView]) -> PointCloud:
    """The points, each with the colour of the pixel that shows it.

    Points outside of their undistorted photograph are left out.
    """
    found, colors = [np.zeros((0, 3))], [np.zeros((0, 3), dtype=np.uint8)]
    for view in views:
        xyz = points.xyz[points.seen_in == view.name]
        px = view.camera.project(view.camera_from_model.apply(xyz))
        inside = ((px >= 0) & (px < (view.camera.width, view.camera.height))).all(axis=1)
        column, row = px[inside].astype(np.int64).T
        found.append(xyz[inside])
        colors.append(view.image[row, column])
    return PointCloud(np.concatenate(found), np.concatenate(colors))
