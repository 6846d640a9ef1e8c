"""The ticket of a job's attempt."""

from dataclasses import dataclass

from fvs_service.jobs.model import JobKind


@dataclass(frozen=True)
class JobTicket:
    """An attempt that a worker has taken; everything else is read from the job's row when it starts."""

    job_id: str
    scene_id: str
    kind: JobKind
    attempt: int
    traceparent: str | None = None
    """The span of the request that queued it."""

    @property
    def key(self) -> str:
        """The id of the attempt."""
        return f"{self.job_id}.{self.attempt}"
