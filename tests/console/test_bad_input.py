"""What can go wrong is said in a sentence; the page is never blank."""

import re
from collections.abc import Callable
from pathlib import Path

import pytest
from fvs_client import Client, Scene
from fvs_service.serving.running import RunningService, running_service
from playwright.sync_api import Route, expect
from watched_pages import Opener

ENDLESS = 100_000
NewScene = Callable[[str], Scene]


def test_a_photograph_whose_name_is_html_is_a_photograph(
    open_page: Opener, console_service: RunningService, new_scene: NewScene, photographs: list[Path]
) -> None:
    name = "<img src=x onerror=alert(1)><b>bold.jpg"
    scene = new_scene("<i>markup</i>")
    page, watch = open_page(console_service.url, f"#/scenes/{scene.id}/view3d/photographs")
    expect(page.get_by_role("heading", name="<i>markup</i>")).to_be_visible()
    file = {"name": name, "mimeType": "image/jpeg", "buffer": photographs[0].read_bytes()}
    page.locator("input[type=file]").set_input_files(file)  # type: ignore[arg-type]
    row = page.get_by_role("listbox", name="Photographs").get_by_role("option")
    expect(row).to_contain_text(name)
    row.click()
    expect(page.get_by_role("region", name=name)).to_be_visible()
    assert page.locator("img, b").count() == 0
    assert watch.problems == []


def test_a_file_that_is_no_photograph_is_said(
    open_page: Opener, console_service: RunningService, new_scene: NewScene, photographs: list[Path]
) -> None:
    scene = new_scene("verdicts")
    page, _ = open_page(console_service.url, f"#/scenes/{scene.id}/view3d/photographs")
    torn = photographs[0].read_bytes()[:2000]
    page.locator("input[type=file]").set_input_files(
        [
            {"name": "notes.txt", "mimeType": "text/plain", "buffer": b"no photograph"},
            {"name": "torn.jpg", "mimeType": "image/jpeg", "buffer": torn},
        ]
    )
    expect(page.get_by_text("notes.txt is not a photograph, and is not sent.")).to_be_visible()
    row = page.get_by_role("listbox", name="Photographs").get_by_role("option")
    expect(row).to_contain_text("torn.jpg")
    expect(row).to_contain_text("Unreadable")


@pytest.mark.parametrize("stage", ["view3d", "map", "compare"])
def test_a_scene_without_a_model_says_what_to_do(
    open_page: Opener, console_service: RunningService, new_scene: NewScene, stage: str
) -> None:
    scene = new_scene("empty")
    page, _ = open_page(console_service.url, f"#/scenes/{scene.id}/{stage}/photographs")
    expect(page.get_by_role("heading", name="No photographs yet")).to_be_visible()
    for panel in ("Next views", "Missions", "Work"):
        page.get_by_role("navigation", name="What is done").get_by_role("link", name=panel).click()
        expect(page.locator(".panel")).to_contain_text("odel")
        expect(page.locator(".stage")).not_to_have_text("")


def test_a_job_is_cancelled_and_retried(
    open_page: Opener, console_service: RunningService, new_scene: NewScene, photographs: list[Path]
) -> None:
    scene = new_scene("long")
    scene.images.upload(photographs[:8])
    scene.update(iterations=ENDLESS)
    page, _ = open_page(console_service.url, f"#/scenes/{scene.id}/view3d/work")
    job = page.get_by_role("article", name="Update")
    job.get_by_role("button", name="Cancel").click()
    page.get_by_role("dialog").get_by_role("button", name="Cancel the job").click()
    expect(job).to_contain_text("Cancelled", timeout=60_000)
    job.get_by_role("button", name="Retry").click()
    expect(job.get_by_role("button", name="Cancel")).to_be_visible()
    scene.delete()
    expect(page.get_by_role("heading", name="This scene was deleted.")).to_be_visible()


def test_a_model_that_is_deleted_under_the_page_leaves_the_newest(
    open_page: Opener, console_service: RunningService, courtyard: Scene
) -> None:
    oldest = list(courtyard.snapshots.list())[-1]
    newest = courtyard.snapshots.latest()
    assert newest is not None
    assert oldest.id != newest.id
    page, watch = open_page(console_service.url, f"#/scenes/{courtyard.id}/view3d/work")
    watch.allow("status of 404")  # what the page still asks of the deleted model
    models = page.locator(".snapshot-card")
    models.last.get_by_role("button", name="Show the model of").click()
    expect(models.last).to_contain_text("shown")
    oldest.delete()
    expect(models.first).to_contain_text("shown")
    expect(page.get_by_text("The shown model was deleted; the newest is shown.")).to_be_visible()


def test_ten_thousand_candidates_are_refused_with_the_limit(
    open_page: Opener, console_service: RunningService, courtyard: Scene
) -> None:
    page, watch = open_page(console_service.url, f"#/scenes/{courtyard.id}/view3d/views")
    watch.allow("status of 4")
    page.get_by_role("combobox", name="Candidates").select_option("grid")
    page.get_by_text("More settings").click()
    page.get_by_label("Columns").fill("100")
    page.get_by_label("Rows").fill("100")
    page.get_by_role("button", name="Rank", exact=True).click()
    expect(page.get_by_role("alert")).to_contain_text(re.compile("10,?000.*2,?000"))
    expect(page.get_by_role("button", name="Rank", exact=True)).to_be_enabled()


def test_a_map_without_network_is_a_map(open_page: Opener, tmp_path: Path, photographs: list[Path]) -> None:
    tiles = {"FVS_BASEMAP__TILES": "https://tiles.example/{z}/{x}/{y}.png"}
    settings = {"FVS_INSPECTORS": "1", "FVS_GRPC_PORT": "0", **tiles}
    with (
        running_service(tmp_path / "root", tmp_path / "service.log", settings) as service,
        Client(service.url) as client,
    ):
        scene = client.scenes.create("offline")
        scene.images.upload(photographs[:2])
        page, watch = open_page(service.url, f"#/scenes/{scene.id}/map/photographs")
        watch.allow("tiles.example|net::ERR_NAME_NOT_RESOLVED")
        expect(
            page.get_by_text("The map's background cannot be loaded; everything else works.")
        ).to_be_visible()
        expect(page.get_by_role("group", name="Draw").get_by_role("button", name="Area")).to_be_enabled()
        open_page.close()


def test_a_part_that_an_upgrade_took_away_is_told(
    open_page: Opener, console_service: RunningService, new_scene: NewScene
) -> None:
    scene = new_scene("upgraded")
    page, watch = open_page(console_service.url, f"#/scenes/{scene.id}/view3d/photographs")
    watch.allow("status of 404")

    def gone(route: Route) -> None:
        route.fulfill(status=404, json={"detail": "The console has no such file."})

    page.route(re.compile("/console/assets/map-view.*js$"), gone)
    page.get_by_role("link", name="Map").click()
    expect(page.get_by_text("This part of the page cannot be loaded.")).to_be_visible()
    page.unroute_all()
    page.get_by_role("button", name="Load the page again").click()
    expect(page.get_by_text("There is nothing to show yet")).to_be_visible()
