"""Structured logs: every line that a process of the service writes to stderr comes from here.

Lines of libraries (uvicorn, SQLAlchemy), warnings and uncaught exceptions have the form of our own.
"""

import logging
import sys
import threading
from types import TracebackType
from typing import Any

import structlog
from structlog.typing import Processor

_SHARED: tuple[Processor, ...] = (
    structlog.contextvars.merge_contextvars,
    structlog.processors.add_log_level,
    structlog.processors.TimeStamper(fmt="iso", utc=True),
)
_OWN_HANDLERS = ("uvicorn", "uvicorn.error", "uvicorn.access", "alembic")
"""Loggers of libraries that bring handlers of their own."""

_log = structlog.get_logger()


def configure_logging(*, machine: bool) -> None:
    """Log to stderr: JSON lines for machines, colours on a terminal.

    Lines of libraries too. Call once, when a program starts, with ``log_uncaught``.
    """
    rendering: tuple[Processor, ...] = (
        (structlog.processors.format_exc_info, structlog.processors.JSONRenderer(default=str))
        if machine
        else (
            structlog.dev.ConsoleRenderer(
                colors=sys.stderr.isatty(), exception_formatter=structlog.dev.plain_traceback
            ),
        )
    )
    structlog.configure(
        processors=[*_SHARED, *rendering],
        wrapper_class=structlog.make_filtering_bound_logger(logging.INFO),
        logger_factory=_to_stderr,
    )
    _take_over(
        structlog.stdlib.ProcessorFormatter(
            foreign_pre_chain=(*_SHARED, structlog.stdlib.add_logger_name),
            processors=[structlog.stdlib.ProcessorFormatter.remove_processors_meta, *rendering],
        )
    )


def reason_of(error: BaseException) -> str:
    """The message of a failure's cause, such as a database driver's error; its own message without one."""
    cause = error.__cause__
    said = str(error if cause is None else getattr(cause, "orig", None) or cause)
    return said.partition("\n\nDebug source:")[0].strip()  # obstore's, of many lines


def log_uncaught() -> None:
    """Log warnings and uncaught exceptions too, instead of their usual text on stderr."""
    logging.captureWarnings(capture=True)
    sys.excepthook = _log_uncaught
    threading.excepthook = _log_uncaught_in_thread


def _take_over(formatter: logging.Formatter) -> None:
    """Give the loggers of libraries one handler, with this format."""
    handler = _StderrHandler()
    handler.setFormatter(formatter)
    root = logging.getLogger()
    root.handlers = [handler]
    root.setLevel(logging.WARNING)
    for name in _OWN_HANDLERS:
        logger = logging.getLogger(name)
        # A logger without a handler would get its library's once that is imported.
        logger.handlers, logger.propagate = [handler], False
        logger.setLevel(logging.WARNING)


class _StderrHandler(logging.Handler):
    """Writes to the stderr of the moment: the one at the start may be closed."""

    def emit(self, record: logging.LogRecord) -> None:
        """Write one line."""
        try:
            print(self.format(record), file=sys.stderr, flush=True)  # noqa: T201 - this is the log
        except Exception:
            self.handleError(record)


def _log_uncaught(kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
    _log.critical("uncaught exception", exc_info=(kind, error, trace))


def _log_uncaught_in_thread(arguments: Any) -> None:
    if arguments.exc_type is not SystemExit:
        trace = (arguments.exc_type, arguments.exc_value, arguments.exc_traceback)
        thread = None if arguments.thread is None else arguments.thread.name
        _log.critical("uncaught exception in a thread", thread=thread, exc_info=trace)


def _to_stderr(*_: object) -> structlog.PrintLogger:
    """A logger to the stderr of the moment: the one at the start may be closed."""
    return structlog.PrintLogger(sys.stderr)
