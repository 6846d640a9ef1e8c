"""The progress of a job from the progress of its stages."""

from fvs_service.host.protocol.messages import StageProgress
from fvs_service.jobs.first_model import FIRST_MODEL
from fvs_service.jobs.model import JobKind

_UPDATE = {
    "images": (0.00, 0.02),
    "normalise": (0.02, 0.04),
    "compile": (0.04, 0.05),
    FIRST_MODEL: (0.05, 0.10),
    "features": (0.10, 0.14),
    "pairs": (0.14, 0.15),
    "matching": (0.15, 0.25),
    "calibration": (0.25, 0.26),
    "global mapping": (0.26, 0.33),
    "incremental mapping": (0.33, 0.42),
    "registration": (0.33, 0.42),
    "evidence": (0.42, 0.43),
    "load": (0.43, 0.46),
    "quick training": (0.46, 0.55),
    "quick snapshot": (0.55, 0.56),
    "train": (0.56, 0.97),
    "snapshot": (0.97, 1.00),
}
_FINE = {
    "images": (0.00, 0.01),
    "normalise": (0.01, 0.02),
    "load": (0.02, 0.04),
    "train": (0.04, 0.97),
    "evaluate": (0.97, 0.98),
    "snapshot": (0.98, 1.00),
}
PARTS = {JobKind.UPDATE: _UPDATE, JobKind.FINE: _FINE}
"""Start and end of each stage as shares of the job; stages that are not listed do not count."""


class JobProgress:
    """The progress of one attempt."""

    def __init__(self, kind: JobKind) -> None:
        self._parts = PARTS[kind]
        self.reached = 0.0
        """In [0, 1]; it never falls."""

    def add(self, stage: StageProgress) -> None:
        """Add the progress of a stage."""
        start, end = self._parts.get(stage.stage, (0.0, 0.0))
        share = 0.0 if stage.share is None else min(1.0, max(0.0, stage.share))
        self.reached = max(self.reached, start + share * (end - start))
