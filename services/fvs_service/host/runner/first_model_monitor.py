"""The progress of a new scene's first model, as one stage of its job."""

from fvs_engine.monitor import Monitor, Progress
from fvs_service.jobs.first_model import FIRST_MODEL, PARTS


class FirstModelMonitor(Monitor):
    """Reports all stages of the first model as one; the job repeats them later on all images."""

    def __init__(self, monitor: Monitor) -> None:
        super().__init__()
        self._monitor = monitor
        self._reached = 0.0

    def receive(self, progress: Progress) -> None:
        """See ``Monitor``."""
        start, end = PARTS.get(progress.stage, (0.0, 0.0))
        share = min(1.0, max(0.0, progress.share or 0.0))
        self._reached = max(self._reached, start + share * (end - start))
        self._monitor.report(FIRST_MODEL, 0, 1, worked=self._reached)

    def check(self) -> None:
        """See ``Monitor``."""
        self._monitor.check()
