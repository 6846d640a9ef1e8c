from dataclasses import replace
from pathlib import Path

from fvs_service.host.worker.starts import Starts
from fvs_service.jobs.states import Turn

from fvs_schema.jobs import JobKind

TURN = Turn("job_1", "scn_1", JobKind.UPDATE, 1, "worker-0")


def test_starts_count_until_the_job_comes_farther(tmp_path: Path) -> None:
    for number in range(3):
        starts = Starts(tmp_path / "scene", TURN)  # by another worker each time
        assert starts.without_progress(0.2) == number
        starts.begin(0.2)
    assert starts.without_progress(0.3) == 1  # the last one came farther, and broke off there
    starts.begin(0.3)
    assert starts.without_progress(0.3) == 2


def test_an_excused_start_does_not_count(tmp_path: Path) -> None:
    starts = Starts(tmp_path, TURN)
    starts.excuse()
    starts.begin(0.0)
    starts.excuse()
    assert starts.without_progress(0.0) == 0


def test_attempts_and_kinds_of_job_count_by_themselves(tmp_path: Path) -> None:
    starts = Starts(tmp_path, TURN)
    starts.begin(0.5)
    assert Starts(tmp_path, replace(TURN, job_id="job_2", kind=JobKind.FINE)).without_progress(0.5) == 0
    assert Starts(tmp_path, replace(TURN, attempt=2)).without_progress(0.5) == 0
    assert starts.without_progress(0.5) == 1


def test_a_damaged_count_begins_anew(tmp_path: Path) -> None:
    starts = Starts(tmp_path, TURN)
    starts.begin(0.0)
    (file,) = tmp_path.iterdir()
    file.write_text("{")
    assert starts.without_progress(0.0) == 0
