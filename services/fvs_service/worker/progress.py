"""How far a job is as a whole, from how far its stages are."""

import time

from fvs_service.jobs.model import JobKind
from fvs_service.worker.protocol import ProgressNote

_UPDATE = {
    "images": (0.00, 0.02),
    "normalise": (0.02, 0.04),
    "compile": (0.04, 0.05),
    "features": (0.05, 0.12),
    "pairs": (0.12, 0.13),
    "matching": (0.13, 0.25),
    "calibration": (0.25, 0.26),
    "global mapping": (0.26, 0.33),
    "incremental mapping": (0.33, 0.42),
    "registration": (0.33, 0.42),
    "evidence": (0.42, 0.43),
    "load": (0.43, 0.46),
    "train": (0.46, 0.97),
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
"""Which part of a job a stage is: from where to where. What is not listed moves nothing."""

_ENOUGH = 0.05
"""Of the job must be done before the rest is guessed from it."""


class JobProgress:
    """Follows the notes of one attempt."""

    def __init__(self, kind: JobKind) -> None:
        self._parts = _UPDATE if kind is JobKind.UPDATE else _FINE
        self._began = time.monotonic()
        self.reached = 0.0
        """In [0, 1]; it never falls."""

    def follow(self, note: ProgressNote) -> float | None:
        """Take a note in; returns how many seconds the whole job will still take, if that can be said."""
        start, end = self._parts.get(note.stage, (0.0, 0.0))
        share = 0.0 if note.share is None else min(1.0, max(0.0, note.share))
        self.reached = max(self.reached, start + share * (end - start))
        if note.eta_s is not None:
            return note.eta_s
        if self.reached < _ENOUGH:
            return None
        return (time.monotonic() - self._began) * (1.0 - self.reached) / self.reached
