"""Pages that are generated from the code when the site is built, so that they are never out of date.

A hook of MkDocs (``hooks:`` in ``mkdocs.yml``). Pages that others link to begin with a file of the same
name, which says where else their content is: links work in the repository, too.
"""

import ast
import json
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import typer
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files

Json = dict[str, Any]

ENGINE_PACKAGES = (
    "pipeline",
    "select",
    "lab.evaluate",
    "lab.baselines",
    "score",
    "plan",
    "splat",
    "control",
    "export",
    "scene",
    "sfm",
    "lab.simulate",
    "images",
    "video",
    "geometry",
)
_CLIENT = """::: fvs_client

## The spool

[The spool](../how/spool.md) sends what a camera writes; these are its classes for programs.

::: fvs_client.spool
"""


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """Put every design note into the navigation."""
    notes = [f"design/{path.name}" for path in _notes(Path(config.docs_dir) / "design")]
    for section in config.nav or ():
        if "Design notes" in section:
            section["Design notes"] = ["design/index.md", *notes]
    return config


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the generated pages."""
    from fvs_client.cli.app import app as fvs_client

    from fvs_engine.cli.app import app as fvs

    pages = {
        "reference/rest.md": rest(_openapi()),
        "reference/fvs.md": commands("fvs", fvs),
        "reference/fvs-client.md": commands("fvs-client", fvs_client),
        "reference/settings.md": settings(),
        "reference/findings.md": findings(),
        "reference/client.md": _CLIENT,
        "design/index.md": design_notes(Path(config.docs_dir) / "design"),
        **engine(Path(config.config_file_path).parent / "fvs_engine"),
    }
    for path, content in pages.items():
        begun = files.get_file_from_path(path)
        if begun is not None:
            content = f"{begun.content_string}\n{content}"
            files.remove(begun)
        files.append(File.generated(config, path, content=content))
    return files


def settings() -> str:
    """All settings of the service, with their defaults and ranges, from their docstrings."""
    from fvs_service.settings import Settings

    from fvs_schema.field_docstrings import field_docstrings
    from fvs_schema.service import Limits

    modules = (Settings.__module__, Limits.__module__)
    docstrings = {kind: fields for module in modules for kind, fields in field_docstrings(module).items()}
    schema = Settings.model_json_schema()
    groups: dict[str, tuple[str, Json]] = {"FVS_": (Settings.__name__, {})}
    for name, field in schema["properties"].items():
        if "$ref" in field:
            kind = field["$ref"].rsplit("/", 1)[-1]
            groups[f"FVS_{name.upper()}__"] = (kind, schema["$defs"][kind]["properties"])
        else:
            groups["FVS_"][1][name] = field
    variables = {name: prefix + name.upper() for prefix, (_, fields) in groups.items() for name in fields}
    lines: list[str] = []
    for prefix, (kind, fields) in groups.items():
        lines += ["", f"## {prefix}…", "", "| variable | default | values | meaning |", "|---|---|---|---|"]
        for name, field in fields.items():
            default = field.get("default")
            shown = "" if default in (None, []) else f"`{json.dumps(default).strip(chr(34))}`"
            meaning = re.sub(
                r"``(.+?)``", lambda name: f"`{variables.get(name[1], name[1])}`", docstrings[kind][name]
            )
            lines.append(
                f"| `{prefix}{name.upper()}` | {shown} | {_cell(_values(field))} | {_cell(meaning)} |"
            )
    return "\n".join(lines)


def findings() -> str:
    """The sentence and the hint of every finding; words in angle brackets are its data."""
    from fvs_engine.wording import WORDING

    lines = ["| code | message | hint |", "|---|---|---|"]
    for code, wording in WORDING.items():
        message, hint = (re.sub(r"\{(\w+)(?::[^}]*)?\}", r"‹\1›", part) for part in wording)
        lines.append(f"| `{code}` | {_cell(message)} | {_cell(hint)} |")
    return "\n".join(lines)


def _values(field: Json) -> str:
    """The values that a setting may have."""
    kinds = [kind for kind in field.get("anyOf", [field]) if kind.get("type") != "null"]
    if "enum" in kinds[0]:
        return ", ".join(f"`{value}`" for value in kinds[0]["enum"])
    if "minimum" in kinds[0]:
        return f"{kinds[0]['minimum']:,} to {kinds[0]['maximum']:,}"
    return {"boolean": "`true`, `false`", "array": "a list with commas"}.get(kinds[0]["type"], "text")


def design_notes(folder: Path) -> str:
    """The list of design notes, by their titles."""
    titles = {path: path.read_text(encoding="utf-8").split("\n", 1)[0] for path in _notes(folder)}
    return "\n".join([f"- [{title.removeprefix('# ')}]({path.name})" for path, title in titles.items()])


def _notes(folder: Path) -> list[Path]:
    """The design notes, without the page that lists them."""
    return [path for path in sorted(folder.glob("*.md")) if path.stem != "index"]


def commands(name: str, app: typer.Typer) -> str:
    """The reference of a command line: usage, arguments and options of every command."""
    group: Any = typer.main.get_command(app)
    lines = ["| command | what it does |", "|---|---|"]
    lines += [
        f"| [`{name} {inner}`](#{name}-{inner}) | {_cell(command.help)} |"
        for inner, command in group.commands.items()
    ]
    lines += ["", *_options(group.context_class(group, info_name=name), group)]
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
            yield f"| `{_sentence(names)}` | {_cell(meaning)} |"
        yield ""


def rest(document: Json) -> str:
    """The reference of the REST interface, from its OpenAPI document."""
    lines = [
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


def engine(folder: Path) -> dict[str, str]:
    """Pages of the engine's reference, by path: the modules at its top, and a page for each package."""
    pages = {"reference/engine/index.md": "\n".join(_modules(folder, "fvs_engine"))}
    for package in ENGINE_PACKAGES:
        inside = folder / package.replace(".", "/")
        summary = (ast.get_docstring(ast.parse((inside / "__init__.py").read_text("utf-8"))) or "").strip()
        page = [f"# {package}", "", summary, "", *_modules(inside, f"fvs_engine.{package}")]
        pages[f"reference/engine/{package}.md"] = "\n".join(page)
    return pages


def _modules(folder: Path, package: str) -> Iterator[str]:
    for path in sorted(folder.glob("*.py")):
        if path.stem != "__init__" and not path.stem.startswith("_"):
            yield from (f"::: {package}.{path.stem}", "")


def _openapi() -> Json:
    from fvs_service.serving.rest_app import create_app
    from fvs_service.settings import Settings

    def never(_: Any) -> Any:
        raise AssertionError("the document needs no runners")

    document: Json = create_app(Settings(), never).openapi()
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


def _cell(text: str | None) -> str:
    return _sentence(text).replace("|", "\\|").replace("<", "&lt;")
