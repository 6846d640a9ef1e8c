"""Pages of allowed origins may do all with a key, and read every response, as browsers allow it (CORS)."""

import hashlib
from base64 import b64encode
from collections.abc import Iterator
from typing import Any

import pytest
from fvs_service.cli.options import settings_of as settings_of_environment
from typer import Exit

_PAGE = "https://console.example"
_ORIGIN = {"Origin": _PAGE, "Sec-Fetch-Site": "cross-site", "Sec-Fetch-Mode": "cors"}


@pytest.fixture(scope="module")
def gateway(tmp_path_factory: pytest.TempPathFactory, running: Any, settings_of: Any) -> Iterator[Any]:
    overrides = {"allowed_origins": (_PAGE, "http://127.0.0.1:3000"), "require_keys": True}
    with running(settings_of(tmp_path_factory.mktemp("pages") / "service", overrides)) as gateway:
        yield gateway


@pytest.fixture
def page(gateway: Any) -> dict[str, str]:
    """What a page's requests have, with a key."""
    return {**_ORIGIN, **gateway.key("a")}


def _preflight(gateway: Any, method: str, path: str, headers: str = "", origin: str = _PAGE) -> Any:
    asked = {"Origin": origin, "Access-Control-Request-Method": method}
    if headers:
        asked["Access-Control-Request-Headers"] = headers
    return gateway.client.options(path, headers=asked)


def _readable(answer: Any) -> bool:
    """Whether the browser gives the page the response, with all of its headers."""
    headers = answer.headers
    return (
        headers.get("access-control-allow-origin") == _PAGE
        and headers.get("access-control-expose-headers") == "*"
        and "access-control-allow-credentials" not in headers
        and "Origin" in headers["vary"]
    )


@pytest.mark.parametrize(
    ("method", "path", "headers"),
    [
        ("GET", "/v1/scenes", "authorization"),
        ("POST", "/v1/scenes", "authorization,content-type,idempotency-key"),
        ("PATCH", "/v1/scenes/scn_a", "authorization,content-type,if-match"),
        ("PUT", "/v1/scenes/scn_a/images/sha256:0", "authorization,x-request-id"),
        ("DELETE", "/v1/scenes/scn_a", "authorization"),
        ("GET", "/v1/scenes/scn_a/events", "authorization,last-event-id"),
        ("GET", "/v1/snapshots/snp_a/artifacts/model.ply", "authorization,range,if-range,if-none-match"),
        ("POST", "/v1/uploads", "authorization,tus-resumable,upload-length,upload-metadata"),
        (
            "PATCH",
            "/v1/uploads/upl_a",
            "authorization,content-type,tus-resumable,upload-offset",
        ),
        ("HEAD", "/v1/uploads/upl_a", "authorization,tus-resumable"),
    ],
)
def test_a_preflight_is_answered_without_a_key(gateway: Any, method: str, path: str, headers: str) -> None:
    answer = _preflight(gateway, method, path, headers)
    assert answer.status_code == 200
    assert answer.headers["access-control-allow-origin"] == _PAGE
    assert method in answer.headers["access-control-allow-methods"].split(", ")
    assert answer.headers["access-control-allow-headers"] == headers


def test_another_origin_is_told_that_it_may_not(gateway: Any) -> None:
    for origin in ("https://evil.example", "null", "https://console.example.evil.example"):
        preflight = _preflight(gateway, "GET", "/v1/scenes", "authorization", origin)
        simple = gateway.client.get("/v1/scenes", headers={"Origin": origin, **gateway.key("a")})
        for answer in (preflight, simple):
            assert (answer.status_code, answer.json()["code"]) == (403, "foreign-origin")
            assert "access-control-allow-origin" not in answer.headers


def test_nothing_is_allowed_by_default(open_gateway: Any) -> None:
    gateway = open_gateway()
    assert _preflight(gateway, "GET", "/v1/scenes").status_code == 403
    answers = (_preflight(gateway, "GET", "/v1/scenes"), gateway.client.get("/v1/scenes", headers=_ORIGIN))
    for answer in answers:
        assert answer.status_code == 403
        assert not any(name.startswith("access-control") for name in answer.headers)


def test_a_page_works_with_its_key(gateway: Any, page: dict[str, str], photograph: Any) -> None:
    made = gateway.client.post("/v1/scenes", json={"name": "a"}, headers=page)
    scene = made.json()["id"]
    sent = gateway.client.put(
        f"/v1/scenes/{scene}/images/sha256:{hashlib.sha256(photograph(1)).hexdigest()}",
        content=photograph(1),
        headers=page,
    )
    snapshot = gateway.model(scene, page)
    listed = gateway.client.get(f"/v1/snapshots/{snapshot}", headers=page)
    name = listed.json()["artifacts"][0]["name"]
    part = gateway.client.get(
        f"/v1/snapshots/{snapshot}/artifacts/{name}", headers={**page, "Range": "bytes=0-9"}
    )
    assert [answer.status_code for answer in (made, sent, listed, part)] == [201, 201, 200, 206]
    assert all(map(_readable, (made, sent, listed, part)))
    assert made.headers["location"] == f"/v1/scenes/{scene}"
    assert part.headers["content-range"].startswith("bytes 0-9/")
    assert part.headers["etag"]


def test_a_page_reads_events(gateway: Any, page: dict[str, str]) -> None:
    scene = gateway.scene(page)
    with gateway.client.stream("GET", f"/v1/scenes/{scene}/events", headers=page) as stream:
        assert _readable(stream)
        assert "event: scene.created" in stream.iter_lines()
        gateway.client.delete(f"/v1/scenes/{scene}", headers=page)


def test_a_page_uploads_in_parts(gateway: Any, page: dict[str, str], photograph: Any) -> None:
    content, scene = photograph(2), gateway.scene(page)
    given = {"scene": scene, "sha256": hashlib.sha256(content).hexdigest()}
    metadata = ",".join(f"{name} {b64encode(value.encode()).decode()}" for name, value in given.items())
    tus = {**page, "Tus-Resumable": "1.0.0"}
    new = {**tus, "Upload-Length": str(len(content)), "Upload-Metadata": metadata}
    made = gateway.client.post("/v1/uploads", headers=new)
    place = {"Upload-Offset": "0", "Content-Type": "application/offset+octet-stream"}
    half = gateway.client.patch(made.headers["location"], content=content[:99], headers={**tus, **place})
    asked = gateway.client.head(made.headers["location"], headers=tus)
    place["Upload-Offset"] = asked.headers["upload-offset"]
    rest = gateway.client.patch(made.headers["location"], content=content[99:], headers={**tus, **place})
    assert [answer.status_code for answer in (made, half, asked, rest)] == [201, 204, 200, 204]
    assert all(map(_readable, (made, half, asked, rest)))
    assert rest.headers["tus-resumable"] == "1.0.0"


def test_a_page_can_read_errors(gateway: Any, page: dict[str, str], monkeypatch: pytest.MonkeyPatch) -> None:
    client = gateway.client
    answers = [
        client.get("/v1/scenes", headers=_ORIGIN),
        client.get("/v1/scenes/scn_none", headers=page),
        client.get("/v1/nowhere", headers=page),
        client.delete("/v1/scenes", headers=page),
        client.post("/v1/scenes", json={"name": 1}, headers=page),
    ]
    monkeypatch.setattr(gateway.application.scenes, "get", _fail)
    answers.append(client.get("/v1/scenes/scn_none", headers=page))
    assert [answer.status_code for answer in answers] == [401, 404, 404, 405, 422, 500]
    for answer in answers:
        assert _readable(answer), answer.status_code
        assert answer.headers["x-request-id"] == answer.json()["request_id"]


def _fail(*_: object) -> None:
    raise ZeroDivisionError


def test_a_page_can_read_that_the_service_stops(gateway: Any, page: dict[str, str], monkeypatch: Any) -> None:
    monkeypatch.setattr(type(gateway.app.state.drain), "begun", True)
    answer = gateway.client.get("/v1/scenes", headers=page)
    assert answer.status_code == 503
    assert _readable(answer)
    assert answer.headers["retry-after"]


@pytest.mark.parametrize("origin", ["*", "console.example", "https://console.example/app", "null", "ftp://a"])
def test_what_is_no_origin_is_refused(
    origin: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("FVS_ALLOWED_ORIGINS", origin)
    with pytest.raises(Exit):
        settings_of_environment()
    assert f"{origin} is not an origin, such as https://console.example" in capsys.readouterr().err
    monkeypatch.setenv("FVS_ALLOWED_ORIGINS", "HTTPS://Console.Example/, http://127.0.0.1:3000")
    assert settings_of_environment().allowed_origins == (_PAGE, "http://127.0.0.1:3000")
