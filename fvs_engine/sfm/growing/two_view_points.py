"""The points of a growing reconstruction that only two of its images show."""

import logging
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fvs_engine.errors import NativeJobError
from fvs_engine.sfm.jobs import FindTwoViewPoints
from fvs_engine.sfm.stages import Stages

_log = logging.getLogger(__name__)


@dataclass(frozen=True, eq=False)
class TwoViewPoints:
    """Points ``xyz`` [P, 3] in the model frame that only two images show; ``seen_in`` [P] names one of them.

    A model of structure from motion leaves them out, since nothing confirms them. As starting points of
    Gaussians they are of use: as many again, in places where images overlap least (docs/design/training.md).
    """

    xyz: NDArray[np.float64]
    seen_in: NDArray[np.str_]


def find_two_view_points(stages: Stages, model_dir: Path) -> TwoViewPoints | None:
    """Triangulate them for the poses of the model; None where the database is missing, or the job crashes.

    Models do without them, so a crash is no reason to fail. Raises ``Cancelled``.
    """
    database = stages.folder.database
    if not database.exists():
        return None
    with tempfile.TemporaryDirectory() as scratch:
        target = Path(scratch) / "points.npz"
        try:
            stages.native(FindTwoViewPoints(database=database, model_dir=model_dir, target=target))
        except NativeJobError as error:
            if not error.crashed:
                raise
            _log.info("No points of two views: %s", error)
            return None
        with np.load(target) as found:
            return TwoViewPoints(found["xyz"], found["seen_in"])
