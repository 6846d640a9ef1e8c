"""Running one job of the engine under a terminal: progress, Ctrl-C, errors, exit status."""

import contextlib
import json
import logging
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from types import FrameType
from typing import NoReturn, TypeVar

import typer

from fvs_engine.cli.exit_codes import INTERRUPTED, exit_code_of
from fvs_engine.cli.progress import Display, create_display
from fvs_engine.errors import Cancelled, EngineError
from fvs_engine.monitor import Monitor

_SIGNALS = (signal.SIGINT, signal.SIGTERM)

_SHOW_CURSOR = b"\x1b[?25h\n"
"""The bars hide it, and a process that ends at once has no time to tidy up."""

_Result = TypeVar("_Result")
Say = Callable[[str], None]
"""Shows a sentence to the user."""


def run_job(job: Callable[[Monitor, Say], _Result], *, machine: bool) -> _Result:
    """Run ``job(monitor, say)`` with progress on stderr, and return what it returns.

    The job gets a thread of its own, so that the main thread is free to hear signals while native code
    runs. The first SIGINT or SIGTERM asks the job to stop, the second ends the process at once. An
    ``EngineError`` ends the program with its exit status and one clear message (with ``machine``, also as
    JSON on stdout). What the engine logs as a warning is said like everything else.
    """
    outcome: list[_Result] = []
    failure: list[BaseException] = []
    with create_display(machine=machine) as display:
        monitor = Monitor(display.update)

        def run() -> None:
            try:
                outcome.append(job(monitor, display.say))
            except BaseException as error:  # it is raised again in the main thread
                failure.append(error)

        thread = threading.Thread(target=run, name="job", daemon=True)
        with _said_by_log(display), _stop_on_signals(monitor) as attend:
            thread.start()
            while thread.is_alive():
                thread.join(0.1)
                attend(display)
    if not failure:
        return outcome[0]
    error = failure[0]
    if isinstance(error, EngineError):
        fail(error, machine=machine)
    raise error


def fail(error: EngineError, *, machine: bool) -> NoReturn:
    """Say what went wrong and end the program with the error's exit status.

    With ``machine`` it is said in JSON, on stderr as a message like all others there, and on stdout.
    """
    if machine:
        document = {"code": error.code, "message": error.message, "hint": error.hint}
        sys.stdout.write(json.dumps({"error": document}) + "\n")
    lines = [str(error)] if isinstance(error, Cancelled) else [f"Error: {error.message}", error.hint]
    for line in filter(None, lines):
        sys.stderr.write((json.dumps({"message": line}) if machine else line) + "\n")
    raise typer.Exit(exit_code_of(error)) from error


class _Saying(logging.Handler):
    """Passes what is logged on to ``say``."""

    def __init__(self, say: Say) -> None:
        super().__init__(logging.WARNING)
        self._say = say

    def emit(self, record: logging.LogRecord) -> None:
        """See ``logging.Handler``."""
        self._say(record.getMessage())


@contextlib.contextmanager
def _said_by_log(display: Display) -> Iterator[None]:
    engine, handler = logging.getLogger("fvs_engine"), _Saying(display.say)
    engine.addHandler(handler)
    try:
        yield
    finally:
        engine.removeHandler(handler)


@contextlib.contextmanager
def _stop_on_signals(monitor: Monitor) -> Iterator[Callable[[Display], None]]:
    asked = threading.Event()
    announced = threading.Event()

    def on_signal(_number: int, _frame: FrameType | None) -> None:
        if asked.is_set():
            if sys.stderr.isatty():
                os.write(sys.stderr.fileno(), _SHOW_CURSOR)
            os._exit(INTERRUPTED)
        asked.set()
        monitor.cancel()

    def attend(display: Display) -> None:
        for number in _SIGNALS:  # importing pycolmap puts glog's own handler in the place of ours
            signal.signal(number, on_signal)
        if asked.is_set() and not announced.is_set():
            announced.set()
            display.say("Stopping at the next safe point. Press Ctrl-C again to stop at once.")

    before = {number: signal.signal(number, on_signal) for number in _SIGNALS}
    try:
        yield attend
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
