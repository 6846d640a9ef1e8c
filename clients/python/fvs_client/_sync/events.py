# Generated from _async/events.py by `make generate`. Do not edit.
"""A scene's events, as server-sent events (WHATWG HTML, section 9.2)."""

from collections.abc import Iterator

import httpx2

from fvs_client import requests
from fvs_client._sync.concurrency import sleep
from fvs_client._sync.session import Session
from fvs_client.answers import event_number, parse_event
from fvs_client.errors import FvsError
from fvs_schema.events import Event, EventKind


def follow(session: Session, scene_id: str, after: int | None) -> Iterator[Event]:
    """A scene's events after number ``after`` (None: only new ones), until the scene is deleted.

    Resumes a broken stream after the last event, so that no event is lost or repeated. Raises when this fails
    as often in a row as the session's retries allow.
    """
    failures = 0
    while True:
        try:
            with session.open(requests.watch_events(scene_id, after)) as response:
                for message in httpx2.EventSource(response):
                    failures = 0
                    after = event_number(message, after)
                    if message.data:
                        event = parse_event(message)
                        yield event
                        if event.kind is EventKind.SCENE_DELETED:
                            return
            pause = session.retries.first_s  # the service closed the stream: it stops or restarts
        except FvsError as error:
            failures += 1
            again = session.retries.pause_s(error, failures, 0.0)
            if again is None:
                raise
            pause = again
        sleep(pause)
