"""``fvs-client webhooks``."""

import json
from collections.abc import Callable

from fvs_client import Client
from typer.testing import Result

Run = Callable[..., Result]


def test_webhooks_are_created_listed_and_deleted(run: Run, client: Client) -> None:
    scene_id = client.scenes.create("quarry").id
    create = ["webhooks", "create", scene_id, "https://hooks.example/a", "--event", "job.failed"]
    webhook, secret = run(*create).stdout.split()
    assert secret.startswith("whsec_")
    again = json.loads(run(*create, "--event", "scene.deleted", "--json").stdout)
    assert again["events"] == ["job.failed", "scene.deleted"]
    listed = json.loads(run("webhooks", "list", scene_id, "--json").stdout)["webhooks"]
    assert [item["id"] for item in listed] == [webhook, again["id"]]
    assert "secret" not in listed[0]
    assert "active" in run("webhooks", "list", scene_id).stdout
    assert run("webhooks", "enable", webhook).stdout == f"{webhook} is active, 0 events wait\n"
    run("webhooks", "delete", webhook, "--yes")
    assert webhook not in run("webhooks", "list", scene_id).stdout
    wrong = run("webhooks", "create", scene_id, "https://evil.example", "--event", "job.failed", expect=3)
    assert "FVS_WEBHOOK_HOSTS" in wrong.stderr
