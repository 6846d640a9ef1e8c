"""Common parts of requests: idempotency keys, digests. All raise ``InvalidRequestError``."""

from typing import Annotated

from google.protobuf.message import Message
from pydantic import Field

from fvs_schema.base import Model
from fvs_schema.names import Digest
from fvs_service.gateway.rpc.conversion import pick


class _Keyed(Model):
    idempotency_key: Annotated[str | None, Field(min_length=1, max_length=255, pattern=r"^[\x21-\x7e]+$")] = (
        None
    )


class _OfImage(Model):
    digest: Digest


def idempotency_key(request: Message) -> str | None:
    """The idempotency key of a request; None without one."""
    return pick(_Keyed, request).idempotency_key


def digest_of(request: Message) -> str:
    """The digest of the image that a request names."""
    return pick(_OfImage, request).digest
