"""From a model to a mission file: rank, look, draw an area, plan, prepare, download."""

import json
import re
from pathlib import Path

from fvs_client import Scene
from fvs_service.serving.running import RunningService
from playwright.sync_api import Page, expect
from watched_pages import Opener

TAKE_PHOTOGRAPH = 203
"""``MAV_CMD_DO_DIGICAM_CONTROL``, by which ArduPilot takes one."""
STAGE = "What is shown"


def _open(page: Page, tabs: str, name: str) -> None:
    page.get_by_role("navigation", name=tabs).get_by_role("link", name=name).click()


def test_from_a_model_to_a_mission(
    open_page: Opener, console_service: RunningService, courtyard: Scene, tmp_path: Path
) -> None:
    page, _ = open_page(console_service.url, f"#/scenes/{courtyard.id}/view3d/views")
    _rank(page)
    _look_through_the_first(page)
    _open(page, STAGE, "Map")
    _draw_an_area(page)
    page.get_by_role("button", name="Fly this").click()
    _plan_in_it(page)
    file = _download_the_mission(page, tmp_path)
    mission = json.loads(file.read_text(encoding="utf-8"))
    assert mission["fileType"] == "Plan"
    items = mission["mission"]["items"]
    photographs = [item for item in items if item.get("command") == TAKE_PHOTOGRAPH]
    assert 1 <= len(photographs) <= 3
    assert [item["doJumpId"] for item in items] == list(range(1, len(items) + 1))


def _rank(page: Page) -> None:
    page.get_by_role("button", name="Rank", exact=True).click()
    ranking = page.get_by_role("region", name="Ranking")
    expect(ranking.get_by_role("row").nth(1)).to_contain_text("orbit-", timeout=60_000)
    expect(ranking.get_by_text("24 candidates")).to_be_visible()


def _look_through_the_first(page: Page) -> None:
    page.get_by_role("region", name="Ranking").get_by_role("row").nth(1).click()
    page.get_by_role("button", name="Look through").first.click()
    expect(page.get_by_role("button", name="Leave")).to_be_visible()


def _draw_an_area(page: Page) -> None:
    canvas = page.locator(".map-canvas")
    page.get_by_role("group", name="Draw").get_by_role("button", name="Area").click()
    box = canvas.bounding_box()
    assert box is not None
    for across, down in ((0.5, 0.4), (0.75, 0.4), (0.75, 0.7), (0.5, 0.7)):
        page.mouse.click(box["x"] + across * box["width"], box["y"] + down * box["height"])
    page.get_by_role("button", name="Finish").click()
    expect(page.get_by_role("region", name="Area")).to_contain_text("m²")


def _plan_in_it(page: Page) -> None:
    expect(page.get_by_role("combobox", name="Candidates")).to_have_value("drawing")
    page.get_by_label("Photographs, at most").fill("3")
    page.get_by_role("button", name="Plan", exact=True).click()
    expect(page.get_by_text(re.compile(r"Vehicle 1: [123] photographs?, "))).to_be_visible(timeout=60_000)


def _download_the_mission(page: Page, folder: Path) -> Path:
    mission = page.get_by_role("region", name="Mission")
    mission.get_by_label("What is flown").select_option("plan")
    mission.get_by_role("button", name="Prepare the files").click()
    expect(mission.get_by_text("1 file with")).to_be_visible(timeout=60_000)
    with page.expect_download() as download:
        mission.get_by_role("button", name="Download", exact=True).click()
    file = folder / download.value.suggested_filename
    download.value.save_as(file)
    assert file.suffix == ".plan"
    return file
