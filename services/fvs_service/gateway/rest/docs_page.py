"""The OpenAPI document as a page of HTML: one file, without scripts and without anything of other hosts."""

import base64
import hashlib
import json
import re
from collections.abc import Iterator, Mapping
from html import escape
from typing import Any, TypeAlias

Part: TypeAlias = Mapping[str, Any]

_STYLE = """
:root { color-scheme: light dark; }
body { font: 16px/1.5 system-ui, sans-serif; max-width: 60rem; margin: 2rem auto; padding: 0 1rem; }
code, pre { font: 14px/1.4 ui-monospace, monospace; }
pre { overflow-x: auto; border: 1px solid #8886; border-radius: 4px; padding: .5rem; }
table { border-collapse: collapse; width: 100%; }
th, td { text-align: left; vertical-align: top; border-top: 1px solid #8886; padding: .3rem .6rem .3rem 0; }
details { border-top: 1px solid #8886; padding: .3rem 0; }
details > :not(summary) { margin-left: 1rem; }
summary { cursor: pointer; }
summary b { display: inline-block; width: 5rem; }
"""
_DIGEST = base64.b64encode(hashlib.sha256(_STYLE.encode()).digest()).decode()
SECURITY_POLICY = (
    f"default-src 'none'; style-src 'sha256-{_DIGEST}'; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'none'"
)
"""The page's ``Content-Security-Policy``: its own style, and nothing else."""
_RANGES = {
    "minimum": "at least {}",
    "exclusiveMinimum": "more than {}",
    "maximum": "at most {}",
    "exclusiveMaximum": "less than {}",
    "minLength": "length at least {}",
    "maxLength": "length at most {}",
    "minItems": "at least {}",
    "maxItems": "at most {}",
}


def docs_page(document: Part) -> str:
    """The page for an OpenAPI document."""
    info = document["info"]
    return "\n".join(
        (
            "<!doctype html>",
            '<html lang="en">',
            f"<head><meta charset=utf-8><title>{escape(info['title'])}</title><style>{_STYLE}</style></head>",
            '<body><meta name="viewport" content="width=device-width">',
            f"<h1>{escape(info['title'])} {escape(info['version'])}</h1>",
            '<p><a href="/openapi.json">openapi.json</a> is this page for programs.</p>',
            _prose(info["description"]),
            "<p>Where the service needs an API key, send <code>Authorization: Bearer fvs_…</code>.</p>",
            *_operations(document),
            *_schemas(document["components"]["schemas"]),
            "</body></html>",
        )
    )


def _operations(document: Part) -> Iterator[str]:
    tags = document["tags"]
    links = (f'<a href="#{escape(tag["name"])}">{escape(tag["name"])}</a>' for tag in tags)
    yield f'<p>{" · ".join(links)} · <a href="#schemas">schemas</a></p>'
    schemas = document["components"]["schemas"]
    for tag in tags:
        yield f'<h2 id="{escape(tag["name"])}">{escape(tag["name"].capitalize())}</h2>'
        yield _prose(tag["description"])
        for path, operations in document["paths"].items():
            for method, operation in operations.items():
                if tag["name"] in operation["tags"]:
                    yield from _operation(method.upper(), path, operation, schemas)


def _operation(method: str, path: str, operation: Part, schemas: Part) -> Iterator[str]:
    about, _, more = operation["description"].partition("\n\n")
    yield f"<details><summary><b>{method}</b> <code>{escape(path)}</code><br>{_line(about)}</summary>"
    yield _prose(more)
    body = operation.get("requestBody", {}).get("content", {})
    yield f"<pre>{escape(_curl(method, path, body, schemas))}</pre>"
    if parameters := operation.get("parameters"):
        yield "<table><tr><th>Parameter</th><th>In</th><th>Type</th><th>What it is</th></tr>"
        for one in parameters:
            name = f"<code>{escape(one['name'])}</code>" + (" *" if one.get("required") else "")
            yield _row(name, escape(one["in"]), _type(one["schema"]), _line(one.get("description", "")))
        yield "</table><p>* is required.</p>"
    yield "<table><tr><th>Body or status</th><th>Media type</th><th>Schema</th><th>What it is</th></tr>"
    for kind, content in body.items():
        yield _row("request", escape(kind), _type(content["schema"]), "")
    for status, response in operation["responses"].items():
        content = response.get("content") or {"": {}}
        for kind, what in content.items():
            schema = what.get("schema")
            yield _row(status, escape(kind), _type(schema) if schema else "", _line(response["description"]))
    yield "</table></details>"


def _curl(method: str, path: str, body: Part, schemas: Part) -> str:
    """The operation as a command, with the first example of its body; ids are variables of the shell."""
    verb = "--head" if method == "HEAD" else f"-X {method}"
    words = [f'curl {verb} "$FVS_URL{path.replace("{", "${")}"']
    if "application/json" in body:
        name = body["application/json"]["schema"]["$ref"].rpartition("/")[2]
        example = json.dumps(next(iter(schemas[name].get("examples", [{}]))))
        words += ["-H 'Content-Type: application/json'", f"-d '{example}'"]
    elif "multipart/form-data" in body:
        words.append("-F file=@photograph.jpg")
    elif body:
        words += [f"-H 'Content-Type: {next(iter(body))}'", "--data-binary @photograph.jpg"]
    return " \\\n    ".join(words)


def _schemas(schemas: Part) -> Iterator[str]:
    yield '<h2 id="schemas">Schemas</h2>'
    for name, schema in schemas.items():
        yield f'<h3 id="schema-{escape(name)}">{escape(name)}</h3>'
        yield _prose(schema.get("description", ""))
        if "properties" not in schema:
            yield f"<p>{_type(schema)}</p>"
            continue
        yield "<table><tr><th>Field</th><th>Type</th><th>What it is</th></tr>"
        for field, part in schema["properties"].items():
            marked = f"<code>{escape(field)}</code>" + (" *" if field in schema.get("required", ()) else "")
            yield _row(marked, _type(part), _line(part.get("description", "")))
        yield "</table>"
    yield "<p>* is required.</p>"


def _type(schema: Part) -> str:
    """A schema in words, with links to others."""
    if "$ref" in schema:
        name = escape(schema["$ref"].rpartition("/")[2])
        return f'<a href="#schema-{name}">{name}</a>'
    if "enum" in schema:
        return " | ".join(f"<code>{escape(json.dumps(word))}</code>" for word in schema["enum"])
    if "const" in schema:
        return f"<code>{escape(json.dumps(schema['const']))}</code>"
    for union in ("anyOf", "oneOf"):
        if union in schema:
            return " or ".join(map(_type, schema[union]))
    kind = escape(schema.get("format") or schema.get("type", "anything"))
    if "prefixItems" in schema:
        kind = f"[{', '.join(escape(part['type']) for part in schema['prefixItems'])}]"
    elif "items" in schema:
        kind = f"list of {_type(schema['items'])}"
    limits = [words.format(schema[key]) for key, words in _RANGES.items() if key in schema]
    return f"{kind} ({', '.join(limits)})" if limits and "prefixItems" not in schema else kind


def _row(*cells: str) -> str:
    return f"<tr>{''.join(f'<td>{cell}</td>' for cell in cells)}</tr>"


def _prose(text: str) -> str:
    """Paragraphs; lines that begin with a number are a list."""
    parts = (part.strip() for part in text.strip().split("\n\n"))
    return "\n".join(
        _list(part) if part.startswith("1. ") else f"<p>{_line(part)}</p>" for part in parts if part
    )


def _list(text: str) -> str:
    items = (line.partition(". ")[2] for line in text.splitlines())
    return f"<ol>{''.join(f'<li>{_line(item)}</li>' for item in items)}</ol>"


def _line(text: str) -> str:
    """Text with what is between backticks as code."""
    return re.sub(r"`+([^`]+)`+", r"<code>\1</code>", escape(text, quote=False))
