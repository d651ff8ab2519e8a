"""GET /docs: the service on one page, made from its OpenAPI description, without a script."""

import base64
import hashlib
import json
from collections.abc import Iterator
from html import escape
from typing import Any

from fastapi import APIRouter, Request
from fastapi.responses import HTMLResponse

from app.service.errors import HTTP_TYPES, PROBLEM_TYPES

router = APIRouter()

STYLE = """
body { font: 16px/1.5 system-ui, sans-serif; color: #1b1f24; }
body { margin: 2rem auto; max-width: 60rem; padding: 0 1rem; }
h1, h2, h3 { line-height: 1.2; } h2 { margin-top: 2.5rem; border-top: 1px solid #d0d7de; padding-top: 1rem; }
code, pre { font: 14px/1.45 ui-monospace, monospace; background: #f3f5f7; border-radius: 4px; }
code { padding: 0.1em 0.3em; } pre { padding: 0.8rem; overflow-x: auto; }
table { border-collapse: collapse; width: 100%; }
th, td { text-align: left; padding: 0.3rem 0.6rem; vertical-align: top; }
tr { border-bottom: 1px solid #d0d7de; }
"""
STYLE_HASH = base64.b64encode(hashlib.sha256(STYLE.encode()).digest()).decode()
POLICY = f"default-src 'none'; style-src 'sha256-{STYLE_HASH}'; frame-ancestors 'none'"


@router.get("/docs", include_in_schema=False)
async def get_docs(request: Request) -> HTMLResponse:
    """Return the page."""
    page = render(request.app.openapi())
    return HTMLResponse(page, headers={"Content-Security-Policy": POLICY})


def render(description: dict[str, Any]) -> str:
    """Return the OpenAPI description as HTML."""
    info = description["info"]
    parts = [
        f"<h1>{escape(info['title'])}</h1>",
        f"<p>{escape(info['description'])} Version {escape(info['version'])}.",
        '<a href="/openapi.json">openapi.json</a></p>',
    ]
    for path, methods in description["paths"].items():
        for method, operation in methods.items():
            parts.extend(_operation(method.upper(), path, operation, description))
    parts.extend(_problem_types())
    title = f"<title>{escape(info['title'])}</title>"
    head = f'<meta charset="utf-8"><meta name="viewport" content="width=device-width">{title}'
    body = "\n".join(parts)
    return (
        f'<!doctype html><html lang="en"><head>{head}<style>{STYLE}</style></head><body>{body}</body></html>'
    )


def _operation(
    method: str, path: str, operation: dict[str, Any], description: dict[str, Any]
) -> Iterator[str]:
    yield f"<h2>{method} {escape(path)}</h2>"
    yield from (f"<p>{escape(text)}</p>" for text in operation.get("description", "").split("\n\n"))
    if "requestBody" in operation:
        schema = operation["requestBody"]["content"]["application/json"]["schema"]
        yield "<h3>Request</h3>"
        yield from _fields(schema)
        example = json.dumps(schema["examples"][0])
        wanted = [one for one in operation.get("parameters", []) if one.get("required")]
        query = "&".join(f"{one['name']}={one['example']}" for one in wanted)
        address = f"http://127.0.0.1:8000{path}" + (f"?{query}" if query else "")
        command = f"curl {address} -H 'Content-Type: application/json' -d '{example}'"
        yield f"<pre>{escape(command)}</pre>"
    for status, response in operation["responses"].items():
        yield f"<h3>{escape(status)}</h3><p>{escape(response['description'])}</p>"
        schema = response.get("content", {}).get("application/json", {}).get("schema", {})
        if "$ref" in schema:
            yield from _fields(description["components"]["schemas"][schema["$ref"].rsplit("/", 1)[-1]])


def _fields(schema: dict[str, Any]) -> Iterator[str]:
    yield "<table><tr><th>name</th><th>allowed</th><th>meaning</th></tr>"
    for name, field in schema["properties"].items():
        required = "" if name in schema.get("required", []) else f"default {json.dumps(field.get('default'))}"
        cells = (
            f"<code>{escape(name)}</code>",
            escape(_allowed(field, required)),
            escape(field.get("description", "")),
        )
        yield "<tr>" + "".join(f"<td>{cell}</td>" for cell in cells) + "</tr>"
    yield "</table>"


def _allowed(field: dict[str, Any], default: str) -> str:
    """Return type, range and default in a few words."""
    return ", ".join([_kind(field), *([default] if default else [])])


def _kind(field: dict[str, Any]) -> str:
    """Return type and range: "number from 0 to 15 or object of times, values"."""
    choices = field.get("anyOf") or field.get("oneOf")
    if choices:
        return " or ".join(_kind(choice) for choice in choices)
    words = [" or ".join(field.get("enum", [])) or str(field.get("type", ""))]
    if "properties" in field:
        words.append("of " + ", ".join(field["properties"]))
    entries = field.get("items", {})
    forms = entries.get("anyOf", [entries])
    if "properties" in forms[0]:
        pairs = " or pairs" if "prefixItems" in forms[-1] else ""
        words.append("of objects of " + ", ".join(forms[0]["properties"]) + pairs)
    bounds = (
        ("exclusiveMinimum", "above"),
        ("minimum", "from"),
        ("maximum", "to"),
        ("maxItems", "at most"),
    )
    words.extend(f"{sign} {field[key]:g}" for key, sign in bounds if key in field)
    return " ".join(words)


def _problem_types() -> Iterator[str]:
    yield "<h2>Problems</h2><p>Errors are <code>application/problem+json</code> (RFC 9457).</p>"
    yield "<table><tr><th>type</th><th>status</th><th>title</th></tr>"
    kinds = {kind.name: kind for kind in (*PROBLEM_TYPES.values(), *HTTP_TYPES.values())}
    for kind in kinds.values():
        cells = (f"<code>{kind.name}</code>", str(kind.status), escape(kind.title))
        yield f'<tr id="{kind.name}">' + "".join(f"<td>{cell}</td>" for cell in cells) + "</tr>"
    yield "</table>"
