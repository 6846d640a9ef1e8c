"""The frame of the page: keys, versions, a service that is away."""

import json
import re
from pathlib import Path

from fvs_client import Client
from fvs_service.application import open_storage
from fvs_service.serving.running import RunningService, running_service
from fvs_service.settings import Settings
from playwright.sync_api import Page, Route, expect
from watched_pages import Opener

SMALL = {"FVS_INSPECTORS": "1", "FVS_GRPC_PORT": "0"}


def test_a_key_is_asked_for_once_and_again_when_it_is_revoked(open_page: Opener, tmp_path: Path) -> None:
    root = tmp_path / "root"
    with open_storage(Settings(root=root)) as storage:
        keys = [storage.keys.create("the operator"), storage.keys.create("the operator's next")]
        with (
            running_service(root, tmp_path / "service.log", SMALL) as service,
            Client(service.url, api_key=keys[0]) as client,
        ):
            client.scenes.create("quarry")
            page, watch = open_page(service.url)
            watch.allow("status of 401")
            _use_key(page, keys[0])
            expect(page.get_by_role("link", name="quarry")).to_be_visible()
            page.reload()
            expect(page.get_by_role("link", name="quarry")).to_be_visible()
            assert _where_kept(page, keys[0]) == ["fvs-api-key"]
            assert keys[0] not in page.url
            (first,) = (key for key in storage.keys.all() if key.name == "the operator")
            storage.keys.revoke(first.id)
            page.get_by_role("link", name="quarry").click()
            _use_key(page, keys[1])
            expect(page.get_by_role("heading", name="quarry")).to_be_visible()
            expect(page.get_by_text("Live")).to_be_visible()
            assert _where_kept(page, keys[0]) == []
            assert _where_kept(page, keys[1]) == ["fvs-api-key"]
            open_page.close()


def _use_key(page: Page, key: str) -> None:
    dialog = page.get_by_role("dialog")
    dialog.get_by_label("Key").fill(key)
    dialog.get_by_role("button", name="Use this key").click()
    expect(dialog).to_be_hidden()


def _where_kept(page: Page, key: str) -> list[str]:
    """The names in the session's storage whose values have the key; fails where it outlives the session."""
    stores = page.evaluate("() => [{...sessionStorage}, {...localStorage}]")
    assert key not in str(stores[1])
    assert key not in str(page.context.cookies())
    return [name for name, value in stores[0].items() if key in value]


def test_a_service_that_starts_again_is_followed_again(open_page: Opener, tmp_path: Path) -> None:
    root, log = tmp_path / "root", tmp_path / "service.log"
    with running_service(root, log, SMALL) as service, Client(service.url) as client:
        scene = client.scenes.create("quarry")
        page, watch = open_page(service.url, f"#/scenes/{scene.id}")
        watch.allow("net::ERR|Failed to load resource")
        expect(page.get_by_text("Live")).to_be_visible()
    expect(page.get_by_text("The service is away; trying again …")).to_be_visible()
    port = int(service.url.rsplit(":", 1)[1])
    with running_service(root, log, SMALL, port=port), Client(service.url) as client:
        expect(page.get_by_text("Live")).to_be_visible()
        client.scenes.get(scene.id).delete()
        expect(page.get_by_role("heading", name="This scene was deleted.")).to_be_visible()
        open_page.close()


def test_another_version_of_the_service_is_said(open_page: Opener, console_service: RunningService) -> None:
    page, _ = open_page(console_service.url)

    def answer(route: Route) -> None:
        fetched = route.fetch()
        route.fulfill(response=fetched, body=json.dumps({**fetched.json(), "version": "9.9.9"}))

    page.route("**/v1/capabilities", answer)
    page.reload()
    notice = page.get_by_text(re.compile("The service is version 9.9.9, and this page was made for version"))
    expect(notice).to_contain_text("Load the page again.")


def test_a_scene_that_is_not_there_is_said(open_page: Opener, console_service: RunningService) -> None:
    page, watch = open_page(console_service.url, "#/scenes/scn_absent")
    watch.allow("status of 40[04]")
    expect(page.get_by_role("link", name="Back to all scenes")).to_be_visible()
