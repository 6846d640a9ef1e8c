"""What a browser finds at `/docs`, and at `/` without the console."""

import re
from html.parser import HTMLParser
from typing import Any

from fvs_service.gateway.rest.docs_page import docs_page


class _Page(HTMLParser):
    """The ids of a page, and what it refers to."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.ids: set[str] = set()
        self.links: set[str] = set()
        self.tags: set[str] = set()
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = {name: value or "" for name, value in attrs}
        self.tags.add(tag)
        self.ids |= {given["id"]} if "id" in given else set()
        self.links |= {given[name] for name in ("href", "src") if name in given}


def test_the_start_leads_to_the_documents_without_a_key(open_gateway: Any) -> None:
    gateway = open_gateway(require_keys=True, console=False)
    start = gateway.client.get("/").json()
    assert start["version"] == gateway.client.get(start["openapi"]).json()["info"]["version"]
    page = gateway.client.get(start["docs"])
    assert page.status_code == 200
    browser = gateway.client.get("/", headers={"Accept": "text/html,*/*;q=0.8"}, follow_redirects=False)
    assert (browser.status_code, browser.headers["Location"]) == (307, start["docs"])
    assert gateway.client.get("/", params={"color": "red"}).status_code == 422


def test_the_page_describes_every_operation_and_schema(gateway: Any) -> None:
    document = gateway.client.get("/openapi.json").json()
    answer = gateway.client.get("/docs")
    page = _Page(answer.text)
    assert answer.headers["Content-Type"] == "text/html; charset=utf-8"
    assert {f"schema-{name}" for name in document["components"]["schemas"]} <= page.ids
    for path, operations in document["paths"].items():
        for method in operations:
            assert f"<b>{method.upper()}</b> <code>{path}</code>" in answer.text
    assert """-d '{"name": "north quarry"}'""" in answer.text.replace("&quot;", '"').replace("&#x27;", "'")
    for link in page.links - {"/openapi.json"}:
        assert link.startswith("#"), link
        assert link[1:] in page.ids, link


def test_the_page_needs_nothing_but_itself(gateway: Any) -> None:
    answer = gateway.client.get("/docs")
    assert not {"script", "link", "img", "iframe"} & _Page(answer.text).tags
    assert "default-src 'none'" in answer.headers["Content-Security-Policy"]
    assert not re.search(
        r"\bstyle=|\bon\w+=|https?://(?!hooks\.example)", answer.text.partition("</style>")[2]
    )


def test_descriptions_cannot_add_elements() -> None:
    schema = {"description": "<script>alert(1)</script>", "properties": {"<b>": {"type": "string"}}}
    document = {
        "info": {"title": "<i>", "version": "1", "description": "1. `<a>`\n2. b"},
        "tags": [],
        "paths": {},
        "components": {"schemas": {"A": schema}},
    }
    page = docs_page(document)
    assert not {"script", "b", "i", "a>"} & _Page(page).tags
    assert "<li><code>&lt;a&gt;</code></li><li>b</li>" in page
