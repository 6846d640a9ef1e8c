"""Every line of a process of the service has one form."""

import io
import json
import subprocess
import sys
from typing import Any

import pytest
import structlog
import typer
from fvs_service.cli.failures import failures_as_messages
from fvs_service.errors import StorageUnavailableError

_PROGRAM = """
import logging, sys, threading, warnings
from fvs_service.logs import configure_logging, log_uncaught
configure_logging(machine=sys.argv[1] == "json")
log_uncaught()
import structlog
import typer
from fvs_service.cli.failures import failures_as_messages
from fvs_service.errors import StorageUnavailableError
structlog.get_logger().info("ours", number=1)
import uvicorn.config
uvicorn.Config(None, log_config=None)
logging.getLogger("uvicorn.error").error("Cancel %d running task(s)", 3)
logging.getLogger("alembic").warning("of the queue")
logging.getLogger("alembic").info("not of interest")
logging.getLogger("asyncio").error("of the loop")
warnings.warn("a warning")
try:
    raise ValueError("caught")
except ValueError:
    logging.getLogger("other").exception("with a traceback")
thread = threading.Thread(target=lambda: 1 / 0, name="a thread")
thread.start()
thread.join()
raise RuntimeError("uncaught")
"""


def test_a_line_that_is_written_between_two_tests_is_not_shown(
    capfd: pytest.CaptureFixture[str], pytestconfig: pytest.Config
) -> None:
    if pytestconfig.getoption("capture") == "no":
        pytest.skip("everything is shown")
    seen = io.StringIO()
    with pytest.MonkeyPatch.context() as patch:  # as pytest has it where it does not capture
        patch.setattr(sys, "stderr", seen)
        patch.setattr(sys, "__stderr__", seen)
        structlog.get_logger().info("late")
    structlog.get_logger().info("in time")
    assert seen.getvalue() == ""
    assert "in time" in capfd.readouterr().err


def _lines(form: str) -> list[str]:
    done = subprocess.run(
        [sys.executable, "-c", _PROGRAM, form], capture_output=True, text=True, timeout=120, check=False
    )
    assert done.returncode == 1
    return done.stderr.splitlines()


@pytest.mark.process
def test_every_line_is_json() -> None:
    lines = [json.loads(line) for line in _lines("json")]
    said = [line["event"] for line in lines]
    for expected in ("ours", "Cancel 3 running task(s)", "of the queue", "of the loop", "with a traceback"):
        assert said.count(expected) == 1, said
    assert any("a warning" in sentence for sentence in said)
    assert not any("not of interest" in sentence for sentence in said)
    assert sum("ZeroDivisionError" in line.get("exception", "") for line in lines) == 1
    assert "RuntimeError: uncaught" in lines[-1]["exception"]
    assert {line["level"] for line in lines} <= {"info", "warning", "error", "critical"}
    assert all(line["timestamp"].endswith("Z") for line in lines)


@pytest.mark.process
def test_people_read_the_same_lines() -> None:
    text = "\n".join(_lines("text"))
    assert "Cancel 3 running task(s)" in text
    assert "RuntimeError: uncaught" in text


def test_the_end_of_a_job_is_logged(gateway: Any, capfd: pytest.CaptureFixture[str]) -> None:
    scene = gateway.scene()
    gateway.model(scene)
    ended = [json.loads(line) for line in capfd.readouterr().err.splitlines() if '"job ended"' in line]
    assert [(line["state"], line["kind"], line["scene"]) for line in ended] == [
        ("succeeded", "update", scene)
    ]
    assert ended[0]["seconds"] >= 0


def test_the_end_of_a_job_that_is_canceled_while_it_waits_is_logged(
    gateway: Any, capfd: pytest.CaptureFixture[str]
) -> None:
    job = gateway.queue(gateway.scene())
    gateway.client.post(f"/v1/jobs/{job}:cancel")
    ended = [json.loads(line) for line in capfd.readouterr().err.splitlines() if '"job ended"' in line]
    assert [(line["job"], line["state"], line["seconds"]) for line in ended] == [(job, "canceled", None)]


def _logged(capsys: pytest.CaptureFixture[str], event: str) -> list[dict[str, Any]]:
    lines = [json.loads(line) for line in capsys.readouterr().err.splitlines() if line.startswith("{")]
    return [line for line in lines if line["event"] == event]


def test_a_queued_job_is_logged_with_its_request(gateway: Any, capsys: pytest.CaptureFixture[str]) -> None:
    scene = gateway.scene()
    asked = gateway.client.post(f"/v1/scenes/{scene}/jobs", json={"kind": "update"})
    job, request_id = asked.json()["id"], asked.headers["x-request-id"]
    gateway.client.post(f"/v1/jobs/{job}:cancel")
    gateway.client.post(f"/v1/jobs/{job}:retry")
    first, again = _logged(capsys, "job queued")
    assert first.items() >= {"job": job, "scene": scene, "request_id": request_id, "attempt": 1}.items()
    assert (again["job"], again["attempt"]) == (job, 2)


def test_requests_are_logged_with_numbers_and_what_they_are_about(
    gateway: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    scene = gateway.scene()
    gateway.client.get(f"/v1/scenes/{scene}")
    created, read = _logged(capsys, "request")
    assert (created["status"], read["status"], read["scene"]) == (201, 200, scene)
    assert "reason" not in read


def test_the_reason_of_a_failure_is_logged(
    gateway: Any, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object) -> None:
        raise StorageUnavailableError("The database cannot be reached.") from OSError("connection refused")

    monkeypatch.setattr(gateway.application.scenes, "get", fail)
    assert gateway.client.get("/v1/scenes/scn_a").status_code == 503
    (line,) = _logged(capsys, "request")
    assert line["reason"] == "connection refused"
    assert (line["code"], line["error"]) == ("unavailable", "The database cannot be reached.")


def test_a_defect_is_logged_with_its_request(
    gateway: Any, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(gateway.application.scenes, "get", lambda *_: 1 / 0)
    failed = gateway.client.get("/v1/scenes/scn_a").json()
    (line,) = _logged(capsys, "request failed")
    assert line["request_id"] == failed["request_id"]
    assert "ZeroDivisionError" in line["exception"]


def test_json_logs_of_commands_have_the_reason(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(typer.Exit), failures_as_messages(log_json=True):
        raise StorageUnavailableError("The database is away.", hint="Wait.") from OSError("refused")
    (line,) = _logged(capsys, "The database is away.")
    assert (line["reason"], line["hint"]) == ("refused", "Wait.")
