"""A scene's events, as server-sent events (WHATWG HTML, section 9.2) that go on after a broken connection."""

from collections.abc import Iterator
from dataclasses import dataclass

import pydantic

from fvs_client import requests
from fvs_client.effects import Close, Emit, Operation, Sleep, read
from fvs_client.errors import FvsError, UnexpectedAnswerError
from fvs_client.exchange import opened
from fvs_client.models.events import Event
from fvs_client.retries import Retries

_MOST_BYTES = 1 << 20


@dataclass(frozen=True)
class Message:
    """One server-sent event."""

    event: str
    data: str


class MessageDecoder:
    """Turns bytes, however they are cut, into messages; leaves out comments (heartbeats)."""

    def __init__(self) -> None:
        self.last_id: int | None = None
        """From where to resume: also the stream's beginning has one."""
        self._rest = b""
        self._event, self._data = "", list[str]()

    def feed(self, chunk: bytes) -> Iterator[Message]:
        """The messages that ``chunk`` completes."""
        text = self._rest + chunk
        if len(text) > _MOST_BYTES:
            raise UnexpectedAnswerError("An event is larger than any of the service.")
        held = b"\r" if text.endswith(b"\r") else b""  # its line feed may be still to come
        *lines, rest = text.removesuffix(held).replace(b"\r\n", b"\n").replace(b"\r", b"\n").split(b"\n")
        self._rest = rest + held
        for line in lines:
            message = self._line(line.decode("utf-8", errors="replace").removeprefix("\ufeff"))
            if message is not None:
                yield message

    def _line(self, line: str) -> Message | None:
        if not line:
            message = Message(self._event or "message", "\n".join(self._data)) if self._data else None
            self._event, self._data = "", []
            return message
        name, _, value = line.partition(":")
        value = value.removeprefix(" ")
        if name == "event":
            self._event = value
        elif name == "data":
            self._data.append(value)
        elif name == "id" and value.isascii() and value.isdigit():
            self.last_id = int(value)
        return None


def events_in(decoder: MessageDecoder, chunk: bytes) -> Iterator[Event]:
    """The events that ``chunk`` completes."""
    for message in decoder.feed(chunk):
        try:
            yield Event.model_validate_json(message.data)
        except pydantic.ValidationError as error:
            raise UnexpectedAnswerError(f"An event cannot be read: {message.data[:200]!r}") from error


def follow(scene_id: str, after: int | None, retries: Retries) -> Operation[None]:
    """Emit a scene's events after number ``after`` (None: those from now on), for ever.

    A broken connection is taken up again after the last event that was seen, so none is lost and none comes
    twice. Raises when that fails as often in a row as ``retries`` allow.
    """
    failures = 0
    while True:
        try:
            reply = yield from opened(requests.watch_events(scene_id, after))
            decoder = MessageDecoder()
            while (chunk := (yield from read(reply.stream))) is not None:
                failures = 0
                for event in events_in(decoder, chunk):
                    after = event.number
                    yield Emit(event)
                if after is None:
                    after = decoder.last_id
            yield Close(reply.stream)
            pause = retries.first_s  # the service ended it: it stops, or starts anew
        except FvsError as error:
            failures += 1
            again = retries.pause_s(error, failures, 0.0)
            if again is None:
                raise
            pause = again
        yield Sleep(pause)
