"""What operations ask of the world.

An operation is a generator: it yields effects, is sent their results (or thrown their errors), and returns
what it was for. It does no input or output of its own, so the same operation runs under ``Client`` and under
``AsyncClient``; only the two drivers (``blocking.py``, ``awaiting.py``) differ.
"""

import time
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Generic, TypeVar

T = TypeVar("T")

Operation = Generator[Any, Any, T]
"""Yields effects, returns a ``T``."""

_CHUNK_BYTES = 1 << 18


class FileBody:
    """A file's content as a request's body, read when it is sent; ``on_bytes`` is told what has gone.

    Raises ``OSError`` while it is sent when the file has not ``size_bytes`` any more.
    It can be sent again: ``on_bytes`` is then first told a negative number, as many bytes as had gone before.
    """

    def __init__(self, path: Path, size_bytes: int, on_bytes: Callable[[int], None]) -> None:
        self.size_bytes = size_bytes
        self._path = path
        self._on_bytes = on_bytes
        self._sent = 0

    def chunks(self) -> Iterator[bytes]:
        """The content, from its beginning."""
        if self._sent:
            self._on_bytes(-self._sent)
            self._sent = 0
        with self._path.open("rb") as file:
            while chunk := file.read(_CHUNK_BYTES):
                if self._sent + len(chunk) > self.size_bytes:
                    break
                yield chunk
                self._sent += len(chunk)
                self._on_bytes(len(chunk))
        if chunk or self._sent != self.size_bytes:
            raise OSError(f"{self._path} changed while it was sent.")


@dataclass(frozen=True)
class Request:
    """One request; ``repeatable`` when sending it twice does what sending it once does."""

    method: str
    path: str
    params: Mapping[str, Any] = field(default_factory=dict)
    headers: Mapping[str, str] = field(default_factory=dict)
    document: Mapping[str, Any] | None = None
    """Sent as JSON."""
    body: bytes | FileBody | None = None
    repeatable: bool = True
    read_timeout_s: float | None = None
    """Instead of the client's own."""


@dataclass(frozen=True)
class Reply:
    """What came back; header names are in lower case."""

    status: int
    headers: Mapping[str, str]
    content: bytes = b""


@dataclass(frozen=True)
class Send:
    """Send a request once → ``Reply``, or ``ConnectionFailedError``."""

    request: Request


@dataclass(frozen=True)
class Open:
    """Send a request and read only the head of what comes back → ``OpenReply``."""

    request: Request


@dataclass(frozen=True)
class OpenReply:
    """A reply whose content is still to come, by ``Read(stream)``."""

    status: int
    headers: Mapping[str, str]
    stream: Any


@dataclass(frozen=True)
class Read:
    """The next bytes of a stream, None at its end; an operation that ends closes its streams."""

    stream: Any


@dataclass(frozen=True)
class Close:
    """Read no more of a stream."""

    stream: Any


@dataclass(frozen=True)
class Sleep:
    """Let time pass."""

    seconds: float


@dataclass(frozen=True)
class Call(Generic[T]):
    """Run a function that may take a while or read a disk → what it returns."""

    function: Callable[[], T]


@dataclass(frozen=True)
class Together(Generic[T]):
    """Run operations at the same time, ``at_once`` of them → their results in order.

    The first error ends all of them.
    """

    operations: Iterable[Operation[T]]
    at_once: int


@dataclass(frozen=True)
class Emit:
    """Hand something to whoever iterates over the operation."""

    value: Any


def send(request: Request) -> Operation[Reply]:
    """``Send``, typed."""
    reply: Reply = yield Send(request)
    return reply


def call(function: Callable[[], T]) -> Operation[T]:
    """``Call``, typed."""
    result: T = yield Call(function)
    return result


def together(operations: Iterable[Operation[T]], at_once: int) -> Operation[list[T]]:
    """``Together``, typed."""
    results: list[T] = yield Together(operations, at_once)
    return results


def read(stream: Any) -> Operation[bytes | None]:
    """``Read``, typed."""
    chunk: bytes | None = yield Read(stream)
    return chunk


class Course:
    """An operation on its way: what it yields next, or what it returned."""

    def __init__(self, operation: Operation[Any]) -> None:
        self._operation = operation
        self.ended = False
        self.result: Any = None

    def begin(self) -> Any:
        """The first effect."""
        return self.step(None)

    def step(self, value: Any) -> Any:
        """Send the last effect's result; the next effect, unless the operation has ended."""
        return self._next(lambda: self._operation.send(value))

    def fail(self, error: Exception) -> Any:
        """Throw the last effect's error; the next effect, unless the operation has ended."""
        return self._next(lambda: self._operation.throw(error))

    def leave(self) -> None:
        """End the operation, wherever it is."""
        self._operation.close()

    def _next(self, move: Callable[[], Any]) -> Any:
        try:
            return move()
        except StopIteration as stop:
            self.ended, self.result = True, stop.value
            return None


class Deadline:
    """A moment that is ``seconds`` away; without them it never comes."""

    def __init__(self, seconds: float | None) -> None:
        self.seconds = seconds
        self._end = None if seconds is None else time.monotonic() + seconds

    @property
    def left_s(self) -> float:
        """How far away it is; infinite when it never comes."""
        return float("inf") if self._end is None else self._end - time.monotonic()
