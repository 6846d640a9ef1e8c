import sqlite3
from contextlib import closing
from pathlib import Path

from fvs_service.jobs.model import JobKind
from fvs_service.jobs.port import JobTicket
from fvs_service.worker.queue import Queue


def _waiting(file: Path) -> list[tuple[str, str]]:
    query = "SELECT workflow_uuid, queue_name FROM workflow_status WHERE status = 'ENQUEUED' ORDER BY 1"
    with closing(sqlite3.connect(file)) as database:
        return database.execute(query).fetchall()


def test_a_ticket_is_queued_once_and_can_be_taken_out(tmp_path: Path) -> None:
    file = tmp_path / "queue.sqlite3"
    queue = Queue(f"sqlite:///{file}")
    try:
        update = JobTicket("job_1", "scn_1", JobKind.UPDATE, 1)
        fine = JobTicket("job_2", "scn_1", JobKind.FINE, 3)
        for ticket in (update, update, fine):
            queue.submit(ticket)
        assert _waiting(file) == [("job_1.1", "updates"), ("job_2.3", "fine-models")]
        queue.request_cancel(update)
        queue.request_cancel(update)
        assert _waiting(file) == [("job_2.3", "fine-models")]
        assert queue.resume("nobody") == 0
    finally:
        queue.close()


def test_the_start_of_a_runner_is_queued_once_per_scene(tmp_path: Path) -> None:
    file = tmp_path / "queue.sqlite3"
    queue = Queue(f"sqlite:///{file}")
    try:
        for scene in ("scn_1", "scn_1", "scn_2"):
            queue.start_runner(scene)
        assert [name for _, name in _waiting(file)] == ["runners", "runners"]
    finally:
        queue.close()
