"""Checks that several inputs share: errors about several fields, and lists of a bounded length."""

from collections.abc import Iterable

from pydantic import BeforeValidator, ValidationInfo
from pydantic_core import PydanticCustomError

from fvs_schema.mistakes import OF_FIELDS


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


def require_different(ids: Iterable[str], field: str) -> None:
    """Raise the error of a model's validator unless all ids of the items in ``field`` are different."""
    twice = repeated(ids)
    if twice is not None:
        raise of_fields(f"two {field} have the id {twice}", field)


def repeated(items: Iterable[str]) -> str | None:
    """The first item that was there before; None when all are different."""
    seen: set[str] = set()
    for item in items:
        if item in seen:
            return item
        seen.add(item)
    return None
