"""The operator's console with 500 photographs, 1,000 candidates and 100,000 Gaussians, in a real browser.

Measures bytes, times to the first picture, frames per second, the times from events to pixels, and memory. GL
is software (SwiftShader): a graphics card draws many times faster. ``--minutes`` watches the memory of a page
whose scene gets a photograph, an update and a ranking in turns.
"""

import argparse
import os
import re
import statistics
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "tests" / "fixtures"))
sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "tests" / "servers"))

from browser import SOFTWARE_GL, running_browser
from console_scene import make_scene, photograph
from fvs_client import Client, Grid, Scene
from fvs_service.serving.process_tree import command_of, descendants
from fvs_service.serving.running import running_service
from measurement import report
from photographs_with_gps import photographs_with_gps
from playwright.sync_api import Browser, Page, expect

from fvs_engine.lab.simulate import survey

_OBSERVERS = Path(__file__).with_name("console_observers.js").read_text()
_DRAWN = re.compile(r"^Drawn (here|by the service)")
_SETTLE_MS = 3_000
_DRAG_S = 6.0
_SAMPLE_S = 60.0
_SMALL = {"FVS_INSPECTORS": "1", "FVS_GRPC_PORT": "0"}
_QUICK = {
    "FVS_WORKER__LONG_SIDE_PX": "240",
    "FVS_WORKER__INITIAL_ITERATIONS": "200",
    "FVS_WORKER__ITERATIONS_PER_IMAGE": "30",
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--images", type=int, default=500)
    parser.add_argument("--candidates", type=int, default=1000, help="a square is rounded down to")
    parser.add_argument("--gaussians", type=int, default=100_000)
    parser.add_argument("--repeat", type=int, default=5, help="of loading the page, and of every event")
    parser.add_argument("--minutes", type=float, default=0.0, help="of a running scene; 60 is the whole")
    parser.add_argument("--out", type=Path, default=Path("out/console"), help="tables as JSON, and the log")
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    with (
        tempfile.TemporaryDirectory(prefix="fvs-console-") as folder,
        running_browser(*SOFTWARE_GL) as browser,
    ):
        if options.minutes:
            _watch_memory(Path(folder), browser, options)
        else:
            _measure(Path(folder), browser, options)


def _measure(folder: Path, browser: Browser, options: argparse.Namespace) -> None:
    scene_id = make_scene(folder / "root", options.images, options.gaussians)
    side = int(options.candidates**0.5)
    with (
        running_service(folder / "root", options.out / "service.log", _SMALL) as service,
        Client(service.url) as client,
    ):
        scene = client.scenes.get(scene_id)
        generator = Grid(columns=side, rows=options.candidates // side, look="down")
        ranking = scene.rank(generator=generator, method="median-frequency-estimate", rank_all=True)
        url = f"{service.url}/#/scenes/{scene_id}/view3d/views"
        loads = [_load(browser, url) for _ in range(options.repeat)]
        report("bytes of the page, gzip", loads[-1][1], options.out / "bytes.json")
        figures = [figures for figures, _ in loads]
        medians = {name: statistics.median(one[name] for one in figures) for name in figures[0]}
        report(f"loading {ranking.total} candidates", [medians], options.out / "loading.json")
        splat = _load(browser, url, "local")[1]
        report("bytes with the splat, gzip", splat, options.out / "splat.json")
        frames = [_frames(browser, url, source) for source in ("service", "local")]
        report("frames per second, software GL", frames, options.out / "frames.json")
        with _page(browser, url) as page:
            _until_drawn(page)
            _show_ranking(page)
            report("event to pixel", _latencies(page, scene, options.repeat), options.out / "events.json")
            report("memory", [_memory(page)], options.out / "memory.json")


@contextmanager
def _page(browser: Browser, url: str, source: str = "auto") -> Iterator[Page]:
    context = browser.new_context(viewport={"width": 1280, "height": 800})
    context.set_default_timeout(120_000)
    context.add_init_script(f"localStorage.setItem('fvs-splat-source', '{source}')\n{_OBSERVERS}")
    page = context.new_page()
    page.goto(url)
    yield page
    context.close()


def _until_drawn(page: Page) -> None:
    """Until the picture of the model is there, whoever draws it."""
    expect(page.locator(".view3d-status")).to_have_text(_DRAWN, timeout=120_000)


def _load(browser: Browser, url: str, source: str = "auto") -> tuple[dict[str, float], list[dict[str, Any]]]:
    """A first visit: its figures, and the bytes of its files in the order of their arrival."""
    context = browser.new_context(viewport={"width": 1280, "height": 800})
    context.set_default_timeout(120_000)
    context.add_init_script(f"localStorage.setItem('fvs-splat-source', '{source}')\n{_OBSERVERS}")
    page = context.new_page()
    files: list[dict[str, Any]] = []
    names: dict[str, str] = {}
    network = context.new_cdp_session(page)
    network.send("Network.enable")
    network.on(
        "Network.responseReceived", lambda got: names.update({got["requestId"]: got["response"]["url"]})
    )
    network.on("Network.loadingFinished", lambda got: files.append({"id": got["requestId"], **got}))
    page.goto(url)
    page.locator("h1").wait_for()
    heading_ms = page.evaluate("performance.now()")
    _until_drawn(page)
    drawn_ms = page.evaluate("performance.now()")
    page.wait_for_timeout(_SETTLE_MS)
    seen = page.evaluate("window.observed")
    ranking_ms = _show_ranking(page)
    context.close()
    sizes = [(names.get(one["id"], ""), int(one["encodedDataLength"])) for one in files]
    own = [(url.rsplit("/", 1)[1] or "index.html", size) for url, size in sizes if "/v1/" not in url]
    before = sum(size for name, size in own if not _of_splats(name))
    rows = [{"file": name, "bytes": size} for name, size in own]
    rows.append({"file": "before the splat", "bytes": before})
    rows.append({"file": "answers of /v1", "bytes": sum(size for url, size in sizes if "/v1/" in url)})
    return {
        "FCP ms": seen["fcp"],
        "LCP ms": seen["lcp"],
        "CLS": seen["cls"],
        "TBT ms": seen["tbt"],
        "heading ms": heading_ms,
        "model drawn ms": drawn_ms,
        "ranking shown ms": ranking_ms,
    }, rows


def _show_ranking(page: Page) -> float:
    """Show the scene's ranking; returns the time from the click to the first row, in ms."""
    page.get_by_text("Earlier rankings").click()
    began = time.perf_counter()
    page.get_by_role("button", name="Show", exact=True).click()
    page.get_by_role("region", name="Ranking").get_by_role("row").nth(1).wait_for()
    return 1000 * (time.perf_counter() - began)


def _of_splats(name: str) -> bool:
    return name.startswith(("spark", "three", "splat", "webgl"))


def _frames(browser: Browser, url: str, source: str) -> dict[str, Any]:
    """Frames that are drawn while the mouse turns the view, with the model drawn by ``source``."""
    with _page(browser, url, source) as page:
        _until_drawn(page)
        _show_ranking(page)
        page.wait_for_timeout(_SETTLE_MS)
        box = page.locator(".view3d-canvas").bounding_box()
        assert box is not None
        x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
        page.mouse.move(x, y)
        page.mouse.down()
        page.evaluate("window.observed.frames = 0")
        began = time.perf_counter()
        step = 0
        while time.perf_counter() - began < _DRAG_S:
            step += 1
            page.mouse.move(x + 100 * (step % 40 - 20) / 20, y + step % 7)
        drawn = page.evaluate("window.observed.frames")
        seconds = time.perf_counter() - began
        page.mouse.up()
        page.wait_for_timeout(_SETTLE_MS)
        status = page.locator(".view3d-status").inner_text()
        size = f"{box['width']:.0f} × {box['height']:.0f}"
    return {
        "model drawn by": source,
        "px": size,
        "frames per second": drawn / seconds,
        "the page says": status,
    }


def _latencies(page: Page, scene: Scene, repeat: int) -> list[dict[str, Any]]:
    """From the time that an event carries to the next frame after the page has changed."""
    poses = survey(repeat)

    def send(number: int) -> None:
        scene.images.put(photograph(10_000 + number, poses[number]))

    def rename(number: int) -> None:
        scene.change(name=f"name {number}")

    rows, last = [], 0
    actions: dict[str, Callable[[int], None]] = {"scene.changed": rename, "image.received": send}
    for kind, act in actions.items():
        times = []
        for number in range(repeat):
            page.wait_for_timeout(1_000)
            page.evaluate("window.observed.changed = null")
            began = datetime.now(UTC)
            act(number)
            while not (changed_ms := page.evaluate("window.observed.changed")):
                page.wait_for_timeout(100)
            event = next(
                one for one in scene.events(after=last) if one.kind == kind and one.created_at >= began
            )
            last = event.number
            times.append(changed_ms - 1000 * event.created_at.timestamp())
        rows.append({"event": kind, "median ms": statistics.median(times), "max ms": max(times)})
    return rows


def _memory(page: Page) -> dict[str, float]:
    """The JS heap after a collection, and the memory of all processes of the browser."""
    session = page.context.new_cdp_session(page)
    session.send("HeapProfiler.collectGarbage")
    heap = session.send("Runtime.getHeapUsage")["usedSize"]
    session.detach()
    elements = page.evaluate("document.querySelectorAll('*').length")
    return {"JS heap MB": heap / 1e6, "browser MB": _browser_bytes() / 1e6, "elements": elements}


def _browser_bytes() -> int:
    """Proportional set sizes of the browser's processes."""
    total = 0
    for pid in descendants(os.getpid()):
        if "chromium" in command_of(pid):
            text = Path(f"/proc/{pid}/smaps_rollup").read_text()
            total += 1024 * int(
                next(line for line in text.splitlines() if line.startswith("Pss:")).split()[1]
            )
    return total


def _watch_memory(folder: Path, browser: Browser, options: argparse.Namespace) -> None:
    (folder / "photographs").mkdir()
    photographs = photographs_with_gps(folder / "photographs", 64, turns=1.0)
    with (
        running_service(folder / "root", options.out / "service.log", {**_SMALL, **_QUICK}) as service,
        Client(service.url) as client,
    ):
        scene = client.scenes.create("running")
        scene.images.upload(photographs[:8])
        scene.update().wait()
        rows: list[dict[str, Any]] = []
        with _page(browser, f"{service.url}/#/scenes/{scene.id}/view3d/work") as page:
            _until_drawn(page)
            began = time.monotonic()
            waiting = photographs[8:]
            job = None
            while (minutes := (time.monotonic() - began) / 60) < options.minutes:
                row = {"minutes": round(minutes, 1), **_memory(page)}
                rows.append(row | {"snapshots": len(list(scene.snapshots.list()))})
                report("memory of a running scene", rows, options.out / "running.json")
                until = began + _SAMPLE_S * len(rows)
                while time.monotonic() < until:
                    if job is None or job.refresh().state.ended:
                        scene.rank(top_k=5)
                        if waiting:
                            scene.images.upload([waiting.pop(0)])
                        job = scene.update()
                    page.wait_for_timeout(2_000)


if __name__ == "__main__":
    main()
