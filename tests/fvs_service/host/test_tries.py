from dataclasses import replace
from pathlib import Path

from fvs_service.host.worker.tries import Tries
from fvs_service.jobs.states import Turn

from fvs_schema.jobs import JobKind

TICKET = Turn("job_1", "scn_1", JobKind.UPDATE, 1, "worker-0")


def test_tries_count_until_the_job_comes_farther(tmp_path: Path) -> None:
    for number in range(3):
        tries = Tries(tmp_path / "scene", TICKET)  # by another worker each time
        assert tries.without_progress(0.2) == number
        tries.start(0.2)
    assert tries.without_progress(0.3) == 1  # the last one came farther, and broke off there
    tries.start(0.3)
    assert tries.without_progress(0.3) == 2


def test_an_excused_try_does_not_count(tmp_path: Path) -> None:
    tries = Tries(tmp_path, TICKET)
    tries.excuse()
    tries.start(0.0)
    tries.excuse()
    assert tries.without_progress(0.0) == 0


def test_attempts_and_kinds_of_job_count_by_themselves(tmp_path: Path) -> None:
    tries = Tries(tmp_path, TICKET)
    tries.start(0.5)
    assert Tries(tmp_path, replace(TICKET, job_id="job_2", kind=JobKind.FINE)).without_progress(0.5) == 0
    assert Tries(tmp_path, replace(TICKET, attempt=2)).without_progress(0.5) == 0
    assert tries.without_progress(0.5) == 1


def test_a_damaged_count_begins_anew(tmp_path: Path) -> None:
    tries = Tries(tmp_path, TICKET)
    tries.start(0.0)
    (file,) = tmp_path.iterdir()
    file.write_text("{")
    assert tries.without_progress(0.0) == 0
