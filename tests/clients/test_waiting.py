import json
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any

import httpx2
import pytest
from fvs_client import (
    Client,
    ConnectionFailedError,
    Event,
    Job,
    JobCanceledError,
    JobFailedError,
    JobState,
    NotFoundError,
    Retries,
    Scene,
    UnexpectedAnswerError,
    WaitTimeoutError,
)

from fvs_schema.jobs import JobFailure

Play = Callable[[], None]


class Worker:
    """Works on one job of a scene as a worker does, in a thread, each step when the test says so."""

    def __init__(self, gateway: Any, scene: Scene, job: Job) -> None:
        self._ledger = gateway.application.storage.ledger
        self._lease = gateway.lease(scene.id)
        self._job, self._attempt = job.id, job.attempt

    def start(self) -> None:
        self._ledger.start(self._lease, self._job, self._attempt)

    def report(self, stage: str, progress: float) -> None:
        self._ledger.report(self._lease, self._job, stage, progress, eta_s=3.0)

    def succeed(self) -> None:
        self._ledger.succeed(self._lease, self._job)

    def fail(self) -> None:
        why = JobFailure(
            code="reconstruction-failed",
            message="Too little overlap.",
            hint="Fly slower.",
            retryable=False,
            stage="matching",
        )
        self._ledger.fail(self._lease, self._job, why)


@pytest.fixture
def scene(client: Client) -> Scene:
    return client.scenes.create("quarry")


def test_progress_comes_over_events_and_the_job_is_returned(gateway: Any, scene: Scene) -> None:
    job = scene.update()
    worker = Worker(gateway, scene, job)
    moves: list[Play] = [
        worker.start,
        lambda: worker.report("features", 0.2),
        lambda: worker.report("matching", 0.4),
        lambda: worker.report("training", 0.9),
        worker.succeed,
    ]
    seen: list[Job] = []

    def on_progress(now: Job) -> None:
        seen.append(now)
        if moves:  # what follows happens only once this was seen, so nothing can be missed by chance
            moves.pop(0)()

    done = job.wait(on_progress=on_progress)
    assert done.state is JobState.SUCCEEDED
    assert [now.stage for now in seen] == [None, None, "features", "matching", "training", "training"]
    assert [now.progress for now in seen] == [0, 0, 0.2, 0.4, 0.9, 1.0]
    assert [now.state for now in seen[:3]] == [JobState.QUEUED, JobState.RUNNING, JobState.RUNNING]
    assert seen[3].eta_s == 3.0
    assert done.refresh() == done


def test_a_failed_job_raises_what_it_said(gateway: Any, scene: Scene) -> None:
    job = scene.update()
    worker = Worker(gateway, scene, job)
    worker.start()
    worker.fail()
    with pytest.raises(JobFailedError, match="Too little overlap") as caught:
        job.wait()
    assert caught.value.hint == "Fly slower."
    assert caught.value.job.error is not None
    assert caught.value.job.error.stage == "matching"


def test_a_canceled_job_raises_and_can_be_retried(scene: Scene) -> None:
    job = scene.update()
    canceling = threading.Timer(0.2, job.cancel)
    canceling.start()
    with pytest.raises(JobCanceledError):
        job.wait()
    canceling.join()
    again = job.retry()
    assert (again.state, again.attempt) == (JobState.QUEUED, 2)
    with pytest.raises(WaitTimeoutError):
        again.wait(timeout_s=0.2)


def test_waiting_ends_in_time_while_the_job_goes_on(scene: Scene) -> None:
    job = scene.update()
    began = time.monotonic()
    with pytest.raises(WaitTimeoutError, match="has not ended") as caught:
        job.wait(timeout_s=0.5)
    assert 0.5 <= time.monotonic() - began < 3.0
    assert caught.value.job.state is JobState.QUEUED


def test_waiting_for_nothing_raises_at_once(scene: Scene) -> None:
    job = scene.update().model_copy(update={"id": "job_none"})
    with pytest.raises(NotFoundError):
        job.wait()


class Cutting(httpx2.BaseTransport):
    """The network, but streams of events break after some pieces, or cannot be had at all."""

    def __init__(self, pieces: int, *, refuse: bool = False) -> None:
        self._network = httpx2.HTTPTransport()
        self._pieces, self._refuse = pieces, refuse
        self.resumed_from: list[str | None] = []

    def handle_request(self, request: httpx2.Request) -> httpx2.Response:
        if not request.url.path.endswith("/events"):
            return self._network.handle_request(request)
        self.resumed_from.append(request.headers.get("last-event-id"))
        if self._refuse:
            raise httpx2.ReadError("cut")
        response = self._network.handle_request(request)
        return httpx2.Response(
            response.status_code, headers=response.headers, stream=_Cut(response.stream, self._pieces)
        )


class _Cut(httpx2.SyncByteStream):
    def __init__(self, stream: Any, pieces: int) -> None:
        self._stream, self._pieces = stream, pieces

    def __iter__(self) -> Any:
        for number, piece in enumerate(self._stream):
            if number == self._pieces:
                raise httpx2.ReadError("cut")
            yield piece

    def close(self) -> None:
        self._stream.close()


@pytest.mark.parametrize("transport", [Cutting(2), Cutting(0, refuse=True)], ids=["cut", "refused"])
def test_waiting_survives_broken_streams(gateway: Any, url: str, transport: Cutting) -> None:
    with Client(url, retries=Retries(first_s=0.01), transport=transport) as client:
        scene = client.scenes.create("quarry")
        job = scene.update()
        worker = Worker(gateway, scene, job)
        moves: list[Play] = [worker.start, lambda: worker.report("training", 0.5), worker.succeed]
        seen: list[float] = []

        def on_progress(now: Job) -> None:
            seen.append(now.progress)
            if moves:
                moves.pop(0)()

        assert job.wait(on_progress=on_progress).state is JobState.SUCCEEDED
        assert seen == [0, 0, 0.5, 1.0]
    assert len(transport.resumed_from) > 1


def test_events_resume_without_loss_or_repetition(url: str) -> None:
    transport = Cutting(2)
    with Client(url, retries=Retries(first_s=0.01), transport=transport) as client:
        scene = client.scenes.create("quarry")
        for _ in range(3):
            scene.update().cancel()
        events = scene.events()
        seen = [next(events) for _ in range(7)]
    kinds = [event.kind.value for event in seen]
    assert kinds == ["scene.created", *["job.queued", "job.canceled"] * 3]
    numbers = [event.number for event in seen]
    assert numbers == sorted(set(numbers))


def test_events_from_now_on_leave_out_the_past(scene: Scene) -> None:
    scene.update().cancel()
    timer = threading.Timer(0.3, lambda: scene.update())
    timer.start()
    event = next(iter(scene.events(after=None)))
    timer.join()
    assert event.kind == "job.queued"


def event(number: int, **data: object) -> bytes:
    document = {
        "number": number,
        "scene_id": "scn_1",
        "kind": "job.queued",
        "data": data,
        "created_at": "2026-11-21T12:00:00Z",
    }
    return f"id: {number}\nevent: job.queued\ndata: {json.dumps(document)}\n\n".encode()


class Streaming(httpx2.MockTransport):
    """A service with one scene, whose streams of events are given; a stream breaks after its last piece."""

    def __init__(self, scene: Scene, streams: list[list[bytes]]) -> None:
        super().__init__(self._answer)
        self._scene = scene.model_dump_json(by_alias=True)
        self._streams = streams
        self.requests: list[httpx2.Request] = []

    def _answer(self, request: httpx2.Request) -> httpx2.Response:
        if not request.url.path.endswith("/events"):
            return httpx2.Response(200, content=self._scene)
        self.requests.append(request)
        pieces = self._streams.pop(0)

        def content() -> Iterator[bytes]:
            yield from pieces
            raise httpx2.ReadError("cut")

        return httpx2.Response(200, headers={"Content-Type": "text/event-stream"}, content=content())


def take(transport: Streaming, count: int, after: int | None = 0) -> list[Event]:
    with Client("http://service", retries=Retries(attempts=2, first_s=0.0), transport=transport) as client:
        events = client.scenes.get("scn_1").events(after)
        return [next(events) for _ in range(count)]


def test_a_stream_that_broke_before_its_first_event_leaves_none_out(scene: Scene) -> None:
    transport = Streaming(scene, [[b"retry: 1000\nid: 41\n\n"], [event(42)]])
    assert [found.number for found in take(transport, 1, after=None)] == [42]
    first, again = transport.requests
    assert (dict(first.url.params), first.headers.get("Last-Event-ID")) == ({"tail": "true"}, None)
    assert (dict(again.url.params), again.headers["Last-Event-ID"]) == ({}, "41")


@pytest.mark.parametrize("size", [1, 2, 3, 7, 1000])
def test_events_are_read_however_they_are_cut(scene: Scene, size: int) -> None:
    parts = [b": hello\n\nretry: 10\n\n", event(1), b": alive\n\n", event(2, name="zwölf"), event(3)]
    stream = b"".join([*parts[:3], parts[3].replace(b"\n", b"\r\n"), b"event: unused\n\n", parts[4]])
    transport = Streaming(scene, [[stream[start : start + size] for start in range(0, len(stream), size)]])
    found = take(transport, 3)
    assert [(one.number, one.data) for one in found] == [(1, {}), (2, {"name": "zwölf"}), (3, {})]


@pytest.mark.parametrize(
    "stream",
    [b"data: no event\n\n", b"data: " + b"x" * (1 << 21)],
    ids=["malformed", "endless"],
)
def test_events_that_make_no_sense_raise(scene: Scene, stream: bytes) -> None:
    transport = Streaming(scene, [[stream]])
    with pytest.raises(UnexpectedAnswerError):
        take(transport, 1)
    assert len(transport.requests) == 1


def test_a_page_in_place_of_events_raises(scene: Scene) -> None:
    transport = httpx2.MockTransport(
        lambda request: httpx2.Response(
            200,
            content="<html>"
            if request.url.path.endswith("/events")
            else scene.model_dump_json(by_alias=True),
        )
    )
    with (
        Client("http://service", transport=transport) as client,
        pytest.raises(UnexpectedAnswerError, match="event-stream"),
    ):
        next(client.scenes.get("scn_1").events())


def test_heartbeats_do_not_outlast_the_deadline(
    script: Any, scene: Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("fvs_client._sync.waiting._SILENCE_S", 0.5)
    job = scene.update()

    def play(handler: Any) -> None:
        if not handler.path.endswith("/events"):
            body = job.model_dump_json().encode()
            handler.send_response(200)
            handler.send_header("Content-Length", str(len(body)))
            handler.end_headers()
            handler.wfile.write(body)
            return
        handler.send_response(200)
        handler.send_header("Content-Type", "text/event-stream")
        handler.end_headers()
        handler.close_connection = True
        try:
            for _ in range(100):
                handler.wfile.write(b": nothing new\n\n")
                handler.wfile.flush()
                time.sleep(0.1)
        except OSError:
            pass

    script.acts = [play]
    began = time.monotonic()
    with Client(script.url) as client:
        elsewhere = job.model_copy()
        elsewhere._session = client._session
        with pytest.raises(WaitTimeoutError):
            elsewhere.wait(timeout_s=1.0)
    assert time.monotonic() - began < 5.0  # the heartbeats go on for 10 s
    assert any("/events" in path for _, path, _, _ in script.requests)


def test_events_that_cannot_be_had_raise(url: str) -> None:
    with Client(url) as client:
        scene = client.scenes.create("quarry")
    with Client(url, retries=Retries(attempts=2, first_s=0.0), transport=Cutting(0, refuse=True)) as client:
        elsewhere = scene.model_copy()
        elsewhere._session = client._session
        with pytest.raises(ConnectionFailedError):
            next(iter(elsewhere.events()))
