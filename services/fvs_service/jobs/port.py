"""The port to the job engine, which runs jobs; their state is in the table ``jobs`` alone."""

from dataclasses import dataclass
from typing import Protocol

from fvs_service.jobs.model import JobKind


@dataclass(frozen=True)
class JobTicket:
    """An attempt in the queue; everything else is read from the job's row when it starts."""

    job_id: str
    scene_id: str
    kind: JobKind
    attempt: int

    @property
    def key(self) -> str:
        """The id of the attempt: submitted twice, it is queued once."""
        return f"{self.job_id}.{self.attempt}"


class JobEngine(Protocol):
    """A durable queue: at least once, one job per scene at a time, safe against the death of any process."""

    def submit(self, ticket: JobTicket) -> None:
        """Queue an attempt; no effect when ``ticket.key`` is queued, running or done.

        Raises ``UnavailableError`` when the queue cannot be reached; the job is submitted later.
        """
        ...

    def request_cancel(self, ticket: JobTicket) -> None:
        """Remove a queued attempt whose job was canceled from the queue.

        Running jobs poll ``Ledger.cancel_requested`` and occupy their slot until they have stopped.
        """
        ...

    def run_worker(self, worker_id: str) -> None:
        """Run queued attempts until SIGTERM or SIGINT."""
        ...

    def reap(self, worker_id: str) -> int:
        """Requeue the attempts of a dead worker, whose leases have expired; returns their number."""
        ...
