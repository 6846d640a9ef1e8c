"""The same scenario directly, over REST and over gRPC: the same results, and the same errors."""

from collections.abc import Callable
from typing import Any

from contract_scenarios import ORIGIN, Compare, model_of, refused
from fvs_service.principal import Scope

from fvs_engine.wording import hint, notice, sentence
from fvs_schema.findings import Finding, FindingCode, Severity

UNKNOWN = "scn_01m000000000000000000000zz"
NOTHING = f"sha256:{'0' * 64}"


def test_a_scene_is_created_read_changed_listed_and_deleted(compare: Compare) -> None:
    def scenario(tenant: Any) -> None:
        request = {
            "name": "castle",
            "world": {"kind": "enu", "origin": ORIGIN},
            "camera": {"width_px": 4000, "focal_length_px": 3000.0},
            "policy": {"trigger": "every-k-images", "k": 5},
            "retention": {"snapshots": 3, "ranking_days": 1.5},
        }
        scene = tenant.call("CreateScene", request, idempotency_key="one").result["id"]
        assert tenant.call("CreateScene", request, idempotency_key="one").result["id"] == scene
        refused(tenant.call("CreateScene", {"name": "b"}, idempotency_key="one"), "idempotency-key-reused")
        tenant.scene(world={"kind": "local"})
        tenant.call("GetScene", scene_id=scene)
        tenant.call("ChangeScene", {"name": "keep", "policy": {"k": 2}}, scene_id=scene)
        tenant.call("GetSceneSize", scene_id=scene)
        first = tenant.call("ListScenes", limit=1).result
        assert len(tenant.call("ListScenes", limit=1, after=first["next"]).result["items"]) == 1
        assert [one["id"] for one in tenant.call("ListScenes", name="keep").result["items"]] == [scene]
        for wrong in ({"after": "zzz"}, {"name": "keep", "after": first["next"]}):
            assert refused(tenant.call("ListScenes", **wrong), "invalid-request").fields == ("after",)
        tag = tenant.call("GetScene", scene_id=scene).result["etag"]
        changed = tenant.call("ChangeScene", {"name": "tower"}, scene_id=scene, etag=tag).result
        assert changed["etag"] != tag
        for name, body in (("ChangeScene", {"name": "moat"}), ("DeleteScene", None)):
            refused(tenant.call(name, body, scene_id=scene, etag=tag), "precondition-failed")
        tenant.call("DeleteScene", scene_id=scene, etag=changed["etag"])
        refused(tenant.call("GetScene", scene_id=scene), "not-found")
        refused(tenant.call("DeleteScene", scene_id=scene, etag=tag), "not-found")

    compare(scenario)


def test_webhooks_are_created_read_enabled_and_deleted(compare: Compare) -> None:
    def scenario(tenant: Any) -> None:
        scene = tenant.scene()
        request = {"url": "https://hooks.example/a", "events": ["job.failed", "scene.deleted"]}
        made = tenant.call("CreateWebhook", request, scene_id=scene).result
        assert made["secret"].startswith("whsec_")
        webhook = made["id"]
        assert tenant.call("GetWebhook", webhook_id=webhook).result["events"] == request["events"]
        assert len(tenant.call("ListWebhooks", scene_id=scene).result["webhooks"]) == 1
        assert tenant.call("EnableWebhook", webhook_id=webhook).result["state"] == "active"
        tenant.call("DeleteWebhook", webhook_id=webhook)
        refused(tenant.call("GetWebhook", webhook_id=webhook), "not-found")
        refused(tenant.call("CreateWebhook", request, scene_id=UNKNOWN), "not-found")
        for wrong in ({"url": "https://evil.example/"}, {"url": "ftp://a"}):
            refused(tenant.call("CreateWebhook", {**request, **wrong}, scene_id=scene), "invalid-request")

    compare(scenario)


def test_invalid_requests_are_pointed_at(compare: Compare) -> None:
    def scenario(tenant: Any) -> None:
        for request in (
            {},
            {"name": "a\nb"},
            {"name": "a", "world": {"kind": "enu", "origin": {"latitude_deg": 91.0, "longitude_deg": 0.0}}},
            {"name": "a", "camera": {"width_px": 100, "focal_length_px": 1.0}},
            {"name": "a", "policy": {"k": 0}},
        ):
            refused(tenant.call("CreateScene", request), "invalid-request")
        scene = tenant.scene()
        refused(tenant.call("ChangeScene", {}, scene_id=scene), "invalid-request")
        refused(
            tenant.call("CreateJob", {"kind": "update", "test_every": 8}, scene_id=scene), "invalid-request"
        )

    compare(scenario)


def test_images_are_uploaded_once_judged_and_listed(
    compare: Compare, photograph: Callable[..., bytes]
) -> None:
    def scenario(tenant: Any) -> None:
        scene, content = tenant.scene(), photograph(1)
        image = tenant.upload(
            scene, content, name="one.jpg", latitude_deg=48.0, longitude_deg=7.0, altitude_m=9.0
        )
        digest = image.result["digest"]
        assert image.result["verdict"] == "accepted"
        assert tenant.upload(scene, content).result["number"] == image.result["number"]
        assert tenant.upload(scene, photograph(1, image_format="PNG")).result["verdict"] == "accepted"
        unreadable = tenant.upload(scene, b"not an image").result
        assert unreadable["verdict"] == "unreadable"
        assert tenant.upload(scene, photograph(2, size=(8, 8))).result["verdict"] == "too-small"
        refused(tenant.upload(scene, photograph(3), digest=NOTHING), "digest-mismatch")
        refused(tenant.upload(scene, photograph(3), x_m=1.0, y_m=1.0, z_m=1.0), "invalid-request")
        digests = [unreadable["digest"], digest, NOTHING]
        checked = tenant.call("CheckImages", {"digests": digests}, scene_id=scene).result
        assert checked["known"] == digests[:2]
        assert [image["verdict"] for image in checked["images"]] == ["unreadable", "accepted"]
        tenant.call("GetImage", scene_id=scene, digest=digest)
        assert tenant.call("GetThumbnail", scene_id=scene, digest=digest).result.startswith(b"\xff\xd8")
        assert tenant.call("ExcludeImage", scene_id=scene, digest=digest).result["registration"] == "excluded"
        tenant.call("IncludeImage", scene_id=scene, digest=digest)
        assert tenant.call("RemoveMask", scene_id=scene, digest=digest).result["mask"] is None
        tenant.call("ListImages", scene_id=scene, limit=2)
        tenant.call("DeleteImage", scene_id=scene, digest=digest)
        for call in ("GetImage", "GetThumbnail"):
            refused(tenant.call(call, scene_id=scene, digest=digest), "not-found")
        refused(tenant.call("ListImages", scene_id=scene, after="x"), "invalid-request")

    compare(scenario)


def test_a_full_scene_takes_no_more_images(compare: Compare, photograph: Callable[..., bytes]) -> None:
    def scenario(tenant: Any) -> None:
        scene = tenant.scene()
        for number in range(6):
            tenant.upload(scene, b"%d" % number)
        refused(tenant.upload(scene, photograph(4)), "conflict")

    compare(scenario)


def test_jobs_are_queued_once_canceled_and_retried(compare: Compare) -> None:
    def scenario(tenant: Any) -> None:
        scene = tenant.scene()
        job = tenant.call("CreateJob", {"kind": "update"}, scene_id=scene).result["id"]
        assert tenant.call("CreateJob", {"kind": "update"}, scene_id=scene).result["id"] == job
        refused(tenant.call("CreateJob", {"kind": "update", "iterations": 5}, scene_id=scene), "conflict")
        refused(tenant.call("CreateJob", {"kind": "fine"}, scene_id=scene), "conflict")
        tenant.call("GetJob", job_id=job)
        tenant.call("GetJob", job_id=job, wait_s=0.05)
        refused(tenant.call("GetJob", job_id="job_none", wait_s=5.0), "not-found")
        assert tenant.call("CancelJob", job_id=job).result["state"] == "canceled"
        assert tenant.call("RetryJob", job_id=job).result["attempt"] == 2
        refused(tenant.call("RetryJob", job_id=job), "conflict")
        for states, count in (((), 1), (("queued",), 1), (("queued", "failed"), 1), (("canceled",), 0)):
            listed = tenant.call("ListJobs", scene_id=scene, state=states).result
            assert [one["id"] for one in listed["items"]] == [job] * count
        tenant.call("CreateJob", {"kind": "update"}, scene_id=tenant.scene())
        refused(tenant.call("CreateJob", {"kind": "update"}, scene_id=tenant.scene()), "limit-exceeded")

    compare(scenario)


def test_a_failed_job_says_why(compare: Compare) -> None:
    def scenario(tenant: Any) -> None:
        scene = tenant.scene()
        job = tenant.call("CreateJob", {"kind": "update"}, scene_id=scene).result["id"]
        storage, lease = tenant.gateway.application.storage, tenant.gateway.lease(scene)
        storage.ledger.start(lease, job, 1)
        storage.ledger.fail(lease, job, _job_error())
        storage.leases.release(lease)
        failed = tenant.call("GetJob", job_id=job).result
        assert failed["state"] == "failed"
        assert failed["error"]["code"] == "too-few-images"

    compare(scenario)


def test_a_warning_of_a_job_carries_its_code(compare: Compare) -> None:
    def scenario(tenant: Any) -> None:
        scene = tenant.scene()
        job = tenant.call("CreateJob", {"kind": "update"}, scene_id=scene).result["id"]
        storage, lease = tenant.gateway.application.storage, tenant.gateway.lease(scene)
        storage.ledger.start(lease, job, 1)
        crash = Finding.of(
            FindingCode.QUARANTINED, ["a.jpg"], Severity.DOUBT, stage="match", how="SIGSEGV", of=12
        )
        storage.ledger.warn(lease, job, notice(crash))
        storage.ledger.succeed(lease, job)
        storage.leases.release(lease)
        (warning,) = tenant.call("GetJob", job_id=job).result["warnings"]
        assert (warning["code"], warning["severity"]) == ("quarantined", "doubt")
        assert (warning["images"], warning["numbers"]) == (["a.jpg"], {"of": 12})
        assert warning["texts"] == {"stage": "match", "how": "SIGSEGV"}
        assert (warning["message"], warning["hint"]) == (sentence(crash), hint(crash))

    compare(scenario)


def _job_error() -> Any:
    from fvs_schema.jobs import JobFailure

    return JobFailure(
        code="too-few-images",
        message="There are too few.",
        hint="Send more.",
        retryable=False,
        stage="matching",
    )


def test_snapshots_are_listed_pinned_and_deleted(compare: Compare) -> None:
    def scenario(tenant: Any) -> None:
        scene = tenant.scene()
        snapshot = model_of(tenant, scene)
        listed = tenant.call("ListSnapshots", scene_id=scene).result["items"]
        assert [one["id"] for one in listed] == [snapshot]
        tenant.call("GetSnapshot", snapshot_id=snapshot)
        assert tenant.call("ChangeSnapshot", {"pinned": True}, snapshot_id=snapshot).result["pinned"]
        refused(tenant.call("DeleteSnapshot", snapshot_id=snapshot), "conflict")
        refused(tenant.call("ChangeSnapshot", {}, snapshot_id=snapshot), "invalid-request")
        refused(tenant.call("GetSnapshot", snapshot_id="snp_none"), "not-found")

    compare(scenario)


def test_foreign_and_unknown_things_answer_alike(compare: Compare) -> None:
    def scenario(tenant: Any) -> None:
        scene = tenant.scene()
        job = tenant.call("CreateJob", {"kind": "update"}, scene_id=scene).result["id"]
        foreign = tenant.gateway.application.storage.keys.create("other", tenant_id=f"{tenant.name}-other")
        for key, scene_id, job_id in ((foreign, scene, job), (tenant.key, UNKNOWN, "job_none")):
            refused(tenant.call("GetScene", scene_id=scene_id, key=key), "not-found")
            refused(tenant.call("ChangeScene", {"name": "a"}, scene_id=scene_id, key=key), "not-found")
            refused(tenant.call("DeleteScene", scene_id=scene_id, key=key), "not-found")
            refused(tenant.call("CreateJob", {"kind": "update"}, scene_id=scene_id, key=key), "not-found")
            refused(tenant.call("RankViews", {}, scene_id=scene_id, key=key), "not-found")
            refused(tenant.call("StreamRankViews", {}, scene_id=scene_id, key=key), "not-found")
            refused(
                tenant.call("CheckImages", {"digests": [NOTHING]}, scene_id=scene_id, key=key), "not-found"
            )
            refused(tenant.upload(scene_id, b"x", key=key), "not-found")
            refused(tenant.call("GetJob", job_id=job_id, key=key), "not-found")
            refused(tenant.call("CancelJob", job_id=job_id, key=key), "not-found")
        refused(tenant.call("GetRanking", ranking_id="rnk_none"), "not-found")

    compare(scenario)


def test_keys_are_needed_valid_and_have_scopes(compare: Compare) -> None:
    def scenario(tenant: Any) -> None:
        scene = tenant.scene()
        for key in (None, "fvs_0000_wrong"):
            refused(tenant.call("GetScene", scene_id=scene, key=key), "unauthenticated")
            refused(tenant.upload(scene, b"x", key=key), "unauthenticated")
        reader = tenant.new_key(scopes=frozenset({Scope.READ}))
        tenant.call("GetScene", scene_id=scene, key=reader)
        refused(tenant.call("CreateScene", {"name": "a"}, key=reader), "forbidden")
        refused(tenant.call("DeleteScene", scene_id=scene, key=reader), "forbidden")
        refused(tenant.call("CreateJob", {"kind": "update"}, scene_id=scene, key=reader), "forbidden")
        refused(tenant.call("RankViews", {}, scene_id=scene, key=reader), "forbidden")
        refused(tenant.call("StreamRankViews", {}, scene_id=scene, key=reader), "forbidden")
        refused(tenant.upload(scene, b"x", key=reader), "forbidden")
        device = tenant.new_key(scene_id=scene)
        tenant.call("GetScene", scene_id=scene, key=device)
        refused(tenant.call("GetScene", scene_id=tenant.scene(), key=device), "not-found")
        refused(tenant.call("CreateScene", {"name": "a"}, key=device), "forbidden")

    compare(scenario)


def test_a_service_without_runners_says_so(compare: Compare) -> None:
    def scenario(tenant: Any) -> None:
        scene = tenant.scene()
        model_of(tenant, scene)
        tenant.gateway.runners.reachable = False
        try:
            refused(tenant.call("RankViews", {}, scene_id=scene), "unavailable")
            refused(tenant.call("StreamRankViews", {}, scene_id=scene), "unavailable")
        finally:
            tenant.gateway.runners.reachable = True

    compare(scenario)


def test_the_capabilities_are_the_same(compare: Compare) -> None:
    compare(lambda tenant: tenant.call("GetCapabilities"))


def test_control_points_are_set_read_and_deleted(compare: Compare) -> None:
    def scenario(tenant: Any) -> None:
        scene = tenant.scene()
        refused(tenant.call("GetControlPoints", scene_id=scene), "not-found")
        mark = {"image": "a.jpg", "x_px": 10.5, "y_px": 4.0}
        points = {
            "crs": "EPSG:32632",
            "points": [
                {"name": "G1", "x": 537653.2, "y": 5260847.4, "z": 410.1, "marks": [mark]},
                {"name": "C1", "x": 537660.0, "y": 5260840.0, "check": True, "marks": []},
            ],
        }
        assert tenant.call("SetControlPoints", points, scene_id=scene).result["points"][0]["marks"] == [mark]
        assert tenant.call("GetControlPoints", scene_id=scene).result["points"][1]["check"]
        origin = tenant.call("GetScene", scene_id=scene).result["origin"]
        assert origin["altitude_datum"] == "sea-level"
        for wrong in (
            {"crs": "EPSG:99999"},
            {"crs": "EPSG:4326"},
            {"altitude_datum": "ellipsoid"},
            {"points": [points["points"][0]] * 2},
            {"points": [{"name": "G1", "x": 0.0, "y": 0.0, "marks": [mark, mark]}]},
        ):
            refused(tenant.call("SetControlPoints", {**points, **wrong}, scene_id=scene), "invalid-request")
        tenant.call("DeleteControlPoints", scene_id=scene)
        refused(tenant.call("GetControlPoints", scene_id=scene), "not-found")
        local = tenant.scene(world={"kind": "local"})
        refused(tenant.call("SetControlPoints", points, scene_id=local), "invalid-request")
        for name, body in (
            ("SetControlPoints", points),
            ("GetControlPoints", None),
            ("DeleteControlPoints", None),
        ):
            refused(tenant.call(name, body, scene_id=UNKNOWN), "not-found")

    compare(scenario)
