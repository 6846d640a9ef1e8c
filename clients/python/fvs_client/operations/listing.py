"""Lists, page by page."""

from collections.abc import Iterator
from typing import Generic, TypeVar

import pydantic

from fvs_client import requests
from fvs_client.effects import Emit, Operation
from fvs_client.exchange import exchange, parse
from fvs_client.models.base import Answer
from fvs_client.retries import Retries

M = TypeVar("M", bound=pydantic.BaseModel)


class Page(Answer, Generic[M]):
    """A part of a list; ``next`` continues it."""

    items: tuple[M, ...]
    next: str | None


def every(kind: type[M], path: str, limit: int | None, retries: Retries, session: object) -> Operation[None]:
    """Emit every item of a list; ``limit`` items per request."""
    page_of: type[Page[M]] = Page[kind]  # type: ignore[valid-type]
    after: str | None = None
    while True:
        reply = yield from exchange(requests.list_of(path, after, limit), retries)
        page = parse(page_of, reply.content, session)
        yield from _emit(page.items)
        if page.next is None:
            return
        after = page.next


def _emit(items: tuple[M, ...]) -> Iterator[Emit]:
    for item in items:
        yield Emit(item)
