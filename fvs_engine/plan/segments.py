"""Segments against bodies: where they are inside, and how far apart two are; for many at once."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Interval = tuple[Array, Array]
"""Start and end of the part of each segment [N], as shares of it; empty where start exceeds end."""


def inside_slab(starts: Array, ends: Array, lower: float, upper: float) -> Interval:
    """Where a coordinate that goes from ``starts`` [N] to ``ends`` is between two bounds."""
    step = ends - starts
    with np.errstate(divide="ignore", invalid="ignore"):
        one, other = (lower - starts) / step, (upper - starts) / step
    inside = (starts >= lower) & (starts <= upper)
    still = step == 0.0
    first = np.where(still, np.where(inside, 0.0, 1.0), np.maximum(np.minimum(one, other), 0.0))
    last = np.where(still, np.where(inside, 1.0, 0.0), np.minimum(np.maximum(one, other), 1.0))
    return first, last


def inside_ball(starts: Array, ends: Array, radius: float) -> Interval:
    """Where segments [N, D] are in a ball, or disc, around the origin."""
    step = ends - starts
    square = (step**2).sum(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        middle = -(starts * step).sum(axis=1) / square
        # From the foot of the perpendicular: the discriminant would lose the digits of far segments.
        foot = starts + middle[:, None] * step
        half = np.sqrt(radius**2 - (foot**2).sum(axis=1)) / np.sqrt(square)
    inside = (starts**2).sum(axis=1) <= radius**2
    still = square == 0.0
    missed = np.isnan(half) & ~still
    first = np.where(still, np.where(inside, 0.0, 1.0), np.maximum(middle - half, 0.0))
    last = np.where(still, np.where(inside, 1.0, 0.0), np.minimum(middle + half, 1.0))
    return np.where(missed, 1.0, first), np.where(missed, 0.0, last)


def polygon_contains(polygon: Array, points: Array) -> Mask:
    """Which ``points`` [N, 2] are in a polygon [M, 2]: those with an odd number of edges to one side."""
    inside = np.zeros(len(points), dtype=np.bool_)
    x, y = points.T
    for (x1, y1), (x2, y2) in zip(polygon, np.roll(polygon, -1, axis=0), strict=True):
        spans = (y1 > y) != (y2 > y)
        if y1 != y2:
            inside ^= spans & (x < x1 + (y - y1) * ((x2 - x1) / (y2 - y1)))
    return inside


def polygon_crossed(polygon: Array, starts: Array, ends: Array) -> Mask:
    """Which segments [N, 2] have a point in a polygon [M, 2]."""
    crossed = np.zeros(len(starts), dtype=np.bool_)
    near = boxes_meet(starts, ends, polygon.min(axis=0), polygon.max(axis=0))
    starts, ends = starts[near], ends[near]
    mask = polygon_contains(polygon, starts) | polygon_contains(polygon, ends)
    for one, other in zip(polygon, np.roll(polygon, -1, axis=0), strict=True):
        left = np.flatnonzero(~mask)
        left = left[boxes_meet(starts[left], ends[left], np.minimum(one, other), np.maximum(one, other))]
        edge = np.broadcast_to(one, (len(left), 2)), np.broadcast_to(other, (len(left), 2))
        mask[left] = segments_distance(starts[left], ends[left], *edge) == 0.0
    crossed[near] = mask
    return crossed


def boxes_meet(starts: Array, ends: Array, lower: Array, upper: Array) -> Mask:
    """Which segments [N, D] have a bounding box that meets the box between two corners [D].

    The others are outside; this costs a tenth of computing distances.
    """
    lows, highs = np.minimum(starts, ends), np.maximum(starts, ends)
    return np.asarray(((lows <= upper) & (highs >= lower)).all(axis=1))


def segments_distance(starts: Array, ends: Array, others: Array, other_ends: Array) -> Array:
    """The distance [N] of each segment [N, D] from the other segment of its row; 0 where plane ones cross."""
    best: Array = np.minimum.reduce(
        [
            points_distance(starts, others, other_ends),
            points_distance(ends, others, other_ends),
            points_distance(others, starts, ends),
            points_distance(other_ends, starts, ends),
        ]
    )
    u, v, w = ends - starts, other_ends - others, starts - others
    uu, uv, vv = (u * u).sum(axis=1), (u * v).sum(axis=1), (v * v).sum(axis=1)
    uw, vw = (u * w).sum(axis=1), (v * w).sum(axis=1)
    determinant = uu * vv - uv**2
    with np.errstate(divide="ignore", invalid="ignore"):
        s, t = (uv * vw - vv * uw) / determinant, (uu * vw - uv * uw) / determinant
    # Where the lines are nearest within both segments; parallel ones are nearest at an end, as above.
    met = (determinant > 1e-14 * uu * vv) & (s >= 0.0) & (s <= 1.0) & (t >= 0.0) & (t <= 1.0)
    if starts.shape[1] == 2:
        best[met] = 0.0
        return best
    gap = np.linalg.norm(w[met] + s[met, None] * u[met] - t[met, None] * v[met], axis=1)
    best[met] = np.minimum(best[met], gap)
    return best


def points_distance(points: Array, starts: Array, ends: Array) -> Array:
    """The distance [N] of each point [N, D] from the segment of its row."""
    step = ends - starts
    square = (step**2).sum(axis=-1)
    share = ((points - starts) * step).sum(axis=-1) / np.where(square > 0.0, square, 1.0)
    foot = starts + np.clip(share, 0.0, 1.0)[..., None] * step
    return np.asarray(np.linalg.norm(points - foot, axis=-1))


def nearest_segment(points: Array, starts: Array, ends: Array) -> tuple[NDArray[np.int64], Array]:
    """Which of the segments [M, 3] is nearest to each point [N, 3], the first of equals, and its distance."""
    nearest = np.zeros(len(points), dtype=np.int64)
    best = np.full(len(points), np.inf)
    for number, (start, end) in enumerate(zip(starts, ends, strict=True)):
        distances = points_distance(points, start, end)
        nearer = distances < best
        nearest[nearer], best[nearer] = number, distances[nearer]
    return nearest, best
