"""Make the pictures of the console in the documentation: ``python docs/images/console.py``.

A settlement is simulated, surveyed with a strip left out, and reconstructed; a browser takes the pictures. It
needs Chromium and takes some minutes.
"""

import argparse
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent.parent / "tests" / "fixtures"))
sys.path.insert(0, str(Path(__file__).resolve().parent.parent.parent / "tests" / "servers"))

from browser import SOFTWARE_GL, running_browser
from fvs_client import Client, Scene
from fvs_service.serving.running import running_service
from photographs_with_gps import photographs_at
from playwright.sync_api import Browser, Page, expect

from fvs_engine.lab.simulate import SimulatedCamera, settlement, survey

OUT = Path(__file__).resolve().parent
SIZE = {"width": 1280, "height": 800}
QUALITY = 82
IMAGES, ROW = 48, 10
SETTINGS = {"FVS_GRPC_PORT": "0"}


def main() -> None:
    """Make the scene, unless the folder has it, and take all pictures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--root", type=Path, help="where the service's data stays, for pictures made again")
    root = parser.parse_args().root
    with tempfile.TemporaryDirectory() as folder, running_browser(*SOFTWARE_GL) as browser:
        root = root or Path(folder) / "root"
        with (
            running_service(root, Path(folder) / "service.log", SETTINGS) as service,
            Client(service.url) as client,
        ):
            scene = next(iter(client.scenes.list()), None) or _make_scene(client, Path(folder))
            for theme, take in (("dark", _next_views), ("light", _map), ("dark", _work), ("light", _compare)):
                with _page(browser, f"{service.url}/#/scenes/{scene.id}", theme) as page:
                    take(page)


def _make_scene(client: Client, folder: Path) -> Scene:
    poses = survey(IMAGES)
    kept = [pose for number, pose in enumerate(poses) if number // ROW != 2]
    camera = SimulatedCamera.like_a_drone()
    photographs = photographs_at(folder, settlement(), camera, kept, 1.0)
    scene = client.scenes.create("settlement, north")
    for first, last in ((0, 20), (20, 30), (30, len(photographs))):
        scene.images.upload(photographs[first:last])
        scene.update(iterations=500, long_side_px=480).wait()
    return scene


@contextmanager
def _page(browser: Browser, url: str, theme: str) -> Iterator[Page]:
    context = browser.new_context(viewport=SIZE, color_scheme=theme)  # type: ignore[arg-type]
    context.set_default_timeout(60_000)
    page = context.new_page()
    page.goto(f"{url}/view3d/photographs")
    expect(page.get_by_text("Live")).to_be_visible()
    yield page
    context.close()


def _open(page: Page, *names: str) -> None:
    for name in names:
        page.get_by_role("link", name=name, exact=True).click()


def _shoot(page: Page, name: str) -> None:
    page.wait_for_timeout(3_000)  # for renders and thumbnails that are under way
    page.screenshot(path=OUT / f"console-{name}.jpg", type="jpeg", quality=QUALITY)


def _next_views(page: Page) -> None:
    _open(page, "Next views")
    page.get_by_role("combobox", name="Candidates").select_option("grid")
    page.get_by_role("button", name="Rank", exact=True).click()
    first = page.get_by_role("region", name="Ranking").get_by_role("row").nth(1)
    first.click(timeout=120_000)
    page.get_by_role("button", name="Show all").click()
    _shoot(page, "next-views")


def _map(page: Page) -> None:
    _open(page, "Map", "Missions")
    page.get_by_role("group", name="Draw").get_by_role("button", name="Area").click()
    box = page.locator(".map-canvas").bounding_box()
    assert box is not None
    for across, down in ((0.5, 0.35), (0.85, 0.35), (0.85, 0.7), (0.5, 0.7)):
        page.mouse.click(box["x"] + across * box["width"], box["y"] + down * box["height"])
    page.get_by_role("button", name="Finish").click()
    page.get_by_role("button", name="Fly this").click()
    page.get_by_role("button", name="Plan", exact=True).click()
    expect(page.get_by_text("Vehicle 1:")).to_be_visible(timeout=120_000)
    _shoot(page, "map")


def _work(page: Page) -> None:
    _open(page, "Work")
    expect(page.locator(".snapshot-card").first).to_be_visible()
    page.get_by_role("button", name="Show all").click()
    _shoot(page, "work")


def _compare(page: Page) -> None:
    _open(page, "Compare", "Photographs")
    row = page.get_by_role("listbox", name="Photographs").get_by_role("option").first
    row.click()
    _shoot(page, "compare")


if __name__ == "__main__":
    main()
