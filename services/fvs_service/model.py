"""The base of all models on the wire, and their common types."""

from datetime import UTC, datetime
from typing import Annotated, Generic, TypeVar

from pydantic import AwareDatetime, BeforeValidator, Field, ValidationInfo
from pydantic_core import PydanticCustomError

from fvs_engine.records import Record


class Model(Record):
    """Base of requests and responses. Docstrings of fields become descriptions in the OpenAPI document."""


Number = Annotated[float, Field(strict=True, allow_inf_nan=False)]
"""A finite number; strings are not converted."""


def _whole(value: object) -> object:
    return int(value) if isinstance(value, float) and value.is_integer() else value


WHOLE = BeforeValidator(_whole)
"""Reads ``3.0`` as 3, which is the same in JSON. After a strict ``Field`` with the range, so that the OpenAPI
document has the range too."""
Count = Annotated[int, Field(strict=True, ge=0), WHOLE]
PositiveNumber = Annotated[Number, Field(gt=0)]
Triple = tuple[Number, Number, Number]
"""Coordinates that the service computed."""
DIGEST = r"^sha256:[0-9a-f]{64}$"
Digest = Annotated[str, Field(pattern=DIGEST)]
"""The SHA-256 of an image's bytes."""
Timestamp = AwareDatetime


OF_FIELDS = "of_fields"
"""The type of errors that are about several fields, which ``fields`` of their context names."""


def within(limit: str | int) -> BeforeValidator:
    """Refuse lists longer than this one of ``Limits``, or number, before any of their items is validated.

    The limits are those of the validation's context; without it there is none. ``fail_fast`` belongs to
    it: else every invalid item of a list becomes an error.
    """

    def check(value: object, info: ValidationInfo) -> object:
        limits = (info.context or {}).get("limits")
        most = limit if isinstance(limit, int) else None if limits is None else getattr(limits, limit)
        if most is not None and isinstance(value, list) and len(value) > most:
            raise ValueError(
                f"there are {len(value)}, and {most} are allowed: split them into several requests"
            )
        return value

    return BeforeValidator(check)


def of_fields(message: str, *fields: str) -> PydanticCustomError:
    """The error of a model's validator for ``fields`` that contradict each other, or are missing together."""
    return PydanticCustomError(OF_FIELDS, "{message}", {"message": message, "fields": fields})


_AFTER = "The `next` of the previous page."
_LIMIT = "Items of the page. It has no more than `limits.page_items` of the capabilities."
"""Parameters of a query have the descriptions of their fields, and not those of the JSON schema."""


class Page(Model):
    """A page of a list: ``limit`` items after the one with the cursor ``after``."""

    after: str | None = Field(default=None, max_length=128, description=_AFTER)
    limit: int = Field(default=100, ge=1, le=1000, description=_LIMIT)


ItemT = TypeVar("ItemT", bound=Model)


class Listing(Model, Generic[ItemT]):
    """A page of a list."""

    items: tuple[ItemT, ...]
    """The items of this page."""
    next: str | None
    """The cursor of the next page; null on the last one."""


def now() -> datetime:
    """The current time in UTC."""
    return datetime.now(UTC)
