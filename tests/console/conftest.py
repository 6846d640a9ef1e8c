"""A browser, and services whose pages it opens."""

import contextlib
import os
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from browser import SOFTWARE_GL, chromium, running_browser
from fvs_client import Client, FvsError, Scene
from fvs_service.serving.running import RunningService, running_service
from photographs_with_gps import photographs_with_gps
from playwright.sync_api import Browser
from watched_pages import Opener

SMALL = {
    "FVS_WORKER__LONG_SIDE_PX": "160",
    "FVS_WORKER__INITIAL_ITERATIONS": "120",
    "FVS_WORKER__ITERATIONS_PER_IMAGE": "20",
    "FVS_INSPECTORS": "1",
    "FVS_GRPC_PORT": "0",
}


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        if Path(__file__).parent in item.path.parents:
            item.add_marker(pytest.mark.system)


def _need_chromium() -> None:
    if chromium() is None:
        missing = "Chromium is not installed: apt-get install chromium"
        if os.environ.get("CI") == "true":
            pytest.fail(missing)
        pytest.skip(missing)


# Of a module, not of the session: while Playwright runs, no other test of this thread can run an event loop.
@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    """Chromium with software GL."""
    _need_chromium()
    with running_browser(*SOFTWARE_GL) as browser:
        yield browser


@pytest.fixture
def open_page(browser: Browser) -> Iterator[Opener]:
    """Opens the page of a service; the test fails when anything goes wrong in it."""
    opener = Opener(browser)
    yield opener
    opener.close()


@pytest.fixture(scope="session")
def photographs(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Ten georeferenced photographs along an arc around the courtyard."""
    return photographs_with_gps(tmp_path_factory.mktemp("photographs"), 10, turns=0.4)


@pytest.fixture(scope="session")
def console_service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunningService]:
    """A service that all tests share; it trains quickly and badly."""
    _need_chromium()
    folder = tmp_path_factory.mktemp("console")
    with running_service(folder / "root", folder / "service.log", SMALL) as service:
        yield service


@pytest.fixture(scope="session")
def client(console_service: RunningService) -> Iterator[Client]:
    """A client of that service."""
    with Client(console_service.url) as client:
        yield client


@pytest.fixture(scope="session")
def courtyard(client: Client, photographs: list[Path]) -> Scene:
    """A georeferenced scene with a model of eight photographs; tests do not change its images."""
    scene = client.scenes.create("courtyard")
    scene.images.upload(photographs[:8])
    scene.update().wait()
    return scene


@pytest.fixture
def new_scene(client: Client) -> Iterator[Callable[[str], Scene]]:
    """Makes scenes for one test."""
    made: list[Scene] = []

    def make(name: str) -> Scene:
        made.append(client.scenes.create(name))
        return made[-1]

    yield make
    for scene in made:
        with contextlib.suppress(FvsError):  # the test may have deleted it
            scene.delete()
