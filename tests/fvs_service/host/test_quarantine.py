"""An image on which the SfM child crashes, sent to the whole service, and a kill while it is searched for."""

import hashlib
import os
import signal
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from PIL import Image

pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]

WORKER = "fvs_service.serving.process worker"
SFM_CHILD = "fvs_engine.sfm.native.child"
DEADLY = "deadly.png"
CRASH = """
import os, signal, sys

if "fvs_engine.sfm.native.child" in sys.orig_argv:
    from fvs_engine.sfm.native import jobs

    find_job = jobs.find_job

    def find_deadly_job(name):
        job = find_job(name)

        def run(request, report):
            if name == "extract" and any("{digest}" in image for image in request.names):
                os.kill(os.getpid(), signal.SIGSEGV)
            return job(request, report)

        return run

    jobs.find_job = find_deadly_job
"""
"""A ``sitecustomize``, which every Python process runs: no image that passes the checks is known to be one.

The names of a scene's files have the beginning of their digest.
"""


def _image(service: Any, scene: str) -> dict[str, Any]:
    items = service.client.get(f"/v1/scenes/{scene}/images").json()["items"]
    return next(item for item in items if item["name"] == DEADLY)


def _kill_in_the_search(service: Any, module: str, searches: int) -> None:
    """Kill a process once ``searches`` SfM children have been seen; most of them are runs of the search."""
    seen: set[int] = set()
    deadline = time.monotonic() + 240
    while len(seen) < searches:
        assert time.monotonic() < deadline
        seen.update(service.processes(SFM_CHILD))
    os.kill(service.processes(module)[0], signal.SIGKILL)


def test_a_deadly_image_is_named_and_the_others_become_a_model(
    serving: Callable[..., Any], tmp_path: Path, courtyard_photographs: list[Path]
) -> None:
    deadly = tmp_path / DEADLY
    Image.new("L", (320, 240), 128).save(deadly)
    digest = hashlib.sha256(deadly.read_bytes()).hexdigest()[:12]
    (tmp_path / "sitecustomize.py").write_text(CRASH.format(digest=digest))
    path = os.pathsep.join([str(tmp_path), *filter(None, [os.environ.get("PYTHONPATH")])])
    with serving(tmp_path / "root", {"FVS_LEASE_S": "5", "PYTHONPATH": path}) as service:
        scene = service.scene()
        service.send(scene, [*courtyard_photographs[:3], deadly, *courtyard_photographs[3:5]])
        assert _image(service, scene)["verdict"] == "accepted"
        update = service.start(scene)
        _kill_in_the_search(service, WORKER, 3)
        job = service.finish(update)
        named = [warning for warning in job["warnings"] if warning["code"] == "quarantined"]
        assert [warning["images"] for warning in named] == [[_image(service, scene)["digest"]]]
        assert DEADLY in named[0]["message"]
        snapshot = service.client.get(f"/v1/scenes/{scene}").json()["snapshot_id"]
        assert service.snapshot(snapshot)["metrics"]["registered"] == 5
        image = _image(service, scene)
        assert image["registration"] == "quarantined"
        assert "SIGSEGV" in image["reason"]
        assert service.rank(scene)["snapshot_id"] == snapshot

        # Included again, it is tried again in the growing model, and quarantined again.
        path = f"/v1/scenes/{scene}/images/{image['digest']}"
        assert service.client.post(f"{path}:include").json()["registration"] == "pending"
        service.send(scene, courtyard_photographs[5:6])
        service.finish(service.start(scene))
        assert _image(service, scene)["registration"] == "quarantined"
        grown = service.client.get(f"/v1/scenes/{scene}").json()["snapshot_id"]
        assert service.snapshot(grown)["metrics"]["registered"] == 6

        assert service.client.delete(path).status_code == 204
        service.send(scene, courtyard_photographs[6:7])
        assert not service.finish(service.start(scene))["warnings"]
