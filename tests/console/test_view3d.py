"""The scene in 3D, and what is shown where it cannot be drawn."""

import re
from collections.abc import Callable, Iterator

import pytest
from browser import FLAGS, NO_GL, chromium
from fvs_client import Scene
from fvs_service.serving.running import RunningService
from playwright.sync_api import Browser, Page, Route, expect
from watched_pages import Opener, Watch

DRAWN_MS = 30_000


@pytest.fixture(scope="module")
def browser_without_gl(browser: Browser) -> Iterator[Browser]:
    other = browser.browser_type.launch(executable_path=chromium(), args=[*FLAGS, *NO_GL])
    yield other
    other.close()


@pytest.fixture
def open_splat(open_page: Opener, console_service: RunningService, courtyard: Scene) -> Callable[..., Page]:
    """Opens the scene with the splat drawn by the browser, although its GL is software."""

    def open_it(prepare: Callable[[Page, Watch], None] | None = None) -> Page:
        page, watch = open_page(console_service.url)
        page.evaluate("localStorage.setItem('fvs-splat-source', 'local')")
        if prepare is not None:
            prepare(page, watch)
        page.goto(f"{console_service.url}/#/scenes/{courtyard.id}/view3d/photographs")
        return page

    return open_it


def test_the_splat_is_drawn_here_with_its_cameras(open_splat: Callable[..., Page]) -> None:
    page = open_splat()
    expect(page.locator(".view3d-status")).to_contain_text("Drawn here", timeout=DRAWN_MS)
    expect(page.locator(".view3d-legend")).to_contain_text("photograph")
    picture = page.locator(".view3d-canvas")
    before = picture.screenshot()
    picture.focus()
    page.keyboard.press("ArrowLeft")
    page.wait_for_timeout(1000)
    assert picture.screenshot() != before


def test_without_webgl_the_service_draws(
    browser_without_gl: Browser, console_service: RunningService, courtyard: Scene
) -> None:
    opener = Opener(browser_without_gl)
    page, watch = opener(console_service.url)
    watch.allow("WebGL")
    with page.expect_response(re.compile("/render")) as rendered:
        page.goto(f"{console_service.url}/#/scenes/{courtyard.id}/view3d/photographs")
    assert rendered.value.ok
    status = page.locator(".view3d-status")
    expect(status).to_contain_text("Drawn by the service: this browser has no WebGL")
    opener.close()


def test_a_splat_that_does_not_load_leaves_the_points(open_splat: Callable[..., Page]) -> None:
    def refuse(route: Route) -> None:
        route.fulfill(status=500, json={"detail": "The disk is broken.", "code": "internal", "hint": ""})

    def prepare(page: Page, watch: Watch) -> None:
        watch.allow("status of 500")
        page.route(re.compile(r"\.spz$"), refuse)

    alert = open_splat(prepare).get_by_role("alert")
    expect(alert).to_contain_text("The model cannot be shown; its points are. The disk is broken.")
