"""Types of fields of ``fvs.v1`` and of schemas of the OpenAPI document, in one notation.

A type is the name of a JSON type, model or enum; ``("list", type)`` or ``("map", type)``; or the set of a
union's models, or of an enum's words where the document gives it no name.
"""

from collections.abc import Collection, Iterator, Mapping
from typing import Any, TypeAlias

from contract_outcome import rest_word
from google.protobuf.descriptor import FieldDescriptor

Type: TypeAlias = "str | frozenset[Type] | tuple[str, Type]"

_SCALARS = {
    FieldDescriptor.TYPE_DOUBLE: "number",
    FieldDescriptor.TYPE_INT32: "integer",
    FieldDescriptor.TYPE_INT64: "integer",
    FieldDescriptor.TYPE_BOOL: "boolean",
    FieldDescriptor.TYPE_STRING: "string",
}
"""The only scalars of models: a float is less exact than JSON's number."""
_UNIONS = frozenset({"kind", "pose"})


def type_of_field(field: Any, unnamed: Collection[str]) -> Type:
    """The type of a field; ``unnamed`` are the enums whose words stand for them."""
    one: Type
    if field.message_type is not None and field.message_type.GetOptions().map_entry:
        return ("map", type_of_field(field.message_type.fields_by_name["value"], unnamed))
    if field.enum_type is not None:
        enum = field.enum_type
        words = (rest_word(enum, value.number) for value in enum.values if value.number)
        one = frozenset(words) if enum.name in unnamed else enum.name
    elif field.message_type is not None:
        one = _type_of_message(field.message_type, unnamed)
    else:
        one = _SCALARS.get(field.type, f"proto type {field.type}")
    return ("list", one) if field.is_repeated else one


def _type_of_message(message: Any, unnamed: Collection[str]) -> Type:
    if [field.name for field in message.fields] == ["items"]:
        return type_of_field(message.fields[0], unnamed)
    if _UNIONS & set(message.oneofs_by_name):
        return frozenset(_type_of_message(field.message_type, unnamed) for field in message.fields)
    return str(message.name)


def type_of_schema(schema: Mapping[str, Any]) -> Type:
    """The type of a JSON schema; null, which is an absent field, does not count."""
    if "$ref" in schema:
        return str(schema["$ref"]).rpartition("/")[2]
    if "enum" in schema:
        return frozenset(schema["enum"])
    found = schema.get("anyOf") or schema.get("oneOf") or schema.get("prefixItems")
    if found is not None:
        kinds = frozenset(type_of_schema(part) for part in found if part.get("type") != "null")
        one = next(iter(kinds)) if len(kinds) == 1 else kinds
        return ("list", one) if "prefixItems" in schema else one
    if schema["type"] == "array":
        return ("list", type_of_schema(schema["items"]))
    if schema.get("format") == "date-time":
        return "Timestamp"
    if isinstance(schema.get("additionalProperties"), dict):
        return ("map", type_of_schema(schema["additionalProperties"]))
    return "Struct" if schema["type"] == "object" else str(schema["type"])


def fits(of_schema: Type, of_field: Type) -> bool:
    """Whether the field has the schema's type; a union may have more members than one use of it allows.

    Words that grow in number, such as the methods of rankings, are strings.
    """
    if of_field == "string" and isinstance(of_schema, frozenset):
        return all(isinstance(word, str) for word in of_schema)
    if isinstance(of_schema, tuple) and isinstance(of_field, tuple):
        return of_schema[0] == of_field[0] and fits(of_schema[1], of_field[1])
    if isinstance(of_schema, frozenset) and isinstance(of_field, frozenset):
        return of_schema <= of_field
    return of_schema == of_field


def other_types(
    schemas: Mapping[str, Any], messages: Mapping[str, Any], unnamed: Collection[str]
) -> Iterator[str]:
    """The fields of ``messages`` whose type is not that of the property of their model."""
    for name in sorted(schemas.keys() & messages.keys()):
        properties = schemas[name].get("properties", {})
        for field in messages[name].fields:
            if field.name in properties:
                theirs, ours = type_of_schema(properties[field.name]), type_of_field(field, unnamed)
                if not fits(theirs, ours):
                    yield f"{name}.{field.name}"
