"""The way from a scene to a mission without a mouse."""

from fvs_client import Scene
from fvs_service.serving.running import RunningService
from playwright.sync_api import Locator, Page, expect
from watched_pages import Opener

MOST_STOPS = 200


def _press(page: Page, target: Locator, key: str = "Enter") -> None:
    """Go to a control by Tab, and press a key on it."""
    handle = target.element_handle()
    for _ in range(MOST_STOPS):
        if handle.evaluate("(element) => element === document.activeElement"):
            page.keyboard.press(key)
            return
        page.keyboard.press("Tab")
    raise AssertionError(f"{target} is not reached by Tab")


def _link(page: Page, name: str) -> Locator:
    return page.get_by_role("link", name=name, exact=True)


def test_from_a_scene_to_a_mission_by_keyboard(
    open_page: Opener, console_service: RunningService, courtyard: Scene
) -> None:
    page, _ = open_page(console_service.url)
    _press(page, page.get_by_role("link", name="Skip to the content"))
    _press(page, _link(page, courtyard.name))
    _press(page, _link(page, "Next views"))
    _press(page, page.get_by_role("button", name="Rank", exact=True))
    first = page.get_by_role("region", name="Ranking").get_by_role("row").nth(1)
    expect(first).to_contain_text("orbit-", timeout=30_000)
    _press(page, first)
    _press(page, page.get_by_role("button", name="Look through"))
    expect(page.get_by_role("button", name="Leave this camera")).to_be_visible()
    _press(page, _link(page, "Map"))
    _draw(page)
    _press(page, page.get_by_role("button", name="Fly this"))
    _press(page, page.get_by_role("button", name="Plan", exact=True))
    expect(page.get_by_text("Vehicle 1:")).to_be_visible(timeout=30_000)
    mission = page.get_by_role("region", name="Mission")
    _press(page, mission.get_by_role("button", name="Prepare the files"))
    download = mission.get_by_role("button", name="Download", exact=True)
    expect(download).to_be_visible(timeout=30_000)
    with page.expect_download() as downloaded:
        _press(page, download)
    assert downloaded.value.suggested_filename.endswith(".plan")


def test_the_skip_link_leads_to_the_content_of_the_same_page(
    open_page: Opener, console_service: RunningService, courtyard: Scene
) -> None:
    page, _ = open_page(console_service.url, f"#/scenes/{courtyard.id}/map/work")
    expect(page.get_by_role("heading", name=courtyard.name)).to_be_visible()
    before = page.url
    _press(page, page.get_by_role("link", name="Skip to the content"))
    expect(page.get_by_role("main")).to_be_focused()
    assert page.url == before
    expect(page.get_by_role("heading", name=courtyard.name)).to_be_visible()


def _draw(page: Page) -> None:
    """A rectangle about the middle of the map, with the arrow keys."""
    _press(page, page.get_by_role("group", name="Draw").get_by_role("button", name="Area"))
    for key in ("", "Shift+ArrowRight", "Shift+ArrowDown", "Shift+ArrowLeft"):
        if key:
            page.keyboard.press(key)
            page.keyboard.press(key)
        else:
            page.keyboard.press("Enter")  # shows the cross-hair
        page.keyboard.press("Enter")
    _press(page, page.get_by_role("button", name="Finish"))
    expect(page.get_by_role("region", name="Area")).to_contain_text("m²")
