"""Notifications through named pipes in a folder: each listener has one, and reads a byte per notification.

The name of a pipe begins with the letters of its topics, so that nobody is woken for others.
"""

import contextlib
import errno
import os
import select
import threading
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path

from fvs_service.ids import new_id

AVAILABLE = hasattr(os, "mkfifo")
"""Whether the operating system has named pipes in the file system."""

_READ_BYTES = 4096
_AFTER_LETTERS = "-"


def notify(folder: Path, topics: Iterable[str]) -> None:
    """Write to the pipes of the topics' listeners. Removes the pipes of processes that have died.

    Never fails and never waits: a full pipe has enough to wake its reader.
    """
    letters = _letters(topics)
    with contextlib.suppress(OSError):
        for pipe in folder.iterdir():
            wanted = set(pipe.name.partition(_AFTER_LETTERS)[0]).intersection(letters)
            if wanted and not pipe.name.startswith("."):
                _write(pipe, "".join(wanted).encode())


class Listener:
    """A pipe in the folder, and the thread that reads it."""

    def __init__(self, folder: Path, callbacks: Mapping[str, Callable[[], object]]) -> None:
        self._callbacks = {_letters([topic]).encode(): callback for topic, callback in callbacks.items()}
        folder.mkdir(mode=0o700, exist_ok=True)
        name = f"{_letters(callbacks)}{_AFTER_LETTERS}{new_id('listener')}"
        self._path = folder / name
        unread = folder / f".{name}"  # writers remove a pipe that nobody reads
        os.mkfifo(unread, 0o600)
        # Open for writing, too: the pipe would end with its last writer.
        self._pipe = os.open(unread, os.O_RDWR | os.O_NONBLOCK)
        unread.rename(self._path)
        self._closed = threading.Event()
        self._thread = threading.Thread(target=self._read, daemon=True, name="notifications")
        self._thread.start()

    def close(self) -> None:
        """Stop listening, and remove the pipe."""
        self._path.unlink(missing_ok=True)
        self._closed.set()
        with contextlib.suppress(BlockingIOError):  # then it is about to be read anyway
            os.write(self._pipe, b".")
        self._thread.join()
        os.close(self._pipe)

    def _read(self) -> None:
        while True:
            select.select([self._pipe], [], [])
            letters = os.read(self._pipe, _READ_BYTES)
            if self._closed.is_set():
                return
            for letter, callback in self._callbacks.items():
                if letter in letters:
                    callback()


def _letters(topics: Iterable[str]) -> str:
    """The first letter of each topic."""
    return "".join(topic[0] for topic in topics)


def _write(path: Path, letters: bytes) -> None:
    try:
        pipe = os.open(path, os.O_WRONLY | os.O_NONBLOCK)
    except OSError as error:
        if error.errno == errno.ENXIO:  # nobody reads it
            path.unlink(missing_ok=True)
        return
    with contextlib.suppress(OSError):
        os.write(pipe, letters)
    os.close(pipe)
