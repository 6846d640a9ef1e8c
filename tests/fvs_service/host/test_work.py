"""What a job needs next: a runner may register an update's images and leave the training to another."""

import socket
import threading
from contextlib import closing, suppress
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest
import torch
from fvs_service.host.protocol.connection import Connection, RunnerGoneError
from fvs_service.host.protocol.messages import JobFinished, RunJob, StageProgress, Warned
from fvs_service.host.runner import scene_jobs
from fvs_service.host.runner.gpu_memory import GpuMemory
from fvs_service.host.runner.image_files import PreparedImages
from fvs_service.host.runner.job_monitor import JobMonitor
from fvs_service.host.runner.request_queue import RequestQueue
from fvs_service.host.runner.scene_jobs import SceneJobs
from fvs_service.jobs.stages import Work, first_work
from fvs_service.settings import WorkerSettings
from fvs_service.storage.tables import JobRow
from granted_scenes import GrantedScenes

from fvs_engine.errors import Cancelled, DamagedOutputError, OtherSettingsError
from fvs_engine.monitor import Monitor
from fvs_engine.scene.settings import SceneSettings
from fvs_engine.wording import sentence
from fvs_schema.findings import Finding, FindingCode
from fvs_schema.jobs import JobKind, JobRequest
from fvs_schema.stages import Stage


def test_only_a_fine_model_begins_with_training() -> None:
    assert {kind: first_work(kind) for kind in JobKind if first_work(kind) is not Work.SFM} == {
        JobKind.FINE: Work.TRAINING
    }


class Runner:
    """Registers, and says that the training is next; keeps what it was asked."""

    def __init__(self) -> None:
        self._socket = socket.create_server(("127.0.0.1", 0))
        host, port = self._socket.getsockname()
        self.endpoint = f"{host}:{port}/secret"
        self.asked: dict[str, Any] = {}
        threading.Thread(target=self._serve, daemon=True).start()

    def close(self) -> None:
        self._socket.close()

    def _serve(self) -> None:
        with suppress(OSError, RunnerGoneError), closing(Connection(self._socket.accept()[0])) as connection:
            connection.receive()
            self.asked = connection.receive()
            connection.send({"part": StageProgress(stage=Stage.REGISTRATION, share=1.0)})
            connection.send({"result": JobFinished(outcome=None)})


def test_an_update_whose_runner_only_registers_waits_for_its_training(open_gateway: Any) -> None:
    gateway = open_gateway()
    storage, runner = gateway.application.storage, Runner()
    job = gateway.queue(gateway.scene())
    turns = GrantedScenes(gateway, runner.endpoint).turns()
    turn = gateway.take(job)
    assert turns.run(turn) is None  # it lacks nothing
    storage.queue.put_back(turn)
    runner.close()
    with storage.database.reading() as session:
        assert session.get(JobRow, job).work == "training"
    waits = gateway.client.get(f"/v1/jobs/{job}").json()
    assert (waits["state"], waits["attempt"], waits["stage"]) == ("running", 1, "registration")
    assert storage.queue.take("tester") == turn


@pytest.mark.parametrize(("every", "tested"), [(None, []), (4, ["0.png", "4.png"]), (9, []), (2, [])])
def test_held_out_views_are_not_trained_on(every: int | None, tested: list[str]) -> None:
    """None is held out when too few would be left."""
    views = [cast(Any, SimpleNamespace(name=f"{number}.png")) for number in range(3 if every == 2 else 6)]
    trained, held_out = scene_jobs._split(views, every)
    assert [view.name for view in held_out] == tested
    assert {view.name for view in trained} | set(tested) == {view.name for view in views}
    assert len(trained) + len(tested) == len(views)


class SomeUpdate:
    """The result of an ``add`` that changes nothing."""

    registered, moved, warnings = (), 0, ()


class Scene:
    """A scene whose models are to be trained."""

    visited: tuple[str, ...] = ()
    quarantined: dict[str, Finding] = {}  # noqa: RUF012
    views: tuple[Any, ...] = ()
    settings = SceneSettings()

    def __init__(self) -> None:
        self.calls: list[str] = []

    def add(self, *_: Any, **__: Any) -> Any:
        self.calls.append("add")
        return SomeUpdate()

    def save(self) -> None:
        self.calls.append("save")

    def is_trained(self, _quality: str) -> bool:
        return False

    def train(self, quality: str, _monitor: Monitor) -> None:
        self.calls.append(f"train {quality}")
        raise Cancelled("It was asked to train.")


def _monitor(warnings: list[Finding] | None = None) -> JobMonitor:
    def receive(message: StageProgress | Warned) -> None:
        if isinstance(message, Warned) and warnings is not None:
            warnings.append(message.finding)

    return JobMonitor(receive, RequestQueue(1, 1))


def _jobs(folder: Path) -> SceneJobs:
    return SceneJobs(
        folder,
        cast(Any, None),
        WorkerSettings(),
        cast(Any, SimpleNamespace(device=SimpleNamespace(type="cpu"))),
        cast(Any, SimpleNamespace()),
        GpuMemory(torch.device("cpu")),
    )


def _request(*, trains: bool) -> RunJob:
    return RunJob(
        job_id="job",
        request=JobRequest(kind=JobKind.UPDATE),
        images=(),
        camera=None,
        origin=None,
        snapshot_id=None,
        trains=trains,
    )


def test_a_scene_of_other_settings_is_reconstructed_from_scratch(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene, kept = Scene(), tmp_path / "growing" / "kept"
    kept.parent.mkdir()
    kept.touch()

    def opened(folder: Path, *_: Any) -> Scene:
        if folder.exists():
            raise OtherSettingsError("It holds another scene: seed was 0 and is 1.")
        return scene

    images = {name: cast(Any, SimpleNamespace(digest=name)) for name in ("a", "b")}
    monkeypatch.setattr(scene_jobs, "prepare_images", lambda *_: PreparedImages(images, {}))
    monkeypatch.setattr(scene_jobs, "pose_priors", lambda *_: {})
    monkeypatch.setattr(scene_jobs.Scene, "open", opened)
    warnings: list[Finding] = []
    assert _jobs(tmp_path).run(_request(trains=False), _monitor(warnings)) is None
    assert scene.calls == ["add", "save"]
    assert not kept.exists()
    assert warnings == [Finding.of(FindingCode.STARTED_AGAIN_WITH_SETTINGS)]


def test_a_damaged_scene_is_reconstructed_from_scratch(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene, damaged = Scene(), tmp_path / "growing" / "damaged"
    damaged.parent.mkdir()
    damaged.touch()

    class Damaged(Scene):
        def add(self, *_: Any, **__: Any) -> Any:
            raise DamagedOutputError("The feature database is damaged.")

    images = {name: cast(Any, SimpleNamespace(digest=name)) for name in ("a", "b")}
    monkeypatch.setattr(scene_jobs, "prepare_images", lambda *_: PreparedImages(images, {}))
    monkeypatch.setattr(scene_jobs, "pose_priors", lambda *_: {})
    monkeypatch.setattr(scene_jobs.Scene, "open", lambda *_: Damaged() if damaged.exists() else scene)
    warnings: list[Finding] = []
    assert _jobs(tmp_path).run(_request(trains=False), _monitor(warnings)) is None
    assert scene.calls == ["add", "save"]
    assert warnings == [Finding.of(FindingCode.STARTED_AGAIN_AFTER_DAMAGE)]


def test_a_runner_registers_alone_what_its_worker_does_not_train(
    tmp_path: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = Scene()
    images = {name: cast(Any, SimpleNamespace(digest=name)) for name in ("a", "b")}
    prepared = PreparedImages(images, {})
    monkeypatch.setattr(scene_jobs, "prepare_images", lambda *_: prepared)
    monkeypatch.setattr(scene_jobs, "pose_priors", lambda *_: {})
    monkeypatch.setattr(SceneJobs, "_open_scene", lambda *_: scene)
    jobs = _jobs(tmp_path)

    def run(*, trains: bool) -> Any:
        return jobs.run(_request(trains=trains), _monitor())

    assert run(trains=False) is None
    assert scene.calls == ["add", "save"]
    with pytest.raises(Cancelled, match="asked to train"):
        run(trains=True)
    assert scene.calls[2:] == ["add", "save", "train quick"]


@pytest.mark.parametrize(("count", "visited", "first"), [(20, 0, True), (19, 0, False), (20, 10, False)])
def test_a_new_scene_of_many_images_gets_a_model_of_its_first_ones(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, count: int, visited: int, first: bool
) -> None:
    """Once: another try would take out the images that were added since."""
    scene, names = Scene(), [f"{number:02}" for number in range(count)]
    scene.visited = tuple(names[:visited])
    added: list[int] = []
    monkeypatch.setattr(Scene, "add", lambda _, some, *__, **___: added.append(len(some)) or SomeUpdate())
    monkeypatch.setattr(Scene, "train", lambda *_: "a model")
    images = {name: cast(Any, SimpleNamespace(digest=name)) for name in names}
    monkeypatch.setattr(scene_jobs, "prepare_images", lambda *_: PreparedImages(images, {}))
    monkeypatch.setattr(scene_jobs, "pose_priors", lambda *_: {})
    monkeypatch.setattr(scene_jobs, "discard_images", lambda *_: None)
    monkeypatch.setattr(SceneJobs, "_open_scene", lambda *_: scene)
    monkeypatch.setattr(SceneJobs, "_outcome_of_update", lambda *given, **_: given)
    published: list[tuple[str, int]] = []
    warnings: list[Finding] = []
    scene.quarantined = {"03": Finding.of(FindingCode.QUARANTINED, ["03"])}
    monkeypatch.setattr(SomeUpdate, "warnings", (Finding.of(FindingCode.UNCALIBRATED),))
    monkeypatch.setattr(scene_jobs, "_quarantine", lambda *_: None)
    _jobs(tmp_path).run(
        _request(trains=True),
        _monitor(warnings),
        publish=lambda name, outcome: published.append((name, len(cast(Any, outcome)[3]))),
    )
    assert added == ([10, count] if first else [count])
    assert published == ([("first", 9)] if first else []) + [("quick", count - 1)]
    told = ["The first 10 images: The view graph"] if first else []
    assert [sentence(warning)[:35] for warning in warnings[:-1]] == told
    assert warnings[-1] == Finding.of(FindingCode.UNCALIBRATED)
    if first:  # and the job was killed before it saved
        added.clear()
        _jobs(tmp_path).run(_request(trains=True), _monitor())
        assert added == [count]
    (tmp_path / "growing" / "first-model-tried").unlink(missing_ok=True)
    added.clear()
    request = _request(trains=True).model_copy(update={"snapshot_id": "snp"})
    monkeypatch.setattr(SceneJobs, "_evaluate_previous", lambda *_: None)
    _jobs(tmp_path).run(request, _monitor())
    assert added == [count]
