"""The synchronous client is generated, and both give the same answers and errors."""

import functools
import re
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import fvs_client
import pydantic
import pytest
from anyio.from_thread import start_blocking_portal
from fvs_client import (
    AsyncClient,
    Box,
    Client,
    EnuWorld,
    EventKind,
    Finish,
    FramePose,
    FvsError,
    Grid,
    InVolume,
    LocalWorld,
    MissionFormat,
    Orbit,
    Origin,
    Policy,
    Prism,
    Retention,
    Retries,
    Trigger,
)

from fvs_schema.scenes import Alignment

Do = Callable[..., Any]
RETRIES = Retries(first_s=0.01, longest_s=0.05)


class Surface:
    """Calls either client in the same way; with a folder of images."""

    def __init__(self, client: Any, do: Do, items: Callable[[Any, int | None], list[Any]]) -> None:
        self.client, self.do, self.items = client, do, items
        self.folder = Path()
        self.gateway: Any = None

    def attempt(self, function: Do, *args: Any, **options: Any) -> Any:
        try:
            return self.do(function, *args, **options)
        except (FvsError, FileNotFoundError, ValueError) as error:
            details = [getattr(error, name, None) for name in ("status", "hint", "retryable", "errors")]
            return [type(error).__name__, str(error), details]


def scenes(surface: Surface) -> Iterator[Any]:
    client, do, folder = surface.client, surface.do, surface.folder
    scene = do(
        client.scenes.create,
        "quarry",
        world=LocalWorld(),
        policy=Policy(trigger=Trigger.EVERY_K_IMAGES, k=3),
        idempotency_key=folder.name,
    )
    yield scene
    yield do(
        client.scenes.create, "quarry", world=LocalWorld(), policy=scene.policy, idempotency_key=folder.name
    )
    yield surface.attempt(client.scenes.create, "other", idempotency_key=folder.name)
    yield surface.attempt(client.scenes.create, "x" * 300)
    yield surface.attempt(client.scenes.get, "scn_none")
    yield surface.attempt(client.scenes.get, "../../livez")[0]  # not its message: over HTTP it is a path
    yield do(scene.refresh) == scene
    yield scene.id in [item.id for item in surface.items(client.scenes.list(), None)]
    yield do(client.capabilities)
    yield do(client.health)


def images(surface: Surface) -> Iterator[Any]:
    folder = surface.folder
    scene = surface.do(surface.client.scenes.create, "quarry")
    (folder / "torn.jpg").write_bytes((folder / "b.jpg").read_bytes()[:200])
    for _ in range(2):
        report = surface.do(scene.images.upload, folder, parallel=1)
        yield [(file.path.name, file.outcome, file.digest, file.image) for file in report.files]
        yield report.bytes_sent
    yield surface.attempt(scene.images.upload, folder / "nothing.jpg")
    yield surface.items(scene.images.list(), None)
    yield surface.do(scene.images.put, b"no image")
    yield surface.attempt(scene.images.get, f"sha256:{'0' * 64}")
    yield surface.do(scene.images.thumbnail, surface.items(scene.images.list(), None)[0].digest)
    yield surface.attempt(scene.images.thumbnail, f"sha256:{'0' * 64}")
    yield surface.attempt(scene.images.check, ["md5:1"])
    yield surface.do(scene.refresh)


def jobs(surface: Surface) -> Iterator[Any]:
    client, do = surface.client, surface.do
    scene = do(client.scenes.create, "quarry")
    yield surface.attempt(scene.fine)
    job = do(scene.update, iterations=10)
    yield job
    yield surface.attempt(job.retry)
    seen: list[Any] = []
    yield surface.attempt(job.wait, timeout_s=0.1, on_progress=seen.append)
    yield do(job.refresh, wait_s=0.05)
    yield surface.attempt(job.refresh, wait_s=-1.0)
    yield do(job.cancel)
    yield do(job.refresh, wait_s=30.0)
    yield surface.attempt(job.wait, on_progress=seen.append)
    yield seen
    yield do(job.retry)
    yield do(do(client.jobs.get, job.id).cancel)
    surface.gateway.model(scene.id)
    done = surface.items(scene.jobs.list(), None)[0]
    yield do(done.wait)
    yield do(done.snapshot)
    yield surface.attempt(client.jobs.get, "job_none")
    yield [(event.kind, sorted(facts(event.data))) for event in surface.items(scene.events(), 8)]


def webhooks(surface: Surface) -> Iterator[Any]:
    client, do = surface.client, surface.do
    scene = do(client.scenes.create, "quarry")
    url, kinds = "https://hooks.example/a", [EventKind.JOB_FAILED, "scene.deleted"]
    webhook = do(scene.webhooks.create, url, kinds)
    assert webhook.secret.startswith("whsec_")
    yield webhook.state, webhook.events, webhook.url
    assert do(scene.webhooks.list) == (do(webhook.refresh),)
    yield do(do(client.webhooks.get, webhook.id).enable).state
    yield do(webhook.delete)
    yield surface.attempt(webhook.refresh)
    yield surface.attempt(scene.webhooks.create, "https://evil.example/", kinds)
    yield surface.attempt(client.webhooks.get, "whk_none")


def rankings(surface: Surface) -> Iterator[Any]:
    client, do, folder = surface.client, surface.do, surface.folder
    scene = do(client.scenes.create, "quarry")
    yield surface.attempt(scene.rank, generator=Orbit())
    yield do(scene.snapshots.latest)
    surface.gateway.model(scene.id)
    near = FramePose.looking_at((3.0, 0.5, 1.0), (0.0, 0.0, 0.0))
    far = FramePose.looking_at((9.0, 0.5, 1.0), (0.0, 0.0, 0.0))
    ranking = do(scene.rank, {"near": near, "far": far}, current_pose=near, radius_m=2.0)
    yield ranking
    yield ranking.best
    yield do(scene.rank, generator=Orbit(count=5), top_k=2)
    scored: list[Any] = []
    same, keyed = {"near": near, "far": far}, {"idempotency_key": f"ranking-{folder.name}"}
    streamed = do(scene.rank, same, on_scored=scored.extend, **keyed)
    yield sorted(scored, key=lambda one: one.id)
    yield streamed
    yield do(client.rankings.get, streamed.id) == streamed
    yield do(scene.rank, same, **keyed) == streamed
    yield surface.attempt(scene.rank, {"near": near}, on_scored=scored.extend, **keyed)
    yield surface.attempt(scene.rank, method="guess", on_scored=scored.extend)
    yield surface.attempt(scene.rank, same, on_scored=_tired)
    yield do(client.rankings.get, ranking.id) == ranking
    yield do(ranking.render, "near")[:8]
    yield surface.attempt(ranking.render, "elsewhere")
    yield surface.attempt(scene.rank, generator=Grid(), method="guess")
    yield do(scene.rank, top_k=2)
    yield do(scene.rank, top_k=1, frame="model").best
    block = Prism(corners=((-5, -5, 0), (5, -5, 0), (5, 5, 0)), lower=3.0, upper=5.0)
    crane = Box(centre=(0.0, 0.0, 4.0), size=(1.0, 1.0, 9.0))
    for more in ({"aim": (0.0, 0.0, 0.5)}, {"look": "nearest", "level": True}):
        inside = InVolume(volume=block, count=6, **more)
        yield do(scene.rank, generator=inside, safety_m=0.2, no_fly=[crane])
    yield do(scene.rank, generator=inside, on_scored=scored.extend)
    yield surface.attempt(scene.rank, generator=Orbit(count=5), safety_m=0.2)
    snapshot = do(scene.snapshots.latest)
    yield surface.items(scene.snapshots.list(), None) == [snapshot]
    yield do(snapshot.cameras)
    yield do(snapshot.render, near)
    small = do(snapshot.render, near, image="spectrum", long_side_px=64, format="jpeg")
    yield small.startswith(b"\xff\xd8")
    yield surface.attempt(snapshot.render, near, format="gif")
    yield do(snapshot.download, "cameras.json", folder).read_bytes()
    yield surface.attempt(snapshot.download, "model.obj", folder)
    yield surface.attempt(client.snapshots.get, "snp_none")


def _tired(_scored: Any) -> None:
    raise FileNotFoundError("This one is good enough.")


def deletions(surface: Surface) -> Iterator[Any]:
    client, do = surface.client, surface.do
    scene = do(client.scenes.create, "quarry", retention=Retention(snapshots=3))
    yield scene
    yield [one.name for one in surface.items(client.scenes.list(search="QUARR"), None)]
    yield do(scene.change, name="pit", retention=Retention(snapshot_days=2.5))
    yield surface.attempt(scene.change)
    yield surface.attempt(scene.change, name="shaft", if_unchanged=True)
    yield surface.attempt(scene.delete, if_unchanged=True)
    yield do(do(scene.refresh).change, name="shaft", if_unchanged=True).name
    for _ in range(2):
        surface.gateway.model(scene.id)
    second, first = surface.items(scene.snapshots.list(), None)
    yield do(first.pin).pinned
    yield surface.attempt(first.delete)
    yield do(first.unpin).pinned
    yield do(first.delete)
    yield surface.attempt(second.delete)
    yield do(surface.items(scene.jobs.list(), None)[-1].snapshot)
    ranking = do(scene.rank, generator=Orbit(count=5))
    yield do(ranking.delete)
    yield surface.attempt(client.rankings.get, ranking.id)
    yield do(scene.size)
    yield do(scene.delete)
    yield surface.attempt(scene.refresh)
    yield surface.attempt(scene.delete)


def missions(surface: Surface) -> Iterator[Any]:
    client, do = surface.client, surface.do
    origin = Origin(latitude_deg=46.02, longitude_deg=7.75, altitude_m=500.0)
    home = {"home_latitude_deg": 46.02, "home_longitude_deg": 7.75, "home_altitude_m": 495.0}
    scene = do(client.scenes.create, "quarry", world=EnuWorld(origin=origin))
    surface.gateway.model(scene.id, alignment=Alignment(status="aligned", scale=10.0))
    ranking = do(scene.rank, generator=Orbit(count=4))
    for name in do(client.capabilities).mission_formats:
        yield do(ranking.mission, name, **home, takeoff=False, autopilot="px4")
    yield do(ranking.mission, MissionFormat.QGC_WPL, autopilot="px4", finish=Finish.HOLD, first=1)
    yield do(ranking.mission, "csv", **home, highest_height_m=20.0, leave_out=True)
    yield surface.attempt(ranking.mission, "csv", **home, highest_height_m=1.0)
    yield surface.attempt(ranking.mission, "csv", altitude_datum="ellipsoid")
    plan = do(scene.plan, generator=Orbit(count=8, height_m=30.0), views=3, home=True)
    file = do(scene.mission, plan.tours[0], "geojson", **home, leave_out=True)
    yield file
    folder = surface.folder / "missions"
    folder.mkdir()
    path = file.save(folder)
    yield path.relative_to(folder).name.split(".")[1:], path.read_bytes() == file.content
    yield file.save(folder / "another.json").name
    poses = {stop.id: stop.pose for stop in plan.stops}
    yield do(scene.mission, poses, "csv", snapshot_id=plan.snapshot_id)
    yield do(scene.mission, plan.stops, "csv", leave_out=True)
    yield do(scene.mission, [one for one in ranking.candidates if one.rank], "csv", leave_out=True)
    yield do(plan.mission, "csv", leave_out=True).content
    yield do(plan.mission, "csv", battery_s=1000.0, battery_reserve=0.2, part=1, **home)
    yield surface.attempt(plan.mission, "csv", vehicle=3)
    yield [one.id for one in surface.items(scene.plans.list(), None)] == [plan.id]
    yield [one.id for one in surface.items(scene.rankings.list(), None)] == [ranking.id]
    yield do(client.plans.get, plan.id) == plan
    yield do(plan.delete)
    yield surface.attempt(client.plans.get, plan.id)
    yield surface.attempt(scene.mission, {}, "csv")


SCENARIOS = (scenes, images, jobs, webhooks, rankings, missions, deletions)


@pytest.mark.parametrize("scenario", SCENARIOS, ids=lambda scenario: scenario.__name__)
def test_all_clients_answer_alike(
    gateway: Any, url: str, tmp_path: Path, photograph: Callable[..., bytes], scenario: Any
) -> None:
    folders = [tmp_path / name for name in ("blocking", "awaiting")]
    for folder in folders:
        folder.mkdir()
        for number, name in enumerate(("a.jpg", "b.jpg")):
            (folder / name).write_bytes(photograph(number))

    def play(surface: Surface, folder: Path) -> list[str]:
        surface.gateway, surface.folder = gateway, folder
        return anonymous([plain(answer) for answer in scenario(surface)], folder)

    answers = []
    for folder in folders:
        if folder.name == "blocking":
            with Client(url, retries=RETRIES) as client:
                answers.append(play(on_client(client), folder))
        else:
            with start_blocking_portal() as portal:
                awaiting = portal.call(functools.partial(AsyncClient, url, retries=RETRIES))
                answers.append(play(on_async_client(awaiting, portal), folder))
                portal.call(awaiting.close)
    assert answers[1] == answers[0]


def on_client(client: Client) -> Surface:
    def items(found: Any, most: int | None) -> list[Any]:
        return [item for item, _ in zip(found, range(most or 10_000), strict=False)]

    return Surface(client, lambda function, *args, **options: function(*args, **options), items)


def on_async_client(client: AsyncClient, portal: Any) -> Surface:
    async def take(found: Any, most: int | None) -> list[Any]:
        taken: list[Any] = []
        async for item in found:
            taken.append(item)
            if len(taken) == most:
                break
        await found.aclose()
        return taken

    return Surface(
        client,
        lambda function, *args, **options: portal.call(functools.partial(function, *args, **options)),
        lambda found, most: portal.call(take, found, most),
    )


def facts(data: dict[str, Any]) -> Iterator[tuple[str, Any]]:
    """The data of an event; JSON has no order."""
    for name, value in data.items():
        yield name, sorted(facts(value)) if isinstance(value, dict) else value


def plain(value: Any) -> str:
    """What a client answered with all its fields, without what says which client it was."""
    if isinstance(value, pydantic.BaseModel):
        return f"{type(value).__name__}{value.model_dump()}".replace("Async", "")
    return f"[{', '.join(map(plain, value))}]" if isinstance(value, list | tuple) else repr(value)


def anonymous(answers: list[str], folder: Path) -> list[str]:
    """``answers`` without what differs between any two runs: ids, times, the folder."""
    names: dict[str, str] = {}

    def numbered(found: re.Match[str]) -> str:
        return names.setdefault(found[0], f"{found[1]}#{len(names)}")

    text = "\n---\n".join(answers).replace(str(folder), "FOLDER")
    text = re.sub(r"\b(scn|job|snp|rnk|pln)_[0-9a-zA-Z]{8,}", numbered, text)
    text = re.sub(r"datetime\.datetime\([^()]*(\([^()]*\))?[^()]*\)", "TIME", text)
    text = re.sub(r"TzInfo\([^)]*\)", "UTC", text)
    text = re.sub(r"'etag': '[0-9a-f]+'", "'etag': ONE", text)
    text = re.sub(r"\b(number|seconds)=[0-9.e-]+", r"\1=N", text)
    return text.split("\n---\n")


GENERATOR = Path(__file__).resolve().parents[2] / "clients" / "generate_sync.py"


@pytest.mark.process
def test_the_synchronous_client_is_current() -> None:
    checked = subprocess.run(
        [sys.executable, GENERATOR, "--check"], capture_output=True, text=True, check=False
    )
    assert checked.returncode == 0, checked.stderr


def test_everything_public_can_be_imported() -> None:
    assert all(hasattr(fvs_client, name) for name in fvs_client.__all__)
