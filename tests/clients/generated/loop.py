"""The loop through the client that openapi-python-client generates: from photographs to a mission."""

import base64
import hashlib
import io
import sys
import time
from pathlib import Path
from typing import TypeVar

from fvs_rest import AuthenticatedClient
from fvs_rest.api.images import list_images, upload_image, upload_images
from fvs_rest.api.jobs import create_job, get_job
from fvs_rest.api.missions import create_mission
from fvs_rest.api.plans import plan_views
from fvs_rest.api.rankings import rank_views, render_candidate
from fvs_rest.api.scenes import create_scene
from fvs_rest.api.uploads import append_to_upload, create_upload
from fvs_rest.models import (
    FramePose,
    Image,
    ImageList,
    Job,
    JobKind,
    JobRequest,
    JobState,
    MissionFormat,
    MissionRequest,
    MissionView,
    Orbit,
    Plan,
    PlanRequest,
    Ranking,
    RankingRequest,
    Scene,
    SceneRequest,
    UploadAnswer,
    UploadImagesBody,
    ViewImage,
)
from fvs_rest.types import File

T = TypeVar("T")


def a(kind: type[T], answer: object) -> T:
    """The answer, if it is what was asked for; else it is a problem, with a hint."""
    if not isinstance(answer, kind):
        raise SystemExit(f"not a {kind.__name__}: {answer}")
    return answer


def send(client: AuthenticatedClient, scene: str, photographs: list[Path]) -> None:
    """Send photographs: one as a form, one in parts (tus), the others by their digests."""
    form, parts, *others = photographs
    body = UploadImagesBody(file=[File(io.BytesIO(form.read_bytes()), form.name, "image/jpeg")])
    a(UploadAnswer, upload_images.sync(scene, client=client, body=body))

    content = parts.read_bytes()
    metadata = {"scene": scene, "sha256": hashlib.sha256(content).hexdigest(), "filename": parts.name}
    declared = ",".join(
        f"{key} {base64.b64encode(value.encode()).decode()}" for key, value in metadata.items()
    )
    created = create_upload.sync_detailed(
        client=client, tus_resumable="1.0.0", upload_length=str(len(content)), upload_metadata=declared
    )
    upload, half = created.headers["Location"].rpartition("/")[2], len(content) // 2
    for offset, part in ((0, content[:half]), (half, content[half:])):
        sent = append_to_upload.sync_detailed(
            upload,
            client=client,
            tus_resumable="1.0.0",
            upload_offset=str(offset),
            body=File(io.BytesIO(part)),
        )
        assert sent.status_code == 204, sent.content

    for photograph in others:
        content = photograph.read_bytes()
        digest = hashlib.sha256(content).hexdigest()
        file = File(io.BytesIO(content))
        a(Image, upload_image.sync(scene, digest, client=client, body=file, name=photograph.name))


def loop(url: str, key: str, photographs: list[Path], out: Path) -> None:
    """Photographs become a model, a ranking, a render, a plan and a mission."""
    client = AuthenticatedClient(base_url=url, token=key)
    scene = a(Scene, create_scene.sync(client=client, body=SceneRequest(name="python")))
    send(client, scene.id, photographs)
    images = a(ImageList, list_images.sync(scene.id, client=client)).items
    assert [image.verdict for image in images] == ["accepted"] * len(photographs), images

    job = a(Job, create_job.sync(scene.id, client=client, body=JobRequest(kind=JobKind.UPDATE)))
    while job.state in (JobState.QUEUED, JobState.RUNNING):
        time.sleep(0.5)
        job = a(Job, get_job.sync(job.id, client=client))
    assert job.state == JobState.SUCCEEDED, job.error

    orbit = Orbit(kind="orbit", count=4)
    request = RankingRequest(generator=orbit, top_k=2, rank_all=True)
    ranking = a(Ranking, rank_views.sync(scene.id, client=client, body=request))
    best = ranking.candidates[0]
    assert best.rank == 1, best
    png = a(File, render_candidate.sync(ranking.id, best.id, ViewImage.RENDER, client=client))
    (out / "best.png").write_bytes(png.payload.read())

    plan = a(Plan, plan_views.sync(scene.id, client=client, body=PlanRequest(generator=orbit, views=2)))
    stops = [stop for tour in plan.tours for stop in tour.stops]
    views = [MissionView(id=stop.id, pose=FramePose.from_dict(stop.pose.to_dict())) for stop in stops]
    mission = create_mission.sync_detailed(
        scene.id, client=client, body=MissionRequest(views=views), format_=MissionFormat.NERFSTUDIO
    )
    assert mission.status_code == 200, mission.content
    (out / "mission.json").write_bytes(mission.content)


if __name__ == "__main__":
    url, key, folder, out = sys.argv[1:]
    loop(url, key, sorted(Path(folder).iterdir()), Path(out))
