"""Common parts of requests: pages, idempotency keys, digests. All raise ``InvalidRequestError``."""

from typing import Annotated, TypeVar

from google.protobuf.message import Message
from pydantic import Field

from fvs_schema.base import Model, Page
from fvs_schema.names import Digest
from fvs_schema.service import Limits
from fvs_service.gateway.rpc.conversion import pick

PageT = TypeVar("PageT", bound=Page)


class _Keyed(Model):
    idempotency_key: Annotated[str | None, Field(min_length=1, max_length=255, pattern=r"^[\x21-\x7e]+$")] = (
        None
    )


class _OfImage(Model):
    digest: Digest


def page_of(kind: type[PageT], request: Message, limits: Limits) -> PageT:
    """The page that a request asks for, no longer than the limits allow."""
    page = pick(kind, request)
    return page.model_copy(update={"limit": min(page.limit, limits.page_items)})


def idempotency_key(request: Message) -> str | None:
    """The idempotency key of a request; None without one."""
    return pick(_Keyed, request).idempotency_key


def digest_of(request: Message) -> str:
    """The digest of the image that a request names."""
    return pick(_OfImage, request).digest
