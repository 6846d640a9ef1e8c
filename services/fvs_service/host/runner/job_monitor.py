"""The monitor of a job: reports its progress, and pauses it for requests."""

import time
from collections.abc import Callable

from fvs_engine.monitor import Monitor, Progress
from fvs_schema.stages import Stage
from fvs_service.host.protocol.messages import StageProgress, Warned
from fvs_service.host.runner.request_queue import RequestQueue
from fvs_service.jobs.stages import stage_of_job

_REPORT_EVERY_S = 0.5
_FIRST_REQUESTS_S = 1.0
"""Time for the worker to commit a new model, and for clients to be notified and to send requests."""
_POLL_S = 0.1


class JobMonitor(Monitor):
    """Sends the stage twice a second and when it begins, and warnings."""

    def __init__(
        self,
        on_message: Callable[[StageProgress | Warned], None],
        requests: RequestQueue,
    ) -> None:
        super().__init__(self._report, on_warning=lambda finding: on_message(Warned(finding=finding)))
        self._on_message = on_message
        self._requests = requests
        self._reported: tuple[Stage | None, float] = (None, 0.0)

    def check(self) -> None:
        """See ``Monitor``; waits for requests."""
        super().check()
        self._requests.wait_until_empty()

    def wait_for_first_requests(self) -> None:
        """Wait a second for rankings by a model that was just published, and until they are answered.

        Clients that waited for the model send requests now, and get faster answers than beside a training.
        """
        end = time.monotonic() + _FIRST_REQUESTS_S
        while time.monotonic() < end and not self._requests.wait_for_request(_POLL_S):
            self.check()
        self.check()

    def _report(self, progress: Progress) -> None:
        stage, when = self._reported
        if stage == progress.stage and time.monotonic() - when < _REPORT_EVERY_S:
            return
        self._reported = (progress.stage, time.monotonic())
        self._on_message(StageProgress(stage=progress.stage, share=progress.share))


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
