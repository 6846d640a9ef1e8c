"""The progress of a new scene's first model, as one stage of its job."""

from fvs_engine.monitor import Monitor, Progress
from fvs_schema.stages import Stage
from fvs_service.jobs.stages import stage_of_job


class FirstModelMonitor(Monitor):
    """Reports all stages of the first model as one; the job repeats them later on all images."""

    def __init__(self, monitor: Monitor) -> None:
        super().__init__()
        self._monitor = monitor
        self._reached = 0.0

    def receive(self, progress: Progress) -> None:
        """See ``Monitor``."""
        start, end = stage_of_job(progress.stage).first_model
        share = min(1.0, max(0.0, progress.share or 0.0))
        self._reached = max(self._reached, start + share * (end - start))
        self._monitor.report(Stage.FIRST_MODEL, 0, 1, worked=self._reached)

    def check(self) -> None:
        """See ``Monitor``."""
        self._monitor.check()
