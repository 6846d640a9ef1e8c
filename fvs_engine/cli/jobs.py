"""Run one job of the engine from the command line: progress, Ctrl-C, errors, exit status."""

import contextlib
import logging
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Mapping
from types import FrameType, MappingProxyType
from typing import NoReturn, TypeVar

import typer
from fvs_client.cli.command_group import print_error

from fvs_engine.cli.exit_codes import INTERRUPTED, exit_code_of
from fvs_engine.cli.progress import Display, create_display
from fvs_engine.errors import Cancelled, EngineError
from fvs_engine.monitor import Monitor

_SIGNALS = (signal.SIGINT, signal.SIGTERM)

_SHOW_CURSOR = b"\x1b[?25h\n"
"""The bars hide the cursor, and a process that ends at once does not restore it."""

_Result = TypeVar("_Result")
Remedies = Mapping[type[EngineError], str]
"""Kinds of errors → the sentence that names the options of the command that help."""
NO_REMEDIES: Remedies = MappingProxyType({})


def run_job(job: Callable[[Monitor], _Result], *, machine: bool, remedies: Remedies = NO_REMEDIES) -> _Result:
    """Run ``job(monitor)`` with progress and warnings on stderr, and return what it returns.

    The job runs in a thread of its own, so that the main thread can handle signals while native code runs.
    The first SIGINT or SIGTERM requests the job to stop, the second ends the process at once. An
    ``EngineError`` ends the program with its exit status and one clear message (with ``machine``, as JSON),
    and with its sentence of ``remedies``.
    Warnings that the engine logs are shown as well.
    """
    outcome: list[_Result] = []
    failure: list[BaseException] = []
    with create_display(machine=machine) as display:
        monitor = Monitor(display.update, on_warning=display.warn)

        def run() -> None:
            try:
                outcome.append(job(monitor))
            except BaseException as error:  # raised again in the main thread
                failure.append(error)

        thread = threading.Thread(target=run, name="job", daemon=True)
        with _logged_warnings(display), _stop_on_signals(monitor) as watch:
            thread.start()
            while thread.is_alive():
                thread.join(0.1)
                watch(display)
    if not failure:
        return outcome[0]
    error = failure[0]
    if isinstance(error, EngineError):
        fail(error, machine=machine, remedy=remedies.get(type(error), ""))
    raise error


def fail(error: EngineError, *, machine: bool, remedy: str = "") -> NoReturn:
    """Print the error, with one more ``remedy``, and end the program with its exit status.

    It goes to stderr, with ``machine`` as JSON.
    """
    hint = f"{error.hint} {remedy}".strip()
    if machine:
        print_error(error.code, error.message, hint)
    else:
        lines = [str(error)] if isinstance(error, Cancelled) else [f"Error: {error.message}", hint]
        sys.stderr.writelines(f"{line}\n" for line in filter(None, lines))
    raise typer.Exit(exit_code_of(error)) from error


class _Shown(logging.Handler):
    """Forwards logged warnings to ``show``."""

    def __init__(self, show: Callable[[str], None]) -> None:
        super().__init__(logging.WARNING)
        self._show = show

    def emit(self, record: logging.LogRecord) -> None:
        """See ``logging.Handler``."""
        self._show(record.getMessage())


@contextlib.contextmanager
def _logged_warnings(display: Display) -> Iterator[None]:
    engine, handler = logging.getLogger("fvs_engine"), _Shown(display.show)
    engine.addHandler(handler)
    try:
        yield
    finally:
        engine.removeHandler(handler)


@contextlib.contextmanager
def _stop_on_signals(monitor: Monitor) -> Iterator[Callable[[Display], None]]:
    requested = threading.Event()
    announced = threading.Event()

    def on_signal(_number: int, _frame: FrameType | None) -> None:
        if requested.is_set():
            if sys.stderr.isatty():
                os.write(sys.stderr.fileno(), _SHOW_CURSOR)
            os._exit(INTERRUPTED)
        requested.set()
        monitor.cancel()

    def watch(display: Display) -> None:
        for number in _SIGNALS:  # importing pycolmap replaces the handlers by glog's
            signal.signal(number, on_signal)
        if requested.is_set() and not announced.is_set():
            announced.set()
            display.show("Stopping at the next safe point. Press Ctrl-C again to stop at once.")

    before = {number: signal.signal(number, on_signal) for number in _SIGNALS}
    try:
        yield watch
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
