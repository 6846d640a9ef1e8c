"""Alignment of a snapshot's cameras with the positions of their images."""

from datetime import UTC, datetime, timedelta
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from fvs_service.snapshots.georeferencing import align, ground_of, takeoff_altitude

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


def _flown(flights: list[tuple[float | None, float]]) -> tuple[Any, Any]:
    """Images and cameras, one a minute, by their heights above takeoff and where they are in the model."""
    began = datetime(2026, 11, 27, 12, tzinfo=UTC)
    images = {
        f"{k}": SimpleNamespace(
            prior=Prior(source=PriorSource.METADATA, height_above_takeoff_m=height_m),
            captured_at=began + timedelta(minutes=k),
            received_at=began,
        )
        for k, (height_m, _) in enumerate(flights)
    }
    cameras = {
        f"{k}": RigidTransform(np.eye(3), np.array([0.1 * k, 0.0, up])) for k, (_, up) in enumerate(flights)
    }
    return images, cameras


def test_takeoff_is_below_the_aligned_cameras_of_the_newest_flight() -> None:
    placed = SnapshotAlignment(
        origin=Origin(latitude_deg=46.0, longitude_deg=7.75, altitude_m=198.0),
        status=AlignmentStatus.ALIGNED,
        scale=2.0,
    )
    one = _flown([(40.0, 0.0), (40.5, 0.2), (60.0, 10.0), (None, 0.0)])
    assert takeoff_altitude(*one, placed) == pytest.approx(158.0, abs=0.01)
    other = _flown([(40.0, 0.0), (40.0, 0.0), (40.0, 0.0), (20.0, 0.0), (20.2, 0.0), (20.1, 0.0)])
    assert takeoff_altitude(*other, placed) == pytest.approx(177.9, abs=0.01)
    images, cameras = other
    assert takeoff_altitude({}, cameras, placed) is None
    assert takeoff_altitude(images, cameras, placed.model_copy(update={"origin": None})) is None
    assert takeoff_altitude(*_flown([(None, 0.0)]), placed) is None
