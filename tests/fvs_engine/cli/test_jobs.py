import json
import logging
import os
import signal
import subprocess
import sys
import threading
import time

import pytest
import typer

from fvs_engine.cli.exit_codes import EXIT_CODES, INTERRUPTED
from fvs_engine.cli.jobs import run_job
from fvs_engine.errors import ContradictedModelsError, EngineError, ReconstructionError
from fvs_engine.monitor import Monitor
from fvs_schema.findings import Finding, FindingCode


def test_the_result_comes_back_and_warnings_go_to_stderr(capsys: pytest.CaptureFixture[str]) -> None:
    def job(monitor: Monitor) -> int:
        monitor.warn(
            Finding.of(FindingCode.UNUSABLE_PHOTOGRAPH, ["a.jpg"], why="it is empty.", remedy="Export it.")
        )
        monitor.report("images", 1, 1)
        return 7

    assert run_job(job, machine=False) == 7
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err == "Left out a.jpg: it is empty. Export it.\nChecking photographs: 1/1\n"


@pytest.mark.parametrize("machine", [False, True])
def test_an_engine_error_is_one_message_and_a_status(
    machine: bool, capsys: pytest.CaptureFixture[str]
) -> None:
    def job(_monitor: Monitor) -> None:
        raise ReconstructionError("No two photographs overlap.", hint="Take more.")

    with pytest.raises(typer.Exit) as caught:
        run_job(job, machine=machine)
    assert caught.value.exit_code == EXIT_CODES["reconstruction-failed"]
    captured = capsys.readouterr()
    assert captured.out == ""
    if machine:
        expected = {
            "code": "reconstruction-failed",
            "message": "No two photographs overlap.",
            "hint": "Take more.",
        }
        assert json.loads(captured.err) == {"error": expected}
    else:
        assert captured.err.splitlines() == ["Error: No two photographs overlap.", "Take more."]


def test_the_options_that_help_are_named_with_their_kind_of_error_alone(
    capsys: pytest.CaptureFixture[str],
) -> None:
    for kind, expected in (
        (ContradictedModelsError, "Step back. Try --colmap."),
        (ReconstructionError, "Step back."),
    ):

        def job(_monitor: Monitor, kind: type[EngineError] = kind) -> None:
            raise kind("No model.", hint="Step back.")

        with pytest.raises(typer.Exit):
            run_job(job, machine=False, remedies={ContradictedModelsError: "Try --colmap."})
        assert capsys.readouterr().err.splitlines() == ["Error: No model.", expected]


def test_what_the_engine_logs_is_json_for_machines_too(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(logging.getLogger(), "handlers", [])  # commands of the service leave one

    def job(_monitor: Monitor) -> None:
        logging.getLogger("fvs_engine.compilation.ahead").warning("Compiling failed (%s).", "no disk")

    run_job(job, machine=True)
    assert json.loads(capsys.readouterr().err) == {"message": "Compiling failed (no disk)."}


def test_a_bug_is_not_dressed_up() -> None:
    def job(_monitor: Monitor) -> None:
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        run_job(job, machine=False)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_stops_the_job_at_its_next_safe_point(
    number: signal.Signals, capsys: pytest.CaptureFixture[str]
) -> None:
    cleaned_up = threading.Event()

    def job(monitor: Monitor) -> None:
        os.kill(os.getpid(), number)
        try:
            while True:
                monitor.check()
                time.sleep(0.01)
        except EngineError:
            cleaned_up.set()
            raise

    handler = signal.getsignal(number)
    with pytest.raises(typer.Exit) as caught:
        run_job(job, machine=False)
    assert caught.value.exit_code == INTERRUPTED
    assert cleaned_up.is_set()
    assert "Run the same command again to resume." in capsys.readouterr().err
    assert signal.getsignal(number) == handler


@pytest.mark.process
def test_a_second_signal_stops_at_once_even_a_job_that_does_not_listen() -> None:
    script = (
        "import os, signal, time\n"
        "from fvs_engine.cli.jobs import run_job\n"
        "def job(monitor):\n"
        "    os.kill(os.getpid(), signal.SIGINT)\n"
        "    while not monitor.cancelled: time.sleep(0.01)\n"
        "    time.sleep(0.5)\n"
        "    os.kill(os.getpid(), signal.SIGINT)\n"
        "    time.sleep(60)\n"
        "run_job(job, machine=False)\n"
    )
    began = time.monotonic()
    run = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=False, timeout=50
    )
    assert run.returncode == INTERRUPTED
    assert time.monotonic() - began < 30
    assert "Ctrl-C again" in run.stderr
