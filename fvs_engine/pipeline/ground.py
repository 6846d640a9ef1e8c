"""The ground under the candidates of a ranking or a plan, by a height model or the sparse points."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fvs_engine.errors import InvalidInputError
from fvs_engine.export.placement import Placement
from fvs_engine.geometry.ground import GroundCheck, require_datum
from fvs_engine.geometry.ground_of_points import ground_of_points
from fvs_engine.pipeline.model import FolderModel, read_undistorted
from fvs_engine.pipeline.placement import place
from fvs_engine.views import PinholeView
from fvs_schema.height_model import HeightModel, HeightModelError
from fvs_schema.terrain import Terrain
from fvs_schema.words import POINTS


def ground_check(model: FolderModel, candidates: Sequence[PinholeView], terrain: str | None) -> GroundCheck:
    """Compare candidates with a ``terrain``, if there is one.

    It is the height model in a file of this name, or the ground by the model's sparse points (``POINTS``).
    Raises ``InvalidInputError`` for a model without a place on Earth, for a file that is no height model,
    does not cover the candidates, or has other heights than altitudes of photographs, and for too few points.
    """
    if terrain is None or not candidates:
        return GroundCheck()
    try:
        placement = place(model)
    except InvalidInputError as error:
        raise InvalidInputError(
            error.message,
            hint="Leave the terrain out, reconstruct photographs that have GPS positions, or give control "
            "points with `fvs align`.",
            path=error.path,
        ) from error
    centres = placement.world_from_model.apply(np.stack([view.centre for view in candidates]))
    of_points = terrain == POINTS
    ground = _of_points(model, placement) if of_points else _around(Path(terrain), placement, centres)
    require_datum(ground, placement.origin.altitude_datum)
    positions_m = {view.name: centre for view, centre in zip(candidates, centres, strict=True)}
    return GroundCheck.of(positions_m, placement.position, ground)


def above_ground(candidates: Sequence[PinholeView], ground: GroundCheck) -> tuple[PinholeView, ...]:
    """The candidates that are not under the ground; raises ``InvalidInputError`` where all are."""
    under = frozenset(ground.under)
    kept = tuple(view for view in candidates if view.name not in under)
    if candidates and not kept:
        raise InvalidInputError(
            f"All {len(candidates)} candidates are under the ground.",
            hint="Give others, and check that height model and photographs measure from the same datum.",
        )
    return kept


def _of_points(model: FolderModel, placement: Placement) -> Terrain:
    points = placement.world_from_model.apply(read_undistorted(model.workspace).points.xyz)
    return ground_of_points(placement.geodetic(points), placement.origin.altitude_datum)


def _around(file: Path, placement: Placement, positions_m: NDArray[np.float64]) -> Terrain:
    """The ground around positions [N, 3] of the world frame."""
    places = [(latitude, longitude) for latitude, longitude, _ in placement.geodetic(positions_m).tolist()]
    try:
        with HeightModel(file) as heights:
            return heights.around(places)
    except HeightModelError as error:
        raise InvalidInputError(error.message, hint=error.hint, path=file) from error
