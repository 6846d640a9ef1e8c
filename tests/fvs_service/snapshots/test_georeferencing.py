"""Alignment of a snapshot's cameras with the positions of their images."""

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from fvs_service.snapshots.georeferencing import align

from fvs_engine.geometry import RigidTransform
from fvs_schema.images import Prior, PriorSource
from fvs_schema.scenes import AlignmentStatus

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
