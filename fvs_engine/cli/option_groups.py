"""Options that several commands share, written once as the fields of a dataclass."""

import dataclasses
import inspect
from collections.abc import Callable
from copy import copy
from typing import Any, get_type_hints


def with_option_groups(**defaults_shown: str) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Expand a command's dataclass parameters into Typer options, one per field.

    Fields are annotated like parameters of a Typer command. ``defaults_shown``: field name → the default
    value that the help shows, for fields whose default depends on the command.
    """

    def decorate(command: Callable[..., None]) -> Callable[..., None]:
        own = inspect.signature(command, eval_str=True).parameters.values()
        groups: dict[str, Any] = {p.name: p.annotation for p in own if dataclasses.is_dataclass(p.annotation)}
        parameters: list[inspect.Parameter] = []
        for parameter in own:
            group = groups.get(parameter.name)
            parameters += [parameter] if group is None else _fields(group, defaults_shown)

        def expanded(**given: Any) -> None:
            for name, group in groups.items():
                fields = (field.name for field in dataclasses.fields(group))
                given[name] = group(**{field: given.pop(field) for field in fields})
            command(**given)

        expanded.__name__, expanded.__doc__ = command.__name__, command.__doc__
        keyword_only = [p.replace(kind=inspect.Parameter.KEYWORD_ONLY) for p in parameters]
        expanded.__signature__ = inspect.Signature(keyword_only)  # type: ignore[attr-defined]
        expanded.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
        return expanded

    return decorate


def _fields(group: Any, defaults_shown: dict[str, str]) -> list[inspect.Parameter]:
    hints = get_type_hints(group, include_extras=True)
    parameters = []
    for field in dataclasses.fields(group):
        annotation = hints[field.name]
        if field.name in defaults_shown:
            option = copy(annotation.__metadata__[0])
            option.show_default = defaults_shown[field.name]
            annotation = annotation.__class__(annotation.__origin__, (option,))
        default = inspect.Parameter.empty if field.default is dataclasses.MISSING else field.default
        parameters.append(
            inspect.Parameter(
                field.name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=annotation
            )
        )
    return parameters
