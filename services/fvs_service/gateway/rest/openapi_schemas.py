"""The schemas of the OpenAPI document, in a form from which generators of clients make usable types.

A model that requests and responses share has two schemas if its fields have defaults: a request may leave
them out, a response always has them. The request's has the model's name, the response's ends in ``Output``.
"""

from collections.abc import Iterator, Mapping
from typing import Any, TypeAlias

Schema: TypeAlias = dict[str, Any]
REFERENCE = "#/components/schemas/{model}"
_OUTPUT = "Output"


def merged(inputs: Mapping[str, Schema], outputs: Mapping[str, Schema]) -> tuple[Schema, dict[str, str]]:
    """All schemas by name, and the new names of those ``outputs`` that differ from the input of that name."""
    for schema in outputs.values():
        if "properties" in schema:
            schema["required"] = list(schema["properties"])
    both = inputs.keys() & outputs.keys()
    differing = {name for name in both if inputs[name] != outputs[name]}
    while more := {name for name in both - differing if not differing.isdisjoint(_referenced(outputs[name]))}:
        differing |= more
    renamed = {name: f"{name}{_OUTPUT}" for name in differing}
    answers = {renamed.get(name, name): schema for name, schema in outputs.items()}
    for schema in answers.values():
        rename(schema, renamed)
    return {**answers, **inputs}, renamed


def rename(node: Any, renamed: Mapping[str, str]) -> None:
    """Replace the names in the references below ``node``."""
    for part in _parts(node):
        reference = part.get("$ref")
        if isinstance(reference, str) and (new := renamed.get(_name(reference))) is not None:
            part["$ref"] = REFERENCE.format(model=new)
        mapping = part.get("discriminator", {}).get("mapping", {})
        for kind, reference in mapping.items():
            mapping[kind] = REFERENCE.format(model=renamed.get(_name(reference), _name(reference)))


def tidy(name: str, schema: Schema) -> None:
    """Give a component its name as title, and its fields neither titles, which repeat names, nor defaults.

    Generators take a field with a default for one that is always there, and cannot read defaults that are
    objects; a default that is a word or a number goes into the description.
    """
    schema["title"] = name
    for part in _parts(schema.get("properties", {})):
        if isinstance(part.get("title"), str):  # else it is a field with this name
            del part["title"]
    for field in schema.get("properties", {}).values():
        default = field.pop("default", None)
        if default not in (None, "", [], {}) and not isinstance(default, dict | list):
            word = str(default).lower() if isinstance(default, bool) else default
            field["description"] = f"{field.get('description', '')} Default: `{word}`.".strip()


def without_null(schema: Schema) -> Schema:
    """The schema of a parameter, which is left out instead of null."""
    kinds = [kind for kind in schema.get("anyOf", ()) if kind.get("type") != "null"]
    if len(kinds) != 1:
        return schema
    return {**{key: value for key, value in schema.items() if key != "anyOf"}, **kinds[0]}


def _referenced(node: Any) -> set[str]:
    return {_name(part["$ref"]) for part in _parts(node) if isinstance(part.get("$ref"), str)}


def _parts(node: Any) -> Iterator[Schema]:
    """All objects of a document, the outer ones first."""
    if isinstance(node, dict):
        yield node
    if isinstance(node, dict | list):
        for inner in node.values() if isinstance(node, dict) else node:
            yield from _parts(inner)


def _name(reference: str) -> str:
    return reference.rpartition("/")[2]
