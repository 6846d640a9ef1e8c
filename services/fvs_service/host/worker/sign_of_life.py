"""The heartbeat file of a worker, for health checks: its age is the time since the last heartbeat.

A probe that only looks for the process takes a frozen one for healthy.
"""

import contextlib
from pathlib import Path


def touch(file: Path) -> None:
    """Set the time of a worker's file; without effect where it cannot be written."""
    with contextlib.suppress(OSError):  # a full disk does not end a worker
        file.parent.mkdir(parents=True, exist_ok=True)
        file.touch()


def forget(folder: Path) -> None:
    """Delete the files of earlier workers, whose number or names may have been different."""
    with contextlib.suppress(FileNotFoundError):
        for file in folder.iterdir():
            file.unlink()
