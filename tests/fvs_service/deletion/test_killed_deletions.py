"""Kill -9 in the middle of commits, deletions, retention and removals: nothing is ever half there.

One process makes and deletes scenes, snapshots and rankings; another one sweeps. Both are killed at random
moments, again and again. Training and HTTP have no part in this, so a kill costs little: run
``python tests/fvs_service/deletion/test_killed_deletions.py 1000`` for more of them.
"""

import contextlib
import hashlib
import os
import random
import signal
import sys
import tempfile
import time
import traceback
from collections.abc import Callable
from datetime import timedelta
from pathlib import Path

import pytest
from fvs_service.application import Storage, open_storage
from fvs_service.deletion.retention import RetentionRules
from fvs_service.deletion.service import Deletions
from fvs_service.doctor.examination import examine
from fvs_service.errors import ConflictError, NotFoundError
from fvs_service.host.worker.sweep import Sweeps
from fvs_service.ids import new_id
from fvs_service.images.uploads import Uploads
from fvs_service.jobs.repository import jobs_of_scene
from fvs_service.jobs.states import submit
from fvs_service.principal import LOCAL_USER
from fvs_service.scenes.lease import Lease
from fvs_service.scenes.repository import scenes_of
from fvs_service.scenes.service import Scenes
from fvs_service.settings import Retention, Settings
from fvs_service.snapshots.service import NewSnapshot
from fvs_service.storage.clock import now
from fvs_service.storage.tables import RankingRow

from fvs_engine.child_process import end_with_parent
from fvs_schema.base import Page
from fvs_schema.jobs import JobKind, JobPage, JobRequest
from fvs_schema.scenes import Alignment, ScenePage, SceneRequest
from fvs_schema.snapshots import SnapshotMetrics

pytestmark = [pytest.mark.process, pytest.mark.slow]

_SCENES = 3
_LONGEST_S = 0.25


def _settings(root: Path) -> Settings:
    return Settings(
        root=root, sweep_s=0.01, removal_grace_s=0.2, retention=Retention(snapshots=3, rankings=2)
    )


def _make_and_delete(storage: Storage, rng: random.Random) -> None:
    """Change something, for ever."""
    scenes = Scenes(storage.database, storage.settings.limits)
    uploads = Uploads(
        storage.settings.uploads,
        keep_s=1.0,
        per_tenant=1,
        spared_s=1.0,
        reserve_bytes=0,
        max_bytes=1,
        max_video_bytes=1,
    )
    deletions = Deletions(storage.database, uploads, storage.settings.removal_grace_s)
    while True:
        known = scenes.all(LOCAL_USER, ScenePage(limit=100)).items
        with contextlib.suppress(ConflictError, NotFoundError):
            if len(known) < _SCENES:
                scenes.create(LOCAL_USER, SceneRequest(name="a"))
                continue
            scene = rng.choice(known)
            listed = storage.snapshots.of_scene(LOCAL_USER, scene.id, Page(limit=100)).items
            match rng.choices(["commit", "rank", "snapshot", "pin", "scene"], [10, 5, 3, 1, 1])[0]:
                case "commit":
                    _commit(storage, scene.id, rng)
                case "rank" if listed:
                    _rank(storage, scene.id, listed[-1].id)
                case "snapshot" if listed:
                    deletions.snapshot(LOCAL_USER, rng.choice(listed).id)
                case "scene":
                    deletions.scene(LOCAL_USER, scene.id)


def _commit(storage: Storage, scene_id: str, rng: random.Random) -> None:
    """Commit a snapshot of three artifacts, of which equal ones are frequent."""
    lease = storage.leases.acquire(scene_id, "tester")
    assert lease is not None
    with storage.database.writing() as session:
        request = JobRequest(kind=JobKind.UPDATE)
        jobs = jobs_of_scene(session, scene_id, JobPage(limit=1_000)).items
        job = next((job for job in jobs if not job.state.ended), None)  # of a process that was killed
        if job is None:
            job = submit(session, new_id("job"), scene_id, LOCAL_USER.tenant_id, request, now())
    try:
        _finish(storage, lease, job.id, rng)
    except BaseException:
        storage.leases.release(lease)
        raise


def _finish(storage: Storage, lease: Lease, job_id: str, rng: random.Random) -> None:
    job = storage.ledger.start(lease, job_id, 1)
    assert job is not None
    folder = storage.settings.scenes / lease.scene_id
    folder.mkdir(parents=True, exist_ok=True)
    files = {name: folder / name for name in ("cameras.json", "point_cloud.ply", "metrics.json")}
    for file in files.values():
        file.write_bytes(bytes([rng.randrange(4)]) * 100)
    metrics = SnapshotMetrics(registered=2, unregistered=0, points=1, iterations=1, gaussians=1, sh_degree=0)
    made = NewSnapshot(metrics, Alignment(), files, (), {})
    storage.snapshots.commit(lease, job, "snapshot", made)
    storage.ledger.succeed(lease, job_id)


def _rank(storage: Storage, scene_id: str, snapshot_id: str) -> None:
    """Add a ranking with a render; only its row and its blob matter here."""
    ranking_id = new_id("rnk")
    with storage.database.writing() as session:
        session.add(
            RankingRow(
                id=ranking_id, scene_id=scene_id, snapshot_id=snapshot_id, document={}, created_at=now()
            )
        )
    storage.blobs.put(b"a render", f"scenes/{scene_id}/rankings/{ranking_id}/x/render.png")


def _sweep(storage: Storage, _rng: random.Random) -> None:
    """Sweep, for ever."""
    sweeps = Sweeps(storage)
    while True:
        sweeps.sweep()
        time.sleep(0.01)


def _start(root: Path, work: Callable[[Storage, random.Random], None], seed: int) -> int:
    """Start a child that works until it is killed; returns its process id once it does."""
    parent = os.getpid()
    ready, tell = os.pipe()
    pid = os.fork()
    if pid == 0:
        end_with_parent(parent)
        try:
            with open_storage(_settings(root)) as storage:
                os.write(tell, b".")
                work(storage, random.Random(seed))
        except BaseException:
            traceback.print_exc()
        finally:
            os._exit(1)  # it must never return into the tests
    os.close(tell)
    os.read(ready, 1)
    os.close(ready)
    return pid


def _check(root: Path) -> None:
    """Every reader finds whole things only, at any time."""
    with open_storage(_settings(root)) as storage:
        with storage.database.reading() as session:
            scenes = scenes_of(session, LOCAL_USER, ScenePage()).items
        for scene in scenes:
            snapshots = storage.snapshots.of_scene(LOCAL_USER, scene.id, Page(limit=100)).items
            assert scene.snapshot_id in {None, *(snapshot.id for snapshot in snapshots)}
            for snapshot in snapshots:
                for artifact in snapshot.artifacts:
                    content = b"".join(storage.snapshots.read(snapshot, artifact.name))
                    assert hashlib.sha256(content).hexdigest() == artifact.sha256


def _kill_again_and_again(root: Path, kills: int, seed: int) -> None:
    with open_storage(_settings(root)):
        pass
    rng = random.Random(seed)
    children = {work: _start(root, work, rng.randrange(1 << 30)) for work in (_make_and_delete, _sweep)}
    for kill in range(kills):
        time.sleep(rng.uniform(0, _LONGEST_S))
        work = rng.choice(list(children))
        os.kill(children[work], signal.SIGKILL)
        _, status = os.waitpid(children[work], 0)
        assert os.WIFSIGNALED(status), "the child had failed by itself"
        if kill % 10 == 0:
            _check(root)
        children[work] = _start(root, work, rng.randrange(1 << 30))
    for pid in children.values():
        os.kill(pid, signal.SIGKILL)
        os.waitpid(pid, 0)
    _check(root)
    with open_storage(_settings(root)) as storage:
        RetentionRules(storage.database, storage.settings.retention, 0).apply()
        Sweeps(storage).remove_working_folders()
        # What a commit that was killed has stored is known, and not an orphan.
        assert [finding.what for finding in examine(storage, timedelta(0)) if not _is_due(finding.kind)] == []


def _is_due(kind: str) -> bool:
    """Kinds that the next sweep ends."""
    return kind in {"half deletion", "unfinished write"}


def test_nothing_is_half_there_whenever_a_process_is_killed(tmp_path: Path) -> None:
    _kill_again_and_again(tmp_path, kills=40, seed=1)


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as folder:
        _kill_again_and_again(Path(folder), int(sys.argv[1]), seed=0)
