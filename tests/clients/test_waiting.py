import threading
import time
from collections.abc import Callable
from typing import Any

import httpx2
import pytest
from fvs_client import (
    Client,
    ConnectionFailedError,
    JobCanceledError,
    JobFailedError,
    JobState,
    NotFoundError,
    Retries,
    WaitTimeoutError,
)
from fvs_client.effects import OpenReply
from fvs_client.operations.events import MessageDecoder, follow
from fvs_client.resources import Job, Scene
from fvs_service.jobs.model import JobError

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
        why = JobError(
            code="reconstruction-failed",
            message="Too little overlap.",
            hint="Fly slower.",
            retryable=False,
            stage="mapping",
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
        lambda: worker.report("train", 0.9),
        worker.succeed,
    ]
    seen: list[Job] = []

    def on_progress(now: Job) -> None:
        seen.append(now)
        if moves:  # what follows happens only once this was seen, so nothing can be missed by chance
            moves.pop(0)()

    done = job.wait(on_progress=on_progress)
    assert done.state is JobState.SUCCEEDED
    assert [now.stage for now in seen] == [None, None, "features", "matching", "train", "train"]
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
    assert caught.value.job.error.stage == "mapping"


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
        moves: list[Play] = [worker.start, lambda: worker.report("train", 0.5), worker.succeed]
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


def test_a_stream_that_broke_before_its_first_event_leaves_none_out() -> None:
    following = follow("scn", None, Retries(first_s=0.0))
    first = next(following).request
    assert (first.params, "Last-Event-ID" in first.headers) == ({"tail": "true"}, False)
    following.send(OpenReply(200, {}, "stream"))
    following.send(b"retry: 1000\nid: 41\n\n")
    following.throw(ConnectionFailedError("It broke."))
    again = following.send(None).request
    assert (again.params, again.headers["Last-Event-ID"]) == ({}, "41")
    following.close()


def test_events_that_cannot_be_had_raise(url: str) -> None:
    with Client(url) as client:
        scene = client.scenes.create("quarry")
    with Client(url, retries=Retries(attempts=2, first_s=0.0), transport=Cutting(0, refuse=True)) as client:
        elsewhere = scene.model_copy()
        elsewhere._session = client._session
        with pytest.raises(ConnectionFailedError):
            next(iter(elsewhere.events()))


STREAM = (
    ": hello\n\nretry: 10\n\nid: 1\nevent: a\ndata: x\ndata:y\n\ndata: zwölf\r\n\r\nevent: unused\n\ndata\n\n"
).encode()


@pytest.mark.parametrize("size", [1, 2, 3, 7, 1000])
def test_messages_are_read_however_they_are_cut(size: int) -> None:
    decoder = MessageDecoder()
    chunks = [STREAM[start : start + size] for start in range(0, len(STREAM), size)]
    messages = [message for chunk in chunks for message in decoder.feed(chunk)]
    assert [(message.event, message.data) for message in messages] == [
        ("a", "x\ny"),
        ("message", "zwölf"),
        ("message", ""),
    ]
