"""``retryable``, the hints and the documents say the same of every error."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from fvs_service import errors

_ROOT = Path(__file__).parents[3]
_AGAIN = re.compile(r"\b([Tt]ry|[Ss]end (it|them|the (request|image|same bytes)))( \w+)? again|\b[Ww]ait\b")
"""Hints of errors after which the same request can succeed."""
_UNSEEN = {"client-gone", "stale-lease"}
"""Codes that no client gets: it has hung up, or only workers use them."""


def _all_below(kind: type[errors.ServiceError]) -> list[type[errors.ServiceError]]:
    return [kind, *[deeper for child in kind.__subclasses__() for deeper in _all_below(child)]]


_KINDS = {kind.__name__: kind for kind in _all_below(errors.ServiceError)[1:]}


@pytest.mark.parametrize("kind", _KINDS.values(), ids=_KINDS)
def test_the_usual_hint_says_to_try_again_if_that_can_help(kind: type[errors.ServiceError]) -> None:
    if kind.retryable:
        assert re.search(r"\bagain\b|\b[Ww]ait\b", kind.usual_hint)
    else:
        assert not _AGAIN.search(kind.usual_hint)


def _hints() -> Iterator[tuple[str, str, type[errors.ServiceError]]]:
    """Where an error with a hint of its own is made, the literal parts of the hint, and the error."""
    for path in sorted((_ROOT / "services" / "fvs_service").rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            if not isinstance(node, ast.Call):
                continue
            name = getattr(node.func, "attr", getattr(node.func, "id", ""))
            for keyword in node.keywords:
                if name in _KINDS and keyword.arg == "hint":
                    texts = [part.value for part in ast.walk(keyword.value) if isinstance(part, ast.Constant)]
                    yield f"{path.name}:{node.lineno}", " ".join(map(str, texts)), _KINDS[name]


def test_no_hint_says_to_try_again_in_vain() -> None:
    found = list(_hints())
    assert len(found) > 100
    assert not [(where, hint) for where, hint, kind in found if not kind.retryable and _AGAIN.search(hint)]


def test_the_documents_list_every_code_as_it_is() -> None:
    text = (_ROOT / "docs" / "operate" / "failures.md").read_text("utf-8")
    documented = {}
    for line in text[text.index("| code | HTTP |") :].splitlines()[2:]:
        if not line.startswith("|"):
            break
        codes, statuses, rpc_status, retryable, *_ = (cell.strip() for cell in line.strip("|").split("|"))
        names = re.findall(r"`([a-z-]+)`", codes)
        for name, status in zip(names, statuses.split(", "), strict=True):
            documented[name] = (status, rpc_status.strip("`"), retryable)
    expected = {}
    for kind in reversed(_KINDS.values()):
        retryable = "yes" if kind.retryable else "no"
        expected[kind.code] = (str(kind.status), kind.rpc_status, retryable)
    for code in ("foreign-origin", "unknown-host"):  # of browsers, which do not speak gRPC
        expected[code] = (expected[code][0], "–", expected[code][2])
    assert documented == {code: row for code, row in expected.items() if code not in _UNSEEN}
