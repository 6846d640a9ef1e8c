"""What the service needs of a job engine: the rows in ``jobs`` say what is true, the engine runs them."""

from dataclasses import dataclass
from typing import Protocol

from fvs_service.jobs.model import JobKind


@dataclass(frozen=True)
class JobTicket:
    """What is put into the queue: everything else is read from the job's row when it starts."""

    job_id: str
    scene_id: str
    kind: JobKind
    attempt: int

    @property
    def key(self) -> str:
        """The name of this attempt: submitting it twice queues it once."""
        return f"{self.job_id}.{self.attempt}"


class JobEngine(Protocol):
    """A durable queue: one job per scene at a time, at least once, surviving the death of any process."""

    def submit(self, ticket: JobTicket) -> None:
        """Queue an attempt; without effect when ``ticket.key`` is queued, running or done already.

        Raises ``UnavailableError`` when the queue cannot be reached; the row stays and is submitted later.
        """
        ...

    def request_cancel(self, ticket: JobTicket) -> None:
        """Take an attempt that has not begun, and whose job is ended already, out of the queue.

        A running job learns of it from ``Ledger.cancel_requested``; the slot stays taken until it has
        stopped.
        """
        ...

    def run_worker(self, worker_id: str) -> None:
        """Run queued attempts, one process's share of them, until the process is asked to stop."""
        ...

    def reap(self, worker_id: str) -> int:
        """Queue again what a dead worker left behind; returns how many. Only after its leases ran out."""
        ...
