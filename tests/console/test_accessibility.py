"""Every page by the rules of axe, in both themes, on a tablet."""

import os
from pathlib import Path
from typing import Any

import pytest
from fvs_client import Scene
from fvs_service.serving.running import RunningService
from playwright.sync_api import Page, expect
from watched_pages import Opener

AXE = Path(__file__).parents[2] / "clients" / "web" / "node_modules" / "axe-core" / "axe.min.js"
TABLET = {"width": 1024, "height": 768}


@pytest.fixture(scope="module")
def axe() -> str:
    """The source of axe: a page whose policy forbids other scripts still evaluates it for its debugger."""
    if not AXE.exists():
        missing = "the packages of clients/web are not installed: make check-console"
        if os.environ.get("CI") == "true":
            pytest.fail(missing)
        pytest.skip(missing)
    return AXE.read_text(encoding="utf-8")


@pytest.mark.parametrize("theme", ["dark", "light"])
def test_every_page_of_a_scene_is_accessible(
    open_page: Opener, console_service: RunningService, courtyard: Scene, axe: str, theme: Any
) -> None:
    page, _ = open_page(console_service.url, viewport=TABLET, color_scheme=theme)
    expect(page.get_by_role("heading", name="Scenes")).to_be_visible()
    _check(page, axe, "scenes")
    fill = {"photographs": _select_a_photograph, "views": _rank, "plans": _plan_and_draw}
    for stage, panel in (
        ("view3d", "photographs"),
        ("view3d", "views"),
        ("map", "plans"),
        ("compare", "work"),
    ):
        page.goto(f"{console_service.url}/#/scenes/{courtyard.id}/{stage}/{panel}")
        expect(page.get_by_role("heading", name="courtyard")).to_be_visible()
        expect(page.get_by_text("Loading …")).to_have_count(0)
        fill.get(panel, lambda _: None)(page)
        _check(page, axe, f"{stage}/{panel}")
        wide = page.evaluate("document.documentElement.scrollWidth")
        assert wide <= TABLET["width"], f"{stage}/{panel} is {wide} px wide"


def _select_a_photograph(page: Page) -> None:
    page.get_by_role("listbox", name="Photographs").get_by_role("option").first.click()


def _rank(page: Page) -> None:
    page.get_by_role("button", name="Rank", exact=True).click()
    row = page.get_by_role("region", name="Ranking").get_by_role("row").nth(1)
    expect(row).to_contain_text("orbit-", timeout=30_000)
    row.click()


def _plan_and_draw(page: Page) -> None:
    page.get_by_role("button", name="Plan", exact=True).click()
    expect(page.get_by_text("Vehicle 1:")).to_be_visible(timeout=30_000)
    page.get_by_role("group", name="Draw").get_by_role("button", name="Area").click()


def _check(page: Page, axe: str, where: str) -> None:
    page.evaluate(axe)
    found = page.evaluate("axe.run({ resultTypes: ['violations'] })")["violations"]
    bad = [
        f"{one['id']}: {one['help']}: {node['html'][:200]} {node['failureSummary'][:300]}"
        for one in found
        if one["impact"] in ("serious", "critical")
        for node in one["nodes"]
    ]
    assert not bad, f"{where}: {bad}"
