"""Alignment of a snapshot's cameras with the positions of their images."""

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from fvs_service.snapshots.georeferencing import align, ground_of

from fvs_engine.geometry import RigidTransform
from fvs_schema.images import Prior, PriorSource
from fvs_schema.scenes import AlignmentStatus, Origin
from fvs_schema.snapshots import SnapshotAlignment

CENTRES = np.random.default_rng(0).normal(size=(12, 3))


def prior_at(position: np.ndarray) -> Prior:
    x_m, y_m, z_m = (20.0 * position).tolist()
    return Prior(source=PriorSource.REQUEST, x_m=x_m, y_m=y_m, z_m=z_m, position_sigma_m=0.5)


@pytest.mark.parametrize(
    ("order", "ignored", "status"),
    [
        (range(12), False, AlignmentStatus.ALIGNED),
        (range(12), True, AlignmentStatus.MODEL),
        ([5, 6, 7, 8, 9, 10, 11, 0, 1, 2, 3, 4], False, AlignmentStatus.MODEL),
    ],
)
def test_positions_align_the_model_unless_they_contradict_it(
    order: Any, ignored: bool, status: AlignmentStatus
) -> None:
    images = {
        f"{k}": cast(Any, SimpleNamespace(prior=prior_at(CENTRES[place]))) for k, place in enumerate(order)
    }
    cameras = {f"{k}": RigidTransform(np.eye(3), centre) for k, centre in enumerate(CENTRES)}
    found = align(cast(Any, SimpleNamespace(origin=None)), images, cameras, positions_ignored=ignored)
    assert (found.status, found.positions) == (status, 12)
    assert (found.scale == pytest.approx(20.0)) == (status is AlignmentStatus.ALIGNED)


def test_a_model_on_earth_has_a_ground() -> None:
    points = np.random.default_rng(1).uniform(-1.0, 1.0, (500, 3)) * (1.0, 1.0, 0.0)
    origin = Origin(latitude_deg=46.0, longitude_deg=7.75, altitude_m=500.0)
    placed = SnapshotAlignment(
        origin=origin, status=AlignmentStatus.ALIGNED, scale=20.0, translation=(0.0, 0.0, -30.0)
    )
    ground = ground_of(points, placed)
    assert ground is not None
    assert ground.height_m((46.0, 7.75)) == pytest.approx(470.0, abs=0.1)
    assert ground_of(points[:99], placed) is None
    assert ground_of(points, placed.model_copy(update={"origin": None})) is None
    assert ground_of(points, placed.model_copy(update={"status": AlignmentStatus.MODEL})) is None
