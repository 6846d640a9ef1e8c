from typing import Any

import pytest
from fvs_service.errors import StaleLeaseError
from fvs_service.jobs.repository import images_milestone

from fvs_engine.wording import notice
from fvs_schema.findings import Finding, FindingCode
from fvs_schema.jobs import JobFailure, JobState


def _job(gateway: Any, job_id: str) -> dict[str, Any]:
    return gateway.client.get(f"/v1/jobs/{job_id}").json()


def _events(gateway: Any, scene: str) -> list[str]:
    from fvs_service.events.repository import events_after

    with gateway.application.storage.database.reading() as session:
        return [event.kind.value for event in events_after(session, scene, 0)]


def test_a_job_is_queued_once(gateway: Any) -> None:
    scene = gateway.scene()
    answer = gateway.client.post(f"/v1/scenes/{scene}/jobs", json={"kind": "update"})
    assert answer.status_code == 202
    job = answer.json()
    assert answer.headers["location"] == f"/v1/jobs/{job['id']}"
    assert (job["state"], job["progress"], job["attempt"]) == ("queued", 0.0, 1)
    again = gateway.client.post(f"/v1/scenes/{scene}/jobs", json={"kind": "update"})
    assert again.json()["id"] == job["id"]


def test_a_job_that_asks_for_more_than_the_one_that_waits_is_refused(gateway: Any) -> None:
    scene = gateway.scene()
    waiting = gateway.queue(scene)
    path = f"/v1/scenes/{scene}/jobs"
    refused = gateway.client.post(path, json={"kind": "update", "iterations": 50})
    assert (refused.status_code, refused.json()["code"]) == (409, "conflict")
    assert waiting in refused.json()["detail"]
    assert '{"kind":"update"}' in refused.json()["hint"]
    gateway.client.post(f"/v1/jobs/{waiting}:cancel")
    assert gateway.client.post(path, json={"kind": "update", "iterations": 50}).status_code == 202


def test_progress_never_goes_back(gateway: Any) -> None:
    scene = gateway.scene()
    job_id, lease = gateway.queue(scene), gateway.lease(scene)
    ledger = gateway.application.storage.ledger
    assert ledger.start(lease, job_id, 1).state is JobState.RUNNING
    shown = []
    for stage, progress in (("features", 0.2), ("matching", 0.1), ("evidence", 0.5), ("training", 0.4)):
        ledger.report(lease, job_id, stage, progress, eta_s=3.0)
        shown.append((_job(gateway, job_id)["stage"], _job(gateway, job_id)["progress"]))
    assert shown == [("features", 0.2), ("matching", 0.2), ("evidence", 0.5), ("training", 0.5)]
    warning = notice(Finding.of(FindingCode.POSES_LOST, [f"sha256:{'0' * 64}"], of=12, stage="training"))
    ledger.warn(lease, job_id, warning)
    ledger.warn(lease, job_id, warning)
    ledger.succeed(lease, job_id)
    ended = _job(gateway, job_id)
    assert (ended["state"], ended["progress"], ended["eta_s"]) == ("succeeded", 1.0, None)
    assert ended["warnings"] == [warning.model_dump(mode="json")]
    assert warning.code is FindingCode.POSES_LOST
    assert _events(gateway, scene) == ["scene.created", "job.queued", "job.started", "job.succeeded"]


def test_a_queued_job_is_canceled_at_once(gateway: Any) -> None:
    scene = gateway.scene()
    job_id, lease = gateway.queue(scene), gateway.lease(scene)
    answer = gateway.client.post(f"/v1/jobs/{job_id}:cancel")
    assert (answer.status_code, answer.json()["state"]) == (202, "canceled")
    assert gateway.application.storage.ledger.start(lease, job_id, 1) is None


def test_a_running_job_learns_that_it_should_stop(gateway: Any) -> None:
    scene = gateway.scene()
    job_id, lease = gateway.queue(scene), gateway.lease(scene)
    ledger = gateway.application.storage.ledger
    ledger.start(lease, job_id, 1)
    assert not ledger.cancel_requested(job_id)
    assert gateway.client.post(f"/v1/jobs/{job_id}:cancel").json()["state"] == "running"
    assert ledger.cancel_requested(job_id)
    ledger.cancel(lease, job_id)
    assert _job(gateway, job_id)["state"] == "canceled"
    assert gateway.client.post(f"/v1/jobs/{job_id}:cancel").json()["state"] == "canceled"


def test_a_failed_job_says_why_and_is_retried_without_its_finished_stages(gateway: Any) -> None:
    scene = gateway.scene()
    job_id, lease = gateway.queue(scene), gateway.lease(scene)
    ledger = gateway.application.storage.ledger
    ledger.start(lease, job_id, 1)
    ledger.commit_milestone(lease, job_id, "features", {"images": 3})
    ledger.commit_milestone(lease, job_id, "features", {"images": 4})
    error = JobFailure(code="training-failed", message="No.", hint="Try.", retryable=True, stage="training")
    ledger.fail(lease, job_id, error)
    failed = _job(gateway, job_id)
    assert (failed["state"], failed["error"]["code"]) == ("failed", "training-failed")
    retried = gateway.client.post(f"/v1/jobs/{job_id}:retry")
    assert retried.status_code == 202
    job = retried.json()
    assert (job["state"], job["attempt"], job["error"], job["progress"]) == ("queued", 2, None, 0.0)
    assert ledger.milestone(job_id, "features") == {"images": 3}
    assert ledger.start(lease, job_id, 1) is None
    assert ledger.start(lease, job_id, 2).attempt == 2
    refused = gateway.client.post(f"/v1/jobs/{job_id}:retry")
    assert refused.status_code == 409


def test_a_later_update_cannot_change_how_the_model_is_trained(gateway: Any) -> None:
    scene = gateway.scene()
    gateway.model(scene)
    path = f"/v1/scenes/{scene}/jobs"
    for setting in ({"iterations": 50}, {"long_side_px": 400}):
        refused = gateway.client.post(path, json={"kind": "update", **setting})
        assert (refused.status_code, refused.json()["code"]) == (409, "conflict")
        assert next(iter(setting)) in refused.json()["detail"]
        assert "Fine jobs" in refused.json()["hint"]
    assert gateway.client.post(path, json={"kind": "fine", "iterations": 50}).status_code == 202
    assert gateway.client.post(path, json={"kind": "update"}).status_code == 202


def test_a_fine_job_needs_an_update_first(gateway: Any) -> None:
    answer = gateway.client.post(f"/v1/scenes/{gateway.scene()}/jobs", json={"kind": "fine"})
    assert answer.status_code == 409


def test_only_fine_models_keep_images_out_of_their_training(gateway: Any) -> None:
    scene = gateway.scene()
    gateway.model(scene)
    path = f"/v1/scenes/{scene}/jobs"
    refused = gateway.client.post(path, json={"kind": "update", "test_every": 8})
    assert refused.status_code == 422
    assert "fine models" in refused.json()["detail"]
    assert gateway.client.post(path, json={"kind": "fine", "test_every": 1}).status_code == 422
    assert gateway.client.post(path, json={"kind": "fine", "test_every": 8}).status_code == 202


def test_open_jobs_are_limited(open_gateway: Any) -> None:
    gateway = open_gateway(limits={"open_jobs_per_tenant": 1})
    gateway.queue(gateway.scene())
    refused = gateway.client.post(f"/v1/scenes/{gateway.scene()}/jobs", json={"kind": "update"})
    assert refused.status_code == 429
    assert "retry-after" in refused.headers


def test_a_retried_job_counts_as_an_open_one(open_gateway: Any) -> None:
    gateway = open_gateway(limits={"open_jobs_per_tenant": 1})
    canceled = gateway.queue(gateway.scene())
    gateway.client.post(f"/v1/jobs/{canceled}:cancel")
    other = gateway.queue(gateway.scene())
    refused = gateway.client.post(f"/v1/jobs/{canceled}:retry")
    assert (refused.status_code, refused.json()["code"]) == (429, "limit-exceeded")
    gateway.client.post(f"/v1/jobs/{other}:cancel")
    assert gateway.client.post(f"/v1/jobs/{canceled}:retry").status_code == 202


@pytest.mark.parametrize(
    ("policy", "queued_after"),
    [
        ({"trigger": "on-request"}, [0, 0, 0, 0]),
        ({"trigger": "each-image", "first": 2}, [0, 1, 1, 1]),
        ({"trigger": "every-k-images", "k": 2, "first": 3}, [0, 0, 1, 1]),
    ],
)
def test_images_start_updates_as_the_policy_says(
    gateway: Any, photograph: Any, policy: dict[str, Any], queued_after: list[int]
) -> None:
    scene, seen = gateway.scene(policy=policy), []
    for seed in range(len(queued_after)):
        gateway.put(scene, photograph(seed))
        seen.append(len(gateway.client.get(f"/v1/scenes/{scene}/jobs").json()["items"]))
    assert seen == queued_after


def test_images_that_the_running_update_takes_up_start_no_other(gateway: Any, photograph: Any) -> None:
    scene = gateway.scene(policy={"trigger": "every-k-images", "k": 2, "first": 2})
    gateway.model(scene)
    (earlier,) = gateway.client.get(f"/v1/scenes/{scene}/jobs").json()["items"]
    seen = []
    for seed in range(4):
        gateway.put(scene, photograph(seed))
        *jobs, last = gateway.client.get(f"/v1/scenes/{scene}/jobs").json()["items"]
        assert last == earlier
        seen.append(len(jobs))
        if seed == 1:
            ledger, lease = gateway.application.storage.ledger, gateway.lease(scene)
            ledger.start(lease, jobs[0]["id"], 1)
            ledger.commit_milestone(lease, jobs[0]["id"], images_milestone(1), {"last_number": 2})
    assert seen == [0, 1, 1, 2]


def test_a_worker_that_lost_its_lease_changes_nothing(gateway: Any) -> None:
    """Frozen, outlived by its lease, and woken: whatever it writes is refused."""
    storage = gateway.application.storage
    scene = gateway.scene()
    job_id, frozen = gateway.queue(scene), gateway.lease(scene, "frozen")
    storage.ledger.start(frozen, job_id, 1)
    assert storage.leases.acquire(scene, "other") is None
    storage.leases.release(frozen)
    other = gateway.lease(scene, "other")
    assert other.token > frozen.token
    error = JobFailure(code="x", message="x", hint="", retryable=False, stage=None)
    writes = [
        lambda: storage.leases.extend(frozen),
        lambda: storage.ledger.start(frozen, job_id, 1),
        lambda: storage.ledger.report(frozen, job_id, "training", 0.9),
        lambda: storage.ledger.warn(frozen, job_id, notice(Finding.of(FindingCode.UNCALIBRATED))),
        lambda: storage.ledger.commit_milestone(frozen, job_id, "training", {}),
        lambda: storage.ledger.succeed(frozen, job_id),
        lambda: storage.ledger.cancel(frozen, job_id),
        lambda: storage.ledger.fail(frozen, job_id, error),
    ]
    before = _job(gateway, job_id)
    for write in writes:
        with pytest.raises(StaleLeaseError):
            write()
    assert _job(gateway, job_id) == before
    assert storage.ledger.milestone(job_id, "training") is None
    assert storage.ledger.start(other, job_id, 1).id == job_id


def test_a_lease_that_ran_out_can_be_taken(open_gateway: Any) -> None:
    from fvs_service.storage.tables import SceneLeaseRow
    from sqlalchemy import update

    gateway = open_gateway(lease_s=600)
    leases, scene = gateway.application.storage.leases, gateway.scene()
    first = leases.extend(leases.acquire(scene, "one"), endpoint="127.0.0.1:5000")
    assert leases.holder(scene) == first
    assert leases.acquire(scene, "two") is None
    with gateway.application.storage.database.writing() as session:
        session.execute(update(SceneLeaseRow).values(expires_at_ms=1))  # much later
    assert leases.holder(scene) is None
    second = leases.acquire(scene, "two")
    assert second is not None
    assert second.token == first.token + 1
    with pytest.raises(StaleLeaseError):
        leases.extend(first)
