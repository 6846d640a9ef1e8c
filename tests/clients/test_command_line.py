import io
import json
import socket
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from fvs_client import Client
from fvs_client.cli.error_exit_codes import exit_code_of
from fvs_client.cli.progress import ranking_progress
from fvs_client.errors import ApiError, ConnectionFailedError, FvsError
from fvs_service.host.worker.heartbeat import Heartbeats
from PIL import Image
from typer.testing import Result
from videos import textured, write_video

from fvs_schema.rankings import ScoredCandidate

Run = Callable[..., Result]


def test_the_way_from_photographs_to_a_ranking(
    run: Run, gateway: Any, photographs: Path, tmp_path: Path
) -> None:
    name = f"flight {tmp_path.name}"
    scene_id = run("scenes", "create", name).stdout.strip()
    assert run("upload", name, photographs).stdout == _like("3 sent (", ")")
    assert run("upload", name, photographs).stdout == "0 sent (0.0 MB), 3 there already\n"
    assert "no model" in run("download", name, expect=2).stderr
    assert "no model" in run("rank", name, expect=3).stderr
    snapshot_id = gateway.model(scene_id)
    shown = run("scenes", "show", name).stdout
    assert f"{snapshot_id}  update, 6 images registered, 60 Gaussians" in shown
    ranked = run(
        "rank", name, "--count", "5", "--top", "2", "--renders", tmp_path / "views"
    ).stdout.splitlines()
    assert len(ranked) == 5
    assert ranked[0].split() == ["rank", "id", "score", "coverage", "chance", "distance", "status", "pose"]
    assert [line.split()[0] for line in ranked[1:3]] == ["1", "2"]
    assert "3 more; by median-frequency" in ranked[-2]
    assert ranked[-1] == f"2 renders and spectra are in {tmp_path / 'views'}"
    assert len(list((tmp_path / "views").glob("*-render.png"))) == 2
    files = run("download", name, "--out", tmp_path / "model").stdout.splitlines()
    assert [Path(file).name for file in files] == ["cameras.json", "point_cloud.ply"]
    assert all(Path(file).is_file() for file in files)
    assert snapshot_id in run("scenes", "list").stdout


def test_files_that_cannot_be_used_are_told_and_the_rest_is_sent(
    run: Run, scene_id: str, photographs: Path
) -> None:
    (photographs / "torn.jpg").write_bytes((photographs / "b.jpg").read_bytes()[:300])
    result = run("upload", scene_id, photographs, expect=10)
    assert "torn.jpg: unreadable" in result.stderr
    assert result.stdout == _like("4 sent (", "), 1 cannot be used")
    document = json.loads(run("upload", scene_id, photographs, "--json", expect=10).stdout)
    assert [file["verdict"] for file in document["files"]] == [
        "accepted",
        "accepted",
        "accepted",
        "unreadable",
    ]
    assert document["bytes_sent"] == 0


def test_jobs_are_queued_awaited_canceled_and_retried(run: Run, gateway: Any, scene_id: str) -> None:
    job = json.loads(run("update", scene_id, "--no-wait", "--json").stdout)
    assert "has not ended" in run("jobs", "wait", job["id"], "--timeout", "0.1", expect=9).stderr
    assert "waits, number 1 in the queue. No worker is alive." in run("jobs", "show", job["id"]).stdout
    assert "waits: no-worker" in run("jobs", "list", scene_id).stdout
    assert "canceled" in run("jobs", "cancel", job["id"]).stdout
    assert "was canceled" in run("jobs", "wait", job["id"], expect=8).stderr
    run("jobs", "retry", job["id"], "--no-wait")
    run("jobs", "cancel", job["id"])
    assert "fvs-client update" in run("fine", scene_id, expect=3).stderr
    gateway.model(scene_id)
    listed = json.loads(run("jobs", "list", scene_id, "--json").stdout)
    assert [item["state"] for item in listed] == ["succeeded", "canceled"]
    ended = json.loads(run("jobs", "list", scene_id, "--state", "canceled", "--json").stdout)
    assert [item["id"] for item in ended] == [job["id"]]
    done = run("jobs", "wait", listed[0]["id"])
    assert "6 images registered" in done.stdout
    assert "Updating the model: 100%" in done.stderr


class _Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_a_terminal_shows_how_many_candidates_are_scored(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setattr(sys, "stderr", terminal := _Terminal())
    one, two = (ScoredCandidate.model_construct(id=name) for name in ("one", "two"))
    with ranking_progress(as_json=False) as on_scored:
        assert on_scored is not None
        for scored in ((one,), (one, two)):  # what is scored again does not count again
            on_scored(scored)
    assert "Ranking: 2 scored" in terminal.getvalue()
    with ranking_progress(as_json=True) as on_scored:
        assert on_scored is None


@pytest.mark.system
def test_progress_and_errors_are_json_where_json_is_asked_for(
    run: Run, url: str, gateway: Any, scene_id: str
) -> None:
    gateway.model(scene_id)
    job_id = json.loads(run("jobs", "list", scene_id, "--json").stdout)[0]["id"]

    def alone(*words: str, expect: int) -> tuple[str, list[Any]]:
        """Run in a process of its own: the gateway of the tests logs to the stderr of this one."""
        command = [sys.executable, "-m", "fvs_client", "--url", url, *words, "--json"]
        process = subprocess.run(command, capture_output=True, text=True, check=False)
        assert process.returncode == expect, process.stderr
        return process.stdout, [json.loads(line) for line in process.stderr.splitlines()]

    result, said = alone("jobs", "wait", job_id, expect=0)
    assert json.loads(result)["state"] == "succeeded"
    assert [line["progress"]["share"] for line in said] == [1.0]
    _, (refused,) = alone("jobs", "show", "job_none", expect=6)
    assert refused["error"]["code"] == "not-found"
    assert refused["error"]["request_id"]


def test_events_are_printed_as_they_come(url: str, scene_id: str, run: Run) -> None:
    with subprocess.Popen(
        [sys.executable, "-m", "fvs_client", "--url", url, "events", scene_id, "--json"],
        stdout=subprocess.PIPE,
        text=True,
    ) as process:
        assert process.stdout is not None
        assert json.loads(process.stdout.readline())["kind"] == "scene.created"
        run("update", scene_id, "--no-wait")
        assert json.loads(process.stdout.readline())["kind"] == "job.queued"
        process.terminate()


def test_a_service_that_does_not_run_is_told_kindly(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("fvs_client.retries.Retries.pause_s", lambda *_: None)
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        url = f"http://127.0.0.1:{taken.getsockname()[1]}"
        result = run("--url", url, "status", expect=4)
    assert result.stderr.splitlines() == [
        f"Error: There is no answer at {url}.",
        "Is the service running? `fvs serve` starts one; FVS_URL sets where it is.",
    ]


def test_wrong_usage_is_told(run: Run, tmp_path: Path) -> None:
    assert "scenes create" in run("scenes", "show", "nowhere", expect=6).stderr
    run("--url", "nowhere", "status", expect=2)
    run("scenes", "create", "x", "--local", "--origin", "1", "2", "3", expect=2)
    run("upload", "scene", "/does/not/exist", expect=2)
    (tmp_path / "IMG_1.HEIC").write_bytes(b"of a telephone")
    assert "no image" in run("upload", "scene", tmp_path, expect=2).stderr


def test_a_name_is_that_of_one_scene(run: Run, client: Client, tmp_path: Path) -> None:
    name, renamed = tmp_path.name, client.scenes.create(f"{tmp_path.name} 2").id
    scene_id = run("scenes", "create", name).stdout.strip()
    for words in (
        ("scenes", "create", name),
        ("scenes", "change", renamed, "--name", name),
    ):
        lines = _said(run(*words, expect=2))
        assert lines[0] == f"Error: There is a scene called {name!r} already."
        assert scene_id in lines[1]
    run("scenes", "change", scene_id, "--name", name)
    ids = [client.scenes.create(name).id, scene_id]
    for command in ("scenes show", "rank", "update", "images", "download"):
        lines = _said(run(*command.split(), name, expect=2))
        assert lines == [f"Error: 2 scenes are called {name!r}.", f"Give the id of one: {', '.join(ids)}."]


def test_a_world_is_made_as_asked_for(run: Run, client: Client, tmp_path: Path) -> None:
    made = json.loads(
        run(
            "scenes", "create", tmp_path.name, "--origin", "48.3", "7.25", "412", "--every", "5", "--json"
        ).stdout
    )
    scene = client.scenes.get(made["id"])
    assert scene.origin is not None
    assert (scene.origin.latitude_deg, scene.origin.altitude_m) == (48.3, 412.0)
    assert (scene.policy.trigger, scene.policy.k) == ("every-k-images", 5)


def test_what_is_known_of_the_camera_goes_along(run: Run, client: Client, tmp_path: Path) -> None:
    words = ["--focal-length", "1042.5", "1600", "--every", "3", "--first", "12"]
    scene = client.scenes.get(run("scenes", "create", tmp_path.name, *words).stdout.strip())
    assert scene.camera is not None
    assert (scene.camera.focal_length_px, scene.camera.width_px) == (1042.5, 1600)
    assert (scene.policy.k, scene.policy.first) == (3, 12)


def test_images_are_listed_with_what_became_of_them(run: Run, scene_id: str, photographs: Path) -> None:
    (photographs / "broken.jpg").write_bytes(b"no photograph")
    with Image.open(photographs / "a.JPG") as image:
        mask = Image.new("1", image.size, 1)
    mask.putpixel((0, 0), 0)
    (photographs / "masks").mkdir()
    mask.save(photographs / "masks" / "a.png")
    write_video(photographs / "v.mp4", [(0.0, textured())])
    run("upload", scene_id, str(photographs), expect=10)
    assert run("images", scene_id).stdout.count("masked") == 1
    assert "its frames are to come" in " ".join(run("images", scene_id).stdout.split())
    listed = json.loads(run("images", scene_id, "--json").stdout)
    assert sorted(image["name"] for image in listed) == [
        "a.JPG",
        "b.jpg",
        "broken.jpg",
        "left_c.png",
        "v.mp4",
    ]
    assert "unreadable" in run("images", scene_id, "--problems").stdout


def test_a_fine_model_is_measured_as_asked_for(run: Run, gateway: Any, scene_id: str) -> None:
    gateway.model(scene_id)
    job = json.loads(run("fine", scene_id, "--test-every", "8", "--no-wait", "--json").stdout)
    assert gateway.client.get(f"/v1/jobs/{job['id']}").json()["request"]["test_every"] == 8
    run("jobs", "cancel", job["id"])


def test_status_tells_what_the_service_can_do(run: Run, gateway: Any) -> None:
    shown = run("status", expect=4).stdout  # this gateway has no worker
    assert "median-frequency" in shown
    assert "uploads     work" in shown
    assert "no worker is alive" in shown
    storage = gateway.application.storage
    Heartbeats(storage.database, "cluster").beat(slots=0)
    shown = run("status", expect=4).stdout
    storage.queue.keep_workers(())
    assert "jobs        wait: the Ray cluster cannot be reached" in shown
    assert "cluster is alive (auto): 0 models loaded in 0 MB, it cannot reach its Ray cluster" in shown


def test_every_error_has_a_status() -> None:
    def below(kind: type[Exception]) -> list[type[Exception]]:
        return [kind, *(found for child in kind.__subclasses__() for found in below(child))]

    for kind in below(FvsError):
        assert exit_code_of(kind.__new__(kind)) in range(2, 10)  # type: ignore[arg-type]
    assert exit_code_of(ConnectionFailedError("x")) == 4
    assert ApiError in below(FvsError)


def _said(result: Result) -> list[str]:
    """The lines on stderr, without those that the gateway logs in this process."""
    return [line for line in result.stderr.splitlines() if not line.startswith("{")]


class _like:  # noqa: N801 - reads as a word in comparisons
    """Equal to any line that begins and ends so."""

    def __init__(self, start: str, end: str) -> None:
        self._start, self._end = start, end

    def __eq__(self, other: object) -> bool:
        return isinstance(other, str) and other.startswith(self._start) and other.rstrip().endswith(self._end)

    def __hash__(self) -> int:
        return hash((self._start, self._end))


@pytest.mark.system
def test_scenes_of_one_name_are_told_apart_changed_and_deleted(
    run: Run, client: Client, gateway: Any, tmp_path: Path
) -> None:
    name = f"twin {tmp_path.name}"
    first, second = (client.scenes.create(name).id for _ in range(2))
    refused = run("scenes", "show", name, expect=2).output
    assert first in refused
    assert second in refused
    run("scenes", "change", second, "--name", f"{name} 2", "--snapshots", "1")
    assert f"{second}  {name} 2" in run("scenes", "show", f"{name} 2").stdout
    run("scenes", "change", second, expect=2)
    made = [gateway.model(second) for _ in range(2)]
    run("snapshots", "pin", made[0])
    listed = run("snapshots", "list", second).stdout.splitlines()
    assert listed[1].split()[-1] == "current"
    assert listed[2].split()[-1] == "pinned"
    run("snapshots", "delete", made[0], "--yes", expect=3)
    run("snapshots", "unpin", made[0])
    run("snapshots", "delete", made[0], "--yes")
    run("snapshots", "delete", made[0], "--yes", expect=6)
    ranking = json.loads(run("rank", second, "--json").stdout)["id"]
    assert [one["id"] for one in json.loads(run("rankings", "list", second, "--json").stdout)] == [ranking]
    assert ranking in run("rankings", "list", second).stdout
    assert json.loads(run("rankings", "show", ranking, "--json").stdout)["id"] == ranking
    assert "median-frequency" in run("rankings", "show", ranking).stdout
    run("rankings", "delete", ranking, "--yes")
    assert "Nothing was deleted" in run("scenes", "delete", name, expect=2).output
    run("scenes", "delete", name, "--yes")
    run("scenes", "show", first, expect=6)
    run("scenes", "delete", second, "-y")
