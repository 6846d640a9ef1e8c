"""Pages that are generated from the code when the site is built, so that they are never out of date.

A hook of MkDocs (``hooks:`` in ``mkdocs.yml``).
"""

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import typer
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files

Json = dict[str, Any]


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the generated pages."""
    from fvs_client.cli.app import app as fvs_client

    from fvs_engine.cli.app import app as fvs

    pages = {
        "reference/rest.md": rest(_openapi()),
        "reference/fvs.md": commands("fvs", fvs),
        "reference/fvs-client.md": commands("fvs-client", fvs_client),
        "reference/engine.md": engine(Path(config.config_file_path).parent / "fvs_engine"),
    }
    for path, content in pages.items():
        files.append(File.generated(config, path, content=content))
    return files


def commands(name: str, app: typer.Typer) -> str:
    """The reference of a command line: usage, arguments and options of every command."""
    group: Any = typer.main.get_command(app)
    lines = [f"# {name}", "", _sentence(group.help), ""]
    if name == "fvs":
        lines += ["`-h` or `--help` after any command prints this reference.", ""]
    lines += _options(group.context_class(group, info_name=name), group)
    lines += _commands(group, name, level=2)
    lines += [f"Exit statuses: [exit statuses](exit-statuses.md#{name}).", ""]
    return "\n".join(lines)


def _commands(group: Any, prefix: str, level: int) -> Iterator[str]:
    for name, command in group.commands.items():
        full = f"{prefix} {name}"
        yield from (f"{'#' * level} {full}", "", _sentence(command.help), "")
        context = command.context_class(command, info_name=full)
        if hasattr(command, "commands"):
            yield from _commands(command, full, level + 1)
            continue
        usage = " ".join(piece for piece in command.collect_usage_pieces(context) if piece)
        yield from ("```text", f"{full} {usage}", "```", "")
        yield from _options(context, command)


def _options(context: Any, command: Any) -> Iterator[str]:
    rows = []
    for parameter in command.get_params(context):
        record = parameter.get_help_record(context)
        if "--help" in parameter.opts:
            continue
        if record is not None:
            rows.append(record)
        elif parameter.param_type_name == "argument":
            rows.append((parameter.make_metavar(context), getattr(parameter, "help", "") or ""))
    if rows:
        yield from ("| argument or option | meaning |", "|---|---|")
        for names, meaning in rows:
            yield f"| `{_cell(names)}` | {_cell(meaning)} |"
        yield ""


def rest(document: Json) -> str:
    """The reference of the REST interface, from its OpenAPI document."""
    lines = [
        "# REST",
        "",
        "Made from the OpenAPI document, which a running service serves at `/openapi.json`.",
        "",
        document["info"]["description"].strip(),
        "",
        "| route | what it does |",
        "|---|---|",
    ]
    operations = [
        (f"{method.upper()} {path}", operation)
        for path, methods in document["paths"].items()
        for method, operation in methods.items()
    ]
    for route, operation in operations:
        lines.append(f"| [`{route}`](#{_anchor(operation)}) | {_sentence(operation['description'])} |")
    lines.append("")
    schemas: Json = document["components"]["schemas"]
    for route, operation in operations:
        lines += [f"## {operation['summary']} {{ #{_anchor(operation)} }}", "", f"`{route}`", ""]
        lines += [operation["description"], ""]
        lines += _parameters(operation.get("parameters", []))
        lines += _body(operation.get("requestBody", {}), schemas)
        lines += _responses(operation["responses"])
    lines += ["## Schemas", ""]
    for name, schema in schemas.items():
        lines += [f"### {name}", "", _sentence(schema.get("description", "")), ""]
        lines += _properties(schema)
        if "enum" in schema:
            lines += [", ".join(f"`{value}`" for value in schema["enum"]), ""]
    return "\n".join(lines)


def engine(folder: Path) -> str:
    """The reference of the engine: what its packages export, and its modules at the top."""
    exporting = [
        f"fvs_engine.{path.parent.name}"
        for path in sorted(folder.glob("*/__init__.py"))
        if "__all__" in path.read_text(encoding="utf-8")
    ]
    modules = [
        ".".join(path.relative_to(folder.parent).with_suffix("").parts)
        for pattern in ("*.py", "pipeline/*.py", "select/*.py", "splat/*.py")
        for path in sorted(folder.glob(pattern))
        if path.stem != "__init__"
    ]
    lines = [
        "# Engine",
        "",
        "`fvs_engine` is a plain library: no web, no database, no queue. These are the names that its",
        "packages export. Shapes, units and errors are in the docstrings; frames are those of",
        "[frames](../how/frames.md).",
        "",
    ]
    for name in [*exporting, *modules]:
        lines += [f"::: {name}", ""]
    return "\n".join(lines)


def _openapi() -> Json:
    from fvs_service.application import Backend
    from fvs_service.gateway.rest.app import create_app
    from fvs_service.settings import Settings

    def never(_: Any) -> Any:
        raise AssertionError("the document needs no backend")

    document: Json = create_app(Settings(), Backend(engine=never, runners=never)).openapi()
    return document


def _anchor(operation: Json) -> str:
    return str(operation["summary"]).lower().replace(" ", "-")


def _parameters(parameters: list[Json]) -> Iterator[str]:
    if parameters:
        yield from ("| parameter | in | type | meaning |", "|---|---|---|---|")
        for parameter in parameters:
            name = f"`{parameter['name']}`" + (" (required)" if parameter.get("required") else "")
            schema = parameter["schema"]
            meaning = _cell(parameter.get("description") or schema.get("description", ""))
            yield f"| {name} | {parameter['in']} | {_type(schema)} | {meaning} |"
        yield ""


def _body(body: Json, schemas: Json) -> Iterator[str]:
    for media_type, content in body.get("content", {}).items():
        schema = content["schema"]
        yield from (f"Body: `{media_type}`, {_type(schema)}", "")
        examples = schemas.get(str(schema.get("$ref", "")).rsplit("/", 1)[-1], {}).get("examples", [])
        for example in examples:
            yield from ("```json", json.dumps(example, indent=2), "```", "")


def _responses(responses: Json) -> Iterator[str]:
    yield from ("| status | body | meaning |", "|---|---|---|")
    for status, response in responses.items():
        bodies = [
            f"`{media_type}`" + (f", {_type(content['schema'])}" if content.get("schema") else "")
            for media_type, content in response.get("content", {}).items()
        ]
        yield f"| {status} | {'; '.join(bodies) or 'none'} | {_cell(response.get('description', ''))} |"
    yield ""


def _properties(schema: Json) -> Iterator[str]:
    properties: Json = schema.get("properties", {})
    if properties:
        required = schema.get("required", [])
        yield from ("| property | type | meaning |", "|---|---|---|")
        for name, inner in properties.items():
            shown = f"`{name}`" + (" (required)" if name in required else "")
            default = f" Default: `{json.dumps(inner['default'])}`." if "default" in inner else ""
            yield f"| {shown} | {_type(inner)} | {_cell(inner.get('description', ''))}{_cell(default)} |"
        yield ""


def _type(schema: Mapping[str, Any]) -> str:
    """A schema in a few words, with links to the named ones."""
    if "$ref" in schema:
        name = str(schema["$ref"]).rsplit("/", 1)[-1]
        return f"[{name}](#{name.lower()})"
    for choice in ("anyOf", "oneOf", "allOf"):
        if choice in schema:
            return " or ".join(_type(inner) for inner in schema[choice])
    if "const" in schema:
        return f"`{json.dumps(schema['const'])}`"
    if "enum" in schema:
        return ", ".join(f"`{value}`" for value in schema["enum"])
    if schema.get("type") == "array":
        items = schema.get("items") or {}
        inner = _type(items) if items else " × ".join(_type(part) for part in schema.get("prefixItems", ()))
        return f"array of {inner}"
    bounds = [
        f"{sign} {schema[key]:g}"
        for key, sign in (("minimum", "≥"), ("exclusiveMinimum", ">"), ("maximum", "≤"))
        if isinstance(schema.get(key), int | float)
    ]
    kind = str(schema.get("format") or schema.get("type", "any"))
    return kind + (f" ({', '.join(bounds)})" if bounds else "")


def _sentence(text: str | None) -> str:
    return " ".join((text or "").split())


def _cell(text: str) -> str:
    return _sentence(text).replace("|", "\\|").replace("<", "&lt;")
