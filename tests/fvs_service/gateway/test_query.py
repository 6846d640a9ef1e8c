"""Every route refuses parameters that it does not have."""

from collections.abc import Iterator
from typing import Any

import pytest


def _routes(document: dict[str, Any]) -> Iterator[tuple[str, str]]:
    for path, operations in document["paths"].items():
        for method in operations:
            yield method.upper(), path


def test_every_route_refuses_an_unknown_parameter(gateway: Any) -> None:
    ids = {"scene_id": gateway.scene(), "hexadecimal": "0" * 64, "image": "render"}
    routes = list(_routes(gateway.client.get("/openapi.json").json()))
    assert len(routes) > 40
    for method, path in routes:
        parts = path.replace("{", "\0{").replace("}", "}\0").split("\0")
        url = "".join(ids.get(part[1:-1], "x_none") if part.startswith("{") else part for part in parts)
        headers = {"Tus-Resumable": "1.0.0"} if url.startswith("/v1/uploads") else {}
        answer = gateway.client.request(method, url, params={"colour": "red"}, headers=headers)
        assert answer.status_code == 422, (method, path, answer.text)
        if method != "HEAD":
            problem = answer.json()
            assert problem["code"] == "invalid-request"
            assert problem["detail"] == "There is no parameter 'colour'."
            assert problem["errors"] == [{"field": "colour", "message": "there is no such parameter"}]


def test_the_hint_names_the_parameters_that_there_are(gateway: Any) -> None:
    lists = gateway.client.get("/v1/scenes", params={"offset": 3}).json()
    assert "after" in lists["hint"]
    assert "limit" in lists["hint"]
    assert "none here" in gateway.client.get("/v1/capabilities", params={"verbose": 1}).json()["hint"]


@pytest.mark.parametrize("path", ["/v1/scenes?limit=1&limit=2", "/readyz?workers=0&workers=1"])
def test_a_parameter_is_given_once(gateway: Any, path: str) -> None:
    problem = gateway.client.get(path).json()
    assert (problem["status"], problem["errors"][0]["message"]) == (422, "it is given twice")


def test_who_has_no_key_learns_nothing_of_the_parameters(open_gateway: Any) -> None:
    gateway = open_gateway(require_keys=True)
    assert gateway.client.get("/v1/scenes", params={"colour": "red"}).status_code == 401
