"""The job engine on DBOS: durable queues in SQLite or PostgreSQL that survive the death of any process.

What DBOS does not do, and how it is done here:

* cancelling a running workflow would free its scene's slot while its step still runs: running jobs are
  cancelled by the flag in their row, and only queued workflows through DBOS;
* no executor takes over the workflows of a dead one: a worker keeps its id in every restart and recovers its
  own, and ``reap`` requeues those of a worker that does not come back;
* workflows run at least once: every stage of a job is a no-op once it is committed.
"""

import functools
import logging
import sqlite3
from collections.abc import Callable
from contextlib import closing

from dbos import DBOS, DBOSClient, DBOSConfig, DBOSPortableJSONSerializer
from sqlalchemy import make_url
from sqlalchemy.exc import SQLAlchemyError

from fvs_service.errors import UnavailableError
from fvs_service.jobs.model import JobKind
from fvs_service.jobs.port import JobTicket

_APPLICATION = "fvs"
_VERSION = "1"
"""The version of the queues' content; workers run only workflows of their own version."""
_RUN_JOB, _START_RUNNER = "run_job", "start_runner"
_RUNNER_QUEUE = "runners"
_QUEUES = {JobKind.UPDATE: "updates", JobKind.FINE: "fine-models"}
_RUNNERS_AT_ONCE = 4
_KEPT_WORKFLOWS = 1_000


class Queue:
    """The client of the queues; safe to use from any thread."""

    def __init__(self, url: str) -> None:
        self._url = url

    @functools.cached_property
    def _client(self) -> DBOSClient:
        prepare(self._url)
        return DBOSClient(
            system_database_url=self._url,
            serializer=DBOSPortableJSONSerializer(),
            application_name=_APPLICATION,
        )

    def submit(self, ticket: JobTicket) -> None:
        """See ``JobEngine``."""
        try:
            self._client.enqueue(
                {
                    "workflow_name": _RUN_JOB,
                    "queue_name": _QUEUES[ticket.kind],
                    "workflow_id": ticket.key,
                    "app_version": _VERSION,
                    "queue_partition_key": ticket.scene_id,
                },
                ticket.job_id,
                ticket.scene_id,
                ticket.kind.value,
                ticket.attempt,
            )
        except SQLAlchemyError as error:
            raise UnavailableError("The queue cannot be reached.", retry_after_s=5) from error

    def request_cancel(self, ticket: JobTicket) -> None:
        """See ``JobEngine``."""
        try:
            queued = self._client.list_workflows(workflow_ids=[ticket.key], status="ENQUEUED")
            if queued:
                self._client.cancel_workflow(ticket.key)
        except SQLAlchemyError as error:
            raise UnavailableError("The queue cannot be reached.", retry_after_s=5) from error

    def start_runner(self, scene_id: str) -> None:
        """Have a worker start the scene's runner; no effect while that is queued already."""
        try:
            self._client.enqueue(
                {
                    "workflow_name": _START_RUNNER,
                    "queue_name": _RUNNER_QUEUE,
                    "app_version": _VERSION,
                    "deduplication_id": scene_id,
                    "duplication_policy": "return-existing",
                },
                scene_id,
            )
        except SQLAlchemyError as error:
            raise UnavailableError("The queue cannot be reached.", retry_after_s=5) from error

    def close(self) -> None:
        """Close the connections."""
        if "_client" in self.__dict__:
            self._client.destroy()

    def resume(self, worker_id: str) -> int:
        """Requeue the workflows that a dead worker had started; returns their number."""
        lost = self._client.list_workflows(executor_id=worker_id, status="PENDING")
        by_queue: dict[str | None, list[str]] = {}
        for workflow in lost:
            by_queue.setdefault(workflow.queue_name, []).append(workflow.workflow_id)
        for queue_name, ids in by_queue.items():
            self._client.resume_workflows(ids, queue_name=queue_name)
        return len(lost)

    def forget_finished(self) -> None:
        """Delete old finished workflows: the rows of jobs have all that is needed of them."""
        ended = self._client.list_workflows(
            status=["SUCCESS", "ERROR", "CANCELLED"],
            sort_desc=True,
            offset=_KEPT_WORKFLOWS,
            limit=_KEPT_WORKFLOWS,
            load_input=False,
            load_output=False,
        )
        if ended:
            self._client.delete_workflows([workflow.workflow_id for workflow in ended])


def prepare(url: str) -> None:
    """Create the queues' tables if they are missing; several processes may do so at once."""
    parsed = make_url(url)
    if parsed.get_backend_name() == "sqlite" and parsed.database:
        with closing(sqlite3.connect(parsed.database, timeout=30)) as connection:
            connection.execute("PRAGMA journal_mode = WAL")
    logging.getLogger("dbos").setLevel(logging.WARNING)
    DBOS.migrate(url)


def take_jobs(
    url: str,
    worker_id: str,
    run_job: Callable[[JobTicket], None],
    start_runner: Callable[[str], None],
    *,
    jobs_at_once: int,
    poll_s: float,
) -> Callable[[], None]:
    """Start to run jobs from the queues in threads, first those that this worker had started before.

    At most ``jobs_at_once`` of a kind run in this worker, and one of a kind per scene in all workers. Returns
    a function that stops it. A process can do this once.
    """
    prepare(url)
    config = DBOSConfig(
        name=_APPLICATION,
        system_database_url=url,
        application_version=_VERSION,
        executor_id=worker_id,
        serializer=DBOSPortableJSONSerializer(),
        log_level="WARNING",
        run_migrations=False,
    )
    DBOS(config=config)

    @DBOS.workflow(name=_RUN_JOB, max_recovery_attempts=None)
    def _run_job(job_id: str, scene_id: str, kind: str, attempt: int) -> None:
        run_job(JobTicket(job_id, scene_id, JobKind(kind), attempt))

    @DBOS.workflow(name=_START_RUNNER, max_recovery_attempts=None)
    def _start_runner(scene_id: str) -> None:
        start_runner(scene_id)

    DBOS.listen_queues([*_QUEUES.values(), _RUNNER_QUEUE])
    DBOS.launch()
    for kind, name in _QUEUES.items():
        DBOS.register_queue(
            name,
            worker_concurrency=jobs_at_once if kind is JobKind.UPDATE else 1,
            partition_concurrency=1,
            polling_interval_sec=poll_s,
            on_conflict="always_update",
        )
    DBOS.register_queue(
        _RUNNER_QUEUE,
        worker_concurrency=_RUNNERS_AT_ONCE,
        polling_interval_sec=poll_s,
        on_conflict="always_update",
    )
    return DBOS.destroy
