"""The environment as a source of settings."""

import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from pydantic import BaseModel
from pydantic.fields import FieldInfo
from pydantic_settings import BaseSettings, EnvSettingsSource, PydanticBaseSettingsSource

PREFIX = "FVS_"
_FILE = "_FILE"
OF_OTHERS = frozenset(
    {
        *("FVS_URL", "FVS_API_KEY"),  # the client's
        *("FVS_SCENE", "FVS_SNAPSHOT", "FVS_RANKING"),  # of the checks in docs/operate/verify.md
        *("FVS_DATA", "FVS_REQUIRE_DATA", "FVS_TEST_DATABASE", "FVS_DOCS_WHOLE"),  # of tests and documents
    }
)
"""Variables with the prefix of the settings that other parts of this project read."""


def variables_of(model: type[BaseModel], prefix: str = PREFIX) -> Iterator[str]:
    """The names of the variables for the fields of ``model`` and of the models in them."""
    for name, field in model.model_fields.items():
        variable = prefix + name.upper()
        yield variable
        if inner := _inner(field):
            yield from variables_of(inner, f"{variable}__")


def _inner(field: FieldInfo) -> type[BaseModel] | None:
    kind = field.annotation
    return kind if isinstance(kind, type) and issubclass(kind, BaseModel) else None


class ValuesOfEnvironment(EnvSettingsSource):
    """Values of variables, except those that name files: a nested model would refuse their names."""

    def _load_env_vars(self) -> Mapping[str, Any]:
        values = super()._load_env_vars()
        return {name: value for name, value in values.items() if not name.upper().endswith(_FILE)}


class FilesOfEnvironment(EnvSettingsSource):
    """Values of variables from files, for secrets: ``FVS_DATABASE_URL_FILE``."""

    def _load_env_vars(self) -> Mapping[str, Any]:
        named = {name: file for name, file in os.environ.items() if name.startswith(PREFIX)}
        return {
            name.removesuffix(_FILE).lower(): Path(file).read_text(encoding="utf-8").strip()
            for name, file in named.items()
            if name.endswith(_FILE)
        }


class UnknownOfEnvironment(PydanticBaseSettingsSource):
    """Variables with the prefix that are no settings: the model forbids them like any other extra value.

    pydantic-settings looks only for the names that it knows, so a misspelt one would have no effect. Within
    a nested model it refuses them itself.
    """

    def __init__(self, settings: type[BaseSettings]) -> None:
        super().__init__(settings)
        self._known = OF_OTHERS | set(variables_of(settings))
        self._nested = {name for name, field in settings.model_fields.items() if _inner(field)}

    def get_field_value(self, field: FieldInfo, field_name: str) -> tuple[Any, str, bool]:  # noqa: ARG002
        """No value: this source has none of a known field."""
        return None, field_name, False

    def __call__(self) -> dict[str, Any]:
        """The names of unknown variables without the prefix; their values may be secret, so they stay out."""
        variables = (name.upper().removesuffix(_FILE) for name in os.environ)
        unknown = {name for name in variables if name.startswith(PREFIX)} - self._known
        names = (name.removeprefix(PREFIX).lower() for name in unknown)
        return {name: None for name in names if name.partition("__")[0] not in self._nested}
