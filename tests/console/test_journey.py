"""From photographs to a model in the browser, as an operator does it."""

from pathlib import Path

from dropped_files import drop_files
from fvs_client import Client
from fvs_service.serving.running import RunningService
from playwright.sync_api import Page, expect
from watched_pages import Opener

UPDATE_MS = 90_000


def test_from_photographs_to_a_model(
    open_page: Opener, console_service: RunningService, client: Client, photographs: list[Path]
) -> None:
    page, _ = open_page(console_service.url)
    _create(page, "north quarry")
    _send(page, photographs[:8])
    _panel(page, "Work")
    page.get_by_role("button", name="Start", exact=True).click()
    job = page.get_by_role("article", name="Update")
    expect(job).to_contain_text("Done", timeout=UPDATE_MS)
    expect(page.get_by_text("8 registered").first).to_be_visible()
    _panel(page, "Photographs")
    rows = page.get_by_role("listbox", name="Photographs").get_by_role("option")
    expect(rows).to_have_count(8)
    expect(rows.first).to_contain_text("Registered")
    _delete(page, "north quarry")
    assert all(scene.name != "north quarry" for scene in client.scenes.list())


def _create(page: Page, name: str) -> None:
    page.get_by_role("button", name="New scene").click()
    dialog = page.get_by_role("dialog", name="New scene")
    dialog.get_by_label("Name").fill(name)
    dialog.get_by_role("button", name="Create").click()
    expect(page.get_by_role("heading", name=name)).to_be_visible()


def _panel(page: Page, name: str) -> None:
    page.get_by_role("navigation", name="What is done").get_by_role("link", name=name).click()


def _send(page: Page, photographs: list[Path]) -> None:
    """Half of them by the file chooser, the others by drag and drop."""
    half = len(photographs) // 2
    with page.expect_file_chooser() as chooser:
        page.get_by_role("button", name="Add photographs").click()
    chooser.value.set_files(photographs[:half])
    expect(page.get_by_text("All are sent")).to_be_visible()
    drop_files(page, photographs[half:])
    expect(page.get_by_text(f"{len(photographs)} of {len(photographs)}")).to_be_visible()
    expect(page.get_by_text("All are sent")).to_be_visible()


def _delete(page: Page, name: str) -> None:
    page.get_by_role("link", name="fvs", exact=True).click()
    page.get_by_role("button", name=f"Delete {name}").click()
    dialog = page.get_by_role("dialog")
    delete = dialog.get_by_role("button", name="Delete the scene")
    expect(delete).to_be_disabled()
    dialog.get_by_role("checkbox").check()
    delete.click()
    expect(page.get_by_text(f"“{name}” was deleted.")).to_be_visible()
    expect(page.get_by_role("link", name=name)).to_have_count(0)
