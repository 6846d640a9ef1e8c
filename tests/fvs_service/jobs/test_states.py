"""The table of a job's states: every move from every status by everyone, in the database."""

import ast
from pathlib import Path
from typing import Any

import fvs_service
from fvs_service.events.repository import events_after
from fvs_service.jobs.states import Move, Mover, Status, move
from fvs_service.storage.tables import JobRow
from sqlalchemy import update
from sqlalchemy.orm import Session

from fvs_schema.jobs import JobState

_STATUSES = [
    *(Status(state, in_turn) for state in JobState for in_turn in (False, True) if not state.ended),
    *(Status(state, False) for state in JobState if state.ended),
]
_TABLE = {
    (Move.TAKE, Mover.WORKER): "queued→queued in turn, running→running in turn",
    (Move.PUT_BACK, Mover.WORKER): "queued in turn→queued, running in turn→running",
    (Move.PUT_BACK, Mover.SUPERVISOR): "queued in turn→queued, running in turn→running",
    (Move.START, Mover.WORKER): "queued→running in turn, queued in turn→running in turn",
    (Move.START_AGAIN, Mover.WORKER): "running→running, running in turn→running in turn",
    (Move.SUCCEED, Mover.WORKER): "running→succeeded, running in turn→succeeded",
    (Move.FAIL, Mover.WORKER): "running→failed, running in turn→failed",
    (Move.CANCEL, Mover.WORKER): "running→canceled, running in turn→canceled",
    (Move.CANCEL, Mover.CLIENT): "queued→canceled, queued in turn→canceled, running→canceled",
    (Move.RETRY, Mover.CLIENT): "failed→queued, canceled→queued",
}
_EVENTS = {
    Move.START: "job.started",
    Move.SUCCEED: "job.succeeded",
    Move.FAIL: "job.failed",
    Move.CANCEL: "job.canceled",
    Move.RETRY: "job.queued",
}


def _word(status: Status) -> str:
    return f"{status.state.value} in turn" if status.in_turn else status.state.value


def _put(session: Session, job_id: str, status: Status) -> None:
    """Have the job in this status, however it got there."""
    worker_id = "worker" if status.in_turn else None
    session.execute(
        update(JobRow).where(JobRow.id == job_id).values(state=status.state.value, worker_id=worker_id)
    )


def _moved(session: Session, job_id: str, how: Move, by: Mover) -> str | None:
    taken = {"worker_id": "worker"} if how in (Move.TAKE, Move.START) else {}
    rows = move(session, how, by, JobRow.id == job_id, **taken)
    return None if not rows else _word(Status(JobState(rows[0].state), rows[0].worker_id is not None))


def test_jobs_move_as_the_table_says_and_no_other_way(gateway: Any) -> None:
    scene = gateway.scene()
    job_id = gateway.queue(scene)
    for how in Move:
        for by in Mover:
            moves = []
            for status in _STATUSES:
                with gateway.application.storage.database.writing() as session:
                    _put(session, job_id, status)
                    before = session.get(JobRow, job_id, populate_existing=True).attempt
                    found = _moved(session, job_id, how, by) if by in how.value.sources else None
                    after = session.get(JobRow, job_id, populate_existing=True)
                    assert after.attempt == before  # `retry` is what counts them
                    assert (after.finished_at is not None) == JobState(after.state).ended or found is None
                    if found is None:
                        assert (after.state, after.worker_id is not None) == (
                            status.state.value,
                            status.in_turn,
                        )
                    else:
                        moves.append(f"{_word(status)}→{found}")
                    session.execute(update(JobRow).values(finished_at=None))
            assert sorted(moves) == sorted(filter(None, _TABLE.get((how, by), "").split(", "))), (how, by)


def test_a_move_is_reported_by_its_event(gateway: Any) -> None:
    for how, kind in _EVENTS.items():
        scene = gateway.scene()
        job_id = gateway.queue(scene)
        by, sources = next(iter(how.value.sources.items()))
        with gateway.application.storage.database.writing() as session:
            _put(session, job_id, sorted(sources)[0])
            _moved(session, job_id, how, by)
        with gateway.application.storage.database.reading() as session:
            *_, event = events_after(session, scene, 0)
        assert (event.kind.value, event.data["job_id"]) == (kind, job_id)


def test_nothing_else_changes_the_state_of_a_job() -> None:
    """Of the modules that write jobs' rows, one names the columns of the state and of the turn."""
    root = Path(fvs_service.__file__).parent
    writers = {}
    for file in root.rglob("*.py"):
        source = file.read_text(encoding="utf-8")
        if "update(JobRow)" in source or "JobRow(" in source:
            writers[file.relative_to(root).as_posix()] = _keywords(ast.parse(source))
    assert "jobs/states.py" in writers
    for name, keywords in writers.items():
        if name not in ("jobs/states.py", "storage/tables.py"):
            assert not keywords & {"state", "attempt", "finished_at"}, name


def _keywords(tree: ast.AST) -> set[str]:
    """The names of the arguments of calls of ``values`` and ``change_running``."""
    return {
        keyword.arg
        for call in ast.walk(tree)
        if isinstance(call, ast.Call)
        and getattr(call.func, "attr", getattr(call.func, "id", "")) in ("values", "change_running", "JobRow")
        for keyword in call.keywords
        if keyword.arg
    }
