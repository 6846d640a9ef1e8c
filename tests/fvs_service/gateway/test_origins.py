"""Web pages cannot use a service that needs no key."""

from typing import Any

import pytest

_OWN = "http://127.0.0.1:8000"
_FOREIGN: list[dict[str, str]] = [
    {"Origin": "https://evil.example"},
    {"Origin": "null"},
    {"Origin": "http://["},
    {"Origin": "127.0.0.1:8000"},
    {"Origin": "http://127.0.0.1:3000", "Sec-Fetch-Site": "same-site"},
    {"Origin": "http://localhost:8000"},
    {"Sec-Fetch-Site": "cross-site"},
    {"Sec-Fetch-Site": "same-site"},
    {"Sec-Fetch-Site": "cross-site", "Sec-Fetch-Mode": "no-cors"},
]
_OWN_PAGES: list[dict[str, str]] = [
    {},
    {"Origin": _OWN},
    {"Origin": _OWN, "Sec-Fetch-Site": "same-origin"},
    {"Sec-Fetch-Site": "none", "Sec-Fetch-Mode": "navigate"},
]


def _host(name: str) -> dict[str, str]:
    return {"Host": name}


@pytest.mark.parametrize(
    "host", ["evil.example", "evil.example:8000", "127.0.0.1.evil.example", "[::2]", "0.0.0.0", "x@y", "]"]
)
def test_names_that_are_not_loopback_are_refused(gateway: Any, host: str) -> None:
    answer = gateway.client.get("/v1/scenes", headers=_host(host))
    assert (answer.status_code, answer.json()["code"]) == (421, "unknown-host")
    assert "FVS_ALLOWED_HOSTS" in answer.json()["hint"]


@pytest.mark.parametrize(
    "host", ["127.0.0.1", "127.0.0.1:8000", "localhost", "LOCALHOST:80", "[::1]:8000", "localhost."]
)
def test_names_of_loopback_are_accepted(gateway: Any, host: str) -> None:
    assert gateway.client.get("/v1/scenes", headers=_host(host)).status_code == 200


@pytest.mark.parametrize("headers", _FOREIGN)
def test_pages_of_other_origins_change_and_read_nothing(
    gateway: Any, headers: dict[str, str], photograph: Any
) -> None:
    scene = gateway.scene()
    job = gateway.queue(scene)
    client, sent = gateway.client, {**_host("127.0.0.1:8000"), **headers}
    refused = [
        client.post(f"/v1/scenes/{scene}/images", files={"file": ("a.jpg", photograph(1))}, headers=sent),
        client.post(f"/v1/jobs/{job}:cancel", headers=sent),
        client.post(f"/v1/jobs/{job}:retry", headers=sent),
        client.post("/v1/scenes", json={"name": "a"}, headers=sent),
        client.get(f"/v1/scenes/{scene}/events", headers=sent),
        client.get("/v1/scenes", headers=sent),
    ]
    assert [(answer.status_code, answer.json()["code"]) for answer in refused] == [
        (403, "foreign-origin")
    ] * 6
    assert client.get(f"/v1/scenes/{scene}").json()["image_counts"]["received"] == 0
    assert client.get(f"/v1/jobs/{job}").json()["state"] == "queued"


@pytest.mark.parametrize("headers", _OWN_PAGES)
def test_programs_and_own_pages_may_do_all(gateway: Any, headers: dict[str, str], photograph: Any) -> None:
    scene = gateway.scene()
    sent = {**_host("127.0.0.1:8000"), **headers}
    files = {"file": ("a.jpg", photograph(1))}
    assert gateway.client.post(f"/v1/scenes/{scene}/images", files=files, headers=sent).status_code == 200
    assert gateway.client.get(f"/v1/scenes/{scene}", headers=sent).status_code == 200


def test_a_link_may_be_followed_but_posts_no_form(gateway: Any) -> None:
    headers = {"Sec-Fetch-Site": "cross-site", "Sec-Fetch-Mode": "navigate"}
    assert gateway.client.get("/openapi.json", headers=headers).status_code == 200
    assert gateway.client.post("/v1/jobs/job_a:cancel", headers=headers).status_code == 403


def test_a_form_cannot_be_json(gateway: Any) -> None:
    for kind in ("text/plain", "application/x-www-form-urlencoded", "multipart/form-data; boundary=a"):
        answer = gateway.client.post("/v1/scenes", content=b'{"name":"a"}', headers={"Content-Type": kind})
        assert answer.status_code == 415


def test_other_names_and_origins_can_be_allowed(open_gateway: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("FVS_ALLOWED_HOSTS", "ground.example, Other.Example")
    monkeypatch.setenv("FVS_ALLOWED_ORIGINS", "https://console.example")
    gateway = open_gateway()
    client = gateway.client
    client.headers.update(gateway.key("a"))
    page = {"Origin": "https://console.example", "Sec-Fetch-Site": "cross-site"}
    assert client.get("/v1/scenes", headers={**_host("ground.example:8000"), **page}).status_code == 200
    assert client.get("/v1/scenes", headers=_host("other.example")).status_code == 200
    assert client.get("/v1/scenes", headers=_host("localhost")).status_code == 200
    assert client.get("/v1/scenes", headers=_host("evil.example")).status_code == 421
    assert (
        client.post("/v1/scenes", json={"name": "a"}, headers={"Origin": "https://a.example"}).status_code
        == 403
    )


def test_where_keys_are_required_any_name_is_served(open_gateway: Any) -> None:
    gateway = open_gateway(require_keys=True)
    assert gateway.client.get("/livez", headers=_host("ground.example")).status_code == 200
