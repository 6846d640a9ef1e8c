"""The points of a growing reconstruction that only two of its images show."""

import logging
import tempfile
from pathlib import Path

import numpy as np

from fvs_engine.errors import NativeJobError
from fvs_engine.sfm.growing.update import TwoViewPoints
from fvs_engine.sfm.jobs import FindTwoViewPoints
from fvs_engine.sfm.stages import Stages

_log = logging.getLogger(__name__)


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
