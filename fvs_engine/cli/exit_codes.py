"""The exit statuses of ``fvs``."""

from fvs_engine.errors import EngineError

OK = 0
BUG = 1
USAGE = 2
INTERRUPTED = 130

EXIT_CODES = {
    "engine-error": 3,
    "invalid-input": 4,
    "no-images": 5,
    "reconstruction-failed": 6,
    "training-failed": 7,
    "storage": 8,
    "disk-full": 9,
    "output-exists": 10,
    "backend-unavailable": 11,
    "process-died": 12,
    "no-process": 14,  # 13 is that of fvs doctor
    "device-memory": 15,
    "cancelled": INTERRUPTED,
}
"""``EngineError.code`` → exit status. Statuses are never reassigned; new codes get new ones."""


def exit_code_of(error: EngineError) -> int:
    """The status of the error's code, or of its nearest ancestor that has one."""
    for ancestor in type(error).__mro__:
        code = EXIT_CODES.get(getattr(ancestor, "code", ""))
        if code is not None:
            return code
    return BUG
