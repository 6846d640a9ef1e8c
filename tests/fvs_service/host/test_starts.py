from typing import Any

import pytest
from fvs_service.errors import StorageUnavailableError
from fvs_service.host.worker.starts import Starts
from fvs_service.jobs.states import Turn
from fvs_service.storage.database import Database


@pytest.fixture
def turn(gateway: Any) -> Turn:
    return gateway.take(gateway.queue(gateway.scene()))


@pytest.fixture
def database(gateway: Any) -> Database:
    return gateway.application.storage.database


def test_starts_count_until_the_job_comes_farther(database: Database, turn: Turn) -> None:
    for number in range(3):
        starts = Starts(database, turn)  # by another process each time, perhaps on another machine
        assert starts.without_progress(0.2) == number
        starts.begin(0.2)
    assert starts.without_progress(0.3) == 1  # the last one came farther, and broke off there
    starts.begin(0.3)
    assert starts.without_progress(0.3) == 2


def test_an_excused_start_does_not_count(database: Database, turn: Turn) -> None:
    starts = Starts(database, turn)
    starts.excuse()
    starts.begin(0.0)
    starts.begin(0.0)
    Starts(database, turn).excuse()
    assert Starts(database, turn).without_progress(0.0) == 1


def test_a_start_that_is_excused_without_the_database_does_not_count(
    database: Database, turn: Turn, monkeypatch: pytest.MonkeyPatch
) -> None:
    def away(*_: object) -> None:
        raise StorageUnavailableError("The database cannot be reached.")

    starts = Starts(database, turn)
    starts.begin(0.0)
    with monkeypatch.context() as without:
        without.setattr(Database, "writing", away)
        starts.excuse()
    starts.begin(0.0)
    assert Starts(database, turn).without_progress(0.0) == 1


def test_the_next_attempt_counts_by_itself(gateway: Any, database: Database, turn: Turn) -> None:
    starts = Starts(database, turn)
    starts.begin(0.5)
    starts.because("It broke.", disk_full=True)
    gateway.client.post(f"/v1/jobs/{turn.job_id}:cancel")
    gateway.application.storage.queue.put_back(turn)
    gateway.client.post(f"/v1/jobs/{turn.job_id}:cancel")
    assert gateway.client.post(f"/v1/jobs/{turn.job_id}:retry").is_success
    second = Starts(database, gateway.take(turn.job_id))
    assert second.without_progress(0.5) == 0
    assert (second.reason, second.disk_full) == ("its process died", False)
    assert starts.reason == "It broke."
