"""The ground of a site by its sparse points, where no height model is given."""

import numpy as np
from numpy.typing import NDArray

from fvs_engine.errors import InvalidInputError
from fvs_schema.scenes import AltitudeDatum
from fvs_schema.terrain import NO_HEIGHT_M, Terrain

Array = NDArray[np.float64]

LEAST_POINTS = 100
"""Fewer make no ground."""
_BOX_PERCENTILES = (1.0, 99.0)
"""Of latitudes and longitudes, around which the grid is: sparse points have far outliers."""
_PER_CELL = 20.0
"""Points in a cell of the grid, on average."""
_LEAST_IN_CELL = 3
_LOW = 0.1
"""The share of a cell's points that are lower than its ground: above are plants, below mismatches."""
_NEIGHBOURS = 8
"""Cells with points between which the ground of a cell without is interpolated."""
_MARGIN = 0.2
"""The share of its extent by which the ground reaches beyond the points, as cameras at their edge do."""
_FARTHEST = 0.25
"""The share of its extent from the nearest cell with points beyond which the ground is not known."""
_DEGREE_M = 111_195.0
_LEAST_EXTENT_M = 1.0
_MOST_CELLS = 4_500
_MOST_IN_A_ROW = 160
"""Without the margin, with which a terrain has its most heights."""


def ground_of_points(geodetic: Array, datum: AltitudeDatum) -> Terrain:
    """The ground under points [N, 3] (latitude and longitude in degrees, altitude in metres above ``datum``).

    A low share of the heights in each cell of a grid, smoothed by the median with the cells around it, and
    interpolated where a cell has no points. A roof that hides all of a cell is its ground.

    Raises ``InvalidInputError`` for fewer than ``LEAST_POINTS``.
    """
    geodetic = geodetic[np.isfinite(geodetic).all(axis=1)]
    if len(geodetic) < LEAST_POINTS:
        raise InvalidInputError(
            f"The model has {len(geodetic)} sparse points, too few for a ground: {LEAST_POINTS} are needed.",
            hint="Give a height model, or photographs that overlap more.",
        )
    latitude_deg, longitude_deg = (float(value) for value in np.median(geodetic[:, :2], axis=0))
    east_deg = (geodetic[:, 1] - longitude_deg + 180.0) % 360.0 - 180.0
    metres_per_degree = _DEGREE_M * np.array([1.0, max(np.cos(np.deg2rad(latitude_deg)), 1e-3)])
    level_m = np.stack([geodetic[:, 0] - latitude_deg, east_deg], axis=1) * metres_per_degree
    low_m, high_m = np.percentile(level_m, _BOX_PERCENTILES, axis=0)
    inside = ((level_m >= low_m) & (level_m <= high_m)).all(axis=1)
    corner_m, cell_m, shape = _grid(low_m, high_m, int(inside.sum()))
    places = (level_m[inside] - corner_m) / cell_m  # in cells
    cells = np.clip(places.astype(np.int64), 0, np.array(shape) - 1)
    heights = _surface(cells, geodetic[inside, 2], shape)
    # The low points of a cell on a slope are those at its foot: again, without the slope.
    slopes = np.nan_to_num(np.stack(list(np.gradient(heights)), axis=-1))[tuple(cells.T)]
    rise_m = (slopes * (places - cells - 0.5)).sum(axis=1)
    heights = _surface(cells, geodetic[inside, 2] - rise_m, shape)
    south_deg, west_deg = (corner_m + cell_m / 2.0) / metres_per_degree + (latitude_deg, longitude_deg)
    latitude_step_deg, longitude_step_deg = cell_m / metres_per_degree
    return Terrain(
        south_deg=float(south_deg),
        west_deg=float((west_deg + 180.0) % 360.0 - 180.0),
        latitude_step_deg=float(latitude_step_deg),
        longitude_step_deg=float(longitude_step_deg),
        columns=shape[1],
        heights_m=tuple(np.where(np.isnan(heights), NO_HEIGHT_M, heights.round(3)).ravel().tolist()),
        altitude_datum=datum,
    )


def _grid(low_m: Array, high_m: Array, points: int) -> tuple[Array, Array, tuple[int, int]]:
    """The corner [2] of a grid over a box and a margin, the size of cells [2], rows and columns."""
    extent_m = np.maximum(high_m - low_m, _LEAST_EXTENT_M)
    most = min(_MOST_CELLS, max(4.0, points / _PER_CELL))
    side_m = np.sqrt(extent_m.prod() / most)
    counts = np.clip(np.floor(extent_m / side_m), 1, _MOST_IN_A_ROW)
    cell_m, margin = extent_m / counts, np.ceil(_MARGIN * counts)
    rows, columns = (counts + 2 * margin).astype(int).tolist()
    return (low_m + high_m - extent_m) / 2.0 - margin * cell_m, cell_m, (rows, columns)


def _surface(cells: NDArray[np.int64], heights: Array, shape: tuple[int, int]) -> Array:
    """The ground at the middle of each cell [rows, columns] by points in ``cells`` [N, 2]; NaN: unknown."""
    return _filled(_smoothed(_low_heights(cells, heights, shape)))


def _low_heights(cells: NDArray[np.int64], heights: Array, shape: tuple[int, int]) -> Array:
    """A low height of each cell [rows, columns]; NaN where it has too few points."""
    found = np.full(shape, np.nan)
    index = np.ravel_multi_index((cells[:, 0], cells[:, 1]), shape)
    order = np.lexsort((heights, index))
    occupied, starts, counts = np.unique(index[order], return_index=True, return_counts=True)
    enough = counts >= _LEAST_IN_CELL
    lows = starts + np.floor(_LOW * counts).astype(np.int64)
    found.flat[occupied[enough]] = heights[order[lows[enough]]]
    return found


def _smoothed(heights: Array) -> Array:
    """The median of each known height and the known ones around it: single wrong cells vanish."""
    padded = np.pad(heights, 1, constant_values=np.nan)
    windows = np.lib.stride_tricks.sliding_window_view(padded, (3, 3)).reshape(*heights.shape, 9)
    known = ~np.isnan(heights)
    smooth = heights.copy()
    smooth[known] = np.nanmedian(windows[known], axis=1)
    return smooth


def _filled(heights: Array) -> Array:
    """Unknown heights between known ones, by their inverse square distances."""
    from scipy.spatial import KDTree  # slow to import

    known = np.argwhere(~np.isnan(heights))
    unknown = np.argwhere(np.isnan(heights))
    if not len(known) or not len(unknown):
        return heights
    count = min(_NEIGHBOURS, len(known))
    distances, nearest = KDTree(known).query(unknown, k=count)
    distances, nearest = distances.reshape(-1, count), nearest.reshape(-1, count)
    weights = distances**-2.0
    values = (weights * heights[tuple(known.T)][nearest]).sum(axis=1) / weights.sum(axis=1)
    filled = heights.copy()
    filled[tuple(unknown.T)] = np.where(distances[:, 0] <= _FARTHEST * max(heights.shape), values, np.nan)
    return filled
