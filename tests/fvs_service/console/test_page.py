"""The console's page and files as the service sends them."""

import re
import sys
from pathlib import Path
from typing import Any

import pytest
from fvs_service.console.built_files import built_file
from fvs_service.settings import BasemapSettings

HTML = {"Accept": "text/html,*/*;q=0.8"}


def _assets(page: str) -> list[str]:
    return re.findall(r'(?:src|href)="(/console/assets/[^"]+)"', page)


def test_browsers_get_the_page_and_all_its_files_without_a_key(open_gateway: Any) -> None:
    client = open_gateway(require_keys=True).client
    page = client.get("/", headers=HTML)
    assert page.headers["Content-Type"] == "text/html; charset=utf-8"
    assert len(_assets(page.text)) >= 3
    for path in _assets(page.text):
        file = client.get(path)
        assert file.status_code == 200
        assert "immutable" in file.headers["Cache-Control"]
    assert client.get("/", headers={"Accept": "application/json"}).json()["api"] == "/v1"


def test_the_page_has_nothing_inline_and_nothing_of_others(gateway: Any) -> None:
    page = gateway.client.get("/", headers=HTML)
    assert not re.search(
        r"<style|\bstyle=|\bon\w+=|<script(?![^>]*\bsrc=)|(?:src|href)=\"(?!/console/)", page.text
    )
    policy = page.headers["Content-Security-Policy"]
    assert policy.startswith("default-src 'self'; script-src 'self' 'wasm-unsafe-eval'; connect-src 'self';")
    assert not re.search(r"unsafe-inline|'unsafe-eval'|blob:|data:|\*", policy)


def test_files_are_compressed_for_those_who_accept_it(gateway: Any) -> None:
    (script,) = [
        path
        for path in _assets(gateway.client.get("/", headers=HTML).text)
        if "index" in path and path.endswith(".js")
    ]
    plain = gateway.client.get(script, headers={"Accept-Encoding": "identity"})
    assert "Content-Encoding" not in plain.headers
    packed = gateway.client.get(script, headers={"Accept-Encoding": "gzip"})
    assert packed.headers["Content-Encoding"] == "gzip"
    assert packed.content == plain.content
    assert int(packed.headers["Content-Length"]) < 0.5 * len(plain.content)


@pytest.mark.parametrize("refused", ["gzip;q=0", "x-gzip-like", "identity"])
def test_files_are_not_compressed_for_others(gateway: Any, refused: str) -> None:
    page = gateway.client.get("/", headers={**HTML, "Accept-Encoding": refused})
    assert "Content-Encoding" not in page.headers


def test_files_that_do_not_exist_are_not_remembered() -> None:
    name = "absent-" + "x" * 1000
    before = sys.getrefcount(name)
    assert built_file(name) is None
    assert sys.getrefcount(name) == before


@pytest.mark.parametrize("name", ["absent.js", "..%2Findex.html", "%2e%2e%2findex.html"])
def test_other_files_are_not_sent(gateway: Any, name: str) -> None:
    assert gateway.client.get(f"/console/assets/{name}").status_code == 404


def test_without_the_console_there_are_no_files(open_gateway: Any) -> None:
    client = open_gateway(console=False).client
    page = client.get("/", headers=HTML, follow_redirects=False)
    assert (page.status_code, page.headers["Location"]) == (307, "/docs")
    assert client.get("/console/assets/index.js").json()["code"] == "not-found"


def test_the_page_may_contact_the_host_of_tiles_alone(open_gateway: Any) -> None:
    basemap = BasemapSettings(tiles="https://tiles.example/base/{z}/{x}/{y}.png", attribution="© Example")
    client = open_gateway(basemap=basemap).client
    policy = client.get("/", headers=HTML).headers["Content-Security-Policy"]
    assert "connect-src 'self' https://tiles.example;" in policy
    assert client.get("/v1/capabilities").json()["basemap"] == {
        "kind": "raster-tiles",
        "url": "https://tiles.example/base/{z}/{x}/{y}.png",
        "attribution": "© Example",
    }


def test_an_archive_of_tiles_is_sent_in_ranges(open_gateway: Any, tmp_path: Path) -> None:
    archive = tmp_path / "site.pmtiles"
    archive.write_bytes(bytes(range(100)))
    client = open_gateway(basemap=BasemapSettings(archive=archive)).client
    basemap = client.get("/v1/capabilities").json()["basemap"]
    assert basemap["kind"] == "pmtiles"
    part = client.get(basemap["url"], headers={"Range": "bytes=10-19"})
    assert (part.status_code, part.content) == (206, bytes(range(10, 20)))


def test_an_archive_that_is_gone_is_not_found(open_gateway: Any, tmp_path: Path) -> None:
    archive = tmp_path / "site.pmtiles"
    archive.touch()
    client = open_gateway(basemap=BasemapSettings(archive=archive)).client
    archive.unlink()
    gone = client.get("/console/basemap.pmtiles")
    assert (gone.status_code, gone.json()["code"]) == (404, "not-found")
    assert "FVS_BASEMAP__ARCHIVE" in gone.json()["hint"]


@pytest.mark.parametrize("host", ["a;script-src-elem", "a,b", "'unsafe-inline'", 'a"', "a\r\nX-A:b", "*"])
def test_hosts_of_tiles_add_nothing_to_the_policy(host: str) -> None:
    with pytest.raises(ValueError, match="tiles"):
        BasemapSettings(tiles=f"https://{host}/{{z}}/{{x}}/{{y}}.png")


@pytest.mark.parametrize("host", ["tiles.example", "127.0.0.1:8080", "[::1]:8080"])
def test_tiles_may_come_from_any_host(host: str) -> None:
    tiles = BasemapSettings(tiles=f"http://{host}/{{z}}/{{x}}/{{y}}.png")
    assert tiles.origins == (f"http://{host}",)


def test_tiles_have_one_source(tmp_path: Path) -> None:
    (tmp_path / "site.pmtiles").touch()
    with pytest.raises(ValueError, match="FVS_BASEMAP__TILES or FVS_BASEMAP__ARCHIVE"):
        BasemapSettings(tiles="https://a.example/{z}/{x}/{y}", archive=tmp_path / "site.pmtiles")
    with pytest.raises(ValueError, match="tiles"):
        BasemapSettings(tiles="https://a.example/one.png")
