"""The spans of a job's stages, one after the other."""

import contextlib

from fvs_schema.stages import Stage
from fvs_service.tracing import Tracing


class StageSpans(contextlib.ExitStack):
    """The span of the stage that a job is in; it ends with the stage, or with the job.

    ``expected`` are the exceptions that end a stage without failing it.
    """

    def __init__(self, tracing: Tracing, expected: tuple[type[Exception], ...]) -> None:
        super().__init__()
        self._tracing, self._expected = tracing, expected
        self._stage: Stage | None = None

    def came_to(self, stage: Stage) -> None:
        """Begin a stage, unless the job is in it already."""
        if stage == self._stage:
            return
        self.close()
        self._stage = stage
        self.enter_context(self._tracing.span(f"stage: {stage}", expected=self._expected))
