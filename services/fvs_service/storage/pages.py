"""Pages of lists: their order, and the cursors that continue them.

A cursor has the number and the id of the last item of its page, so it stays valid when that item is deleted.
It is of one list with the same filters, and refused for others.
"""

import base64
import binascii
import hashlib
import re
import struct
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, TypeVar

from sqlalchemy import Row, Select
from sqlalchemy.orm import Session

from fvs_schema.base import Page
from fvs_schema.error_codes import FieldError
from fvs_service.errors import InvalidRequestError
from fvs_service.storage.tables import Recorded

T = TypeVar("T")
RowT = TypeVar("RowT", bound=Recorded)

_NUMBER = struct.Struct(">q")
_SUM_BYTES = 8
_ID = re.compile(rb"[a-z0-9_]{0,40}")
_HINT = "Send the `next` of a page of this list with the same filters; without `after`, the first page comes."


class Place(NamedTuple):
    """Where an item is in a list, by its number, and by its id where numbers are equal."""

    number: int
    id: str = ""


class Cursors:
    """The cursors of one list, which ``about`` names with its filters."""

    def __init__(self, *about: str) -> None:
        self._about = "\n".join(about).encode()

    def write(self, place: Place) -> str:
        """The cursor of what follows ``place``."""
        content = _NUMBER.pack(place.number) + place.id.encode()
        return base64.urlsafe_b64encode(self._sum(content) + content).decode().rstrip("=")

    def read(self, cursor: str | None) -> Place | None:
        """The place of a cursor, None for the first page; raises ``InvalidRequestError``."""
        if cursor is None:
            return None
        try:
            found = base64.b64decode(cursor + "=" * (-len(cursor) % 4), altchars=b"-_", validate=True)
        except (binascii.Error, ValueError):
            raise _invalid() from None
        checksum, content = found[:_SUM_BYTES], found[_SUM_BYTES:]
        number, item_id = content[: _NUMBER.size], content[_NUMBER.size :]
        if checksum != self._sum(content) or len(number) < _NUMBER.size or not _ID.fullmatch(item_id):
            raise _invalid()
        return Place(_NUMBER.unpack(number)[0], item_id.decode())

    def _sum(self, content: bytes) -> bytes:
        return hashlib.sha256(self._about + b"\n" + content).digest()[:_SUM_BYTES]


def cut(found: Sequence[T], limit: int, cursor: Callable[[T], str]) -> tuple[Sequence[T], str | None]:
    """The first ``limit`` of ``found``, and the cursor of the rest, if there is any."""
    items = found[:limit]
    return items, cursor(items[-1]) if len(found) > limit else None


def newest_first(
    session: Session, query: Select[RowT], kind: type[RowT], page: Page, cursors: Cursors
) -> tuple[Sequence[RowT], str | None]:
    """The rows of a page of ``query``, and the cursor of the next one; raises ``InvalidRequestError``."""
    rows = session.scalars(_ordered(query, kind, page, cursors)).all()
    return cut(rows, page.limit, lambda row: cursors.write(Place(row.recorded_at_ms, row.id)))


def newest_columns(
    session: Session, query: Select[Any], kind: type[Recorded], page: Page, cursors: Cursors
) -> tuple[Sequence[Row[Any]], str | None]:
    """As ``newest_first``, of a query for columns, among them ``id`` and ``recorded_at_ms``."""
    rows = session.execute(_ordered(query, kind, page, cursors)).all()
    return cut(rows, page.limit, lambda row: cursors.write(Place(row.recorded_at_ms, row.id)))


def _ordered(query: Select[Any], kind: type[Recorded], page: Page, cursors: Cursors) -> Select[Any]:
    last = cursors.read(page.after)
    if last is not None:
        query = query.where(kind.in_order() < last)
    return query.order_by(*kind.newest_first()).limit(page.limit + 1)


def _invalid() -> InvalidRequestError:
    wrong = FieldError("after", "it is not a cursor of this list")
    return InvalidRequestError(f"{wrong.field}: {wrong.message}.", hint=_HINT, errors=(wrong,))
