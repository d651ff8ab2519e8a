"""GET /: the page, and the files that it loads."""

import hashlib
from dataclasses import dataclass
from pathlib import Path

from fastapi import APIRouter, Request
from fastapi.responses import Response
from starlette.exceptions import HTTPException

router = APIRouter(include_in_schema=False)

FOLDER = Path(__file__).parents[2] / "page"
MEDIA_TYPES = {
    ".css": "text/css; charset=utf-8",
    ".html": "text/html; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".svg": "image/svg+xml",
}
POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; img-src 'self' data:; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
FOR_EVER = "public, max-age=31536000, immutable"


@dataclass(frozen=True, slots=True)
class PageFile:
    """The content and headers of one file of the page."""

    body: bytes
    media_type: str
    etag: str


def read_page() -> tuple[str, dict[str, PageFile]]:
    """Return the name under which the files are served, a digest of them all, and the files by their paths.

    The page itself asks for them under that name: a browser keeps them for ever, and a new version has new addresses.
    """
    paths = sorted(path for path in FOLDER.rglob("*") if path.suffix in MEDIA_TYPES)
    contents = {path.relative_to(FOLDER).as_posix(): path.read_bytes() for path in paths}
    digest = hashlib.sha256()
    for name, body in contents.items():
        digest.update(f"{name} {len(body)}\n".encode() + body)
    version = digest.hexdigest()[:16]
    contents["index.html"] = contents["index.html"].replace(b'="page/', f'="page/{version}/'.encode())
    return version, {name: _file(name, body) for name, body in contents.items()}


def _file(name: str, body: bytes) -> PageFile:
    return PageFile(body, MEDIA_TYPES[Path(name).suffix], f'"{hashlib.sha256(body).hexdigest()[:32]}"')


VERSION, FILES = read_page()


@router.get("/")
async def get_page(request: Request) -> Response:
    """Return the page; the browser asks each time whether it is still the same."""
    return _answer(request, FILES["index.html"], "no-cache", {"Content-Security-Policy": POLICY})


@router.get("/page/{version}/{name:path}")
async def get_file(version: str, name: str, request: Request) -> Response:
    """Return a file of the page, which may be kept for ever under this address."""
    if version != VERSION or name not in FILES or name == "index.html":
        raise HTTPException(404)
    return _answer(request, FILES[name], FOR_EVER, {})


def _answer(request: Request, file: PageFile, caching: str, headers: dict[str, str]) -> Response:
    headers = {**headers, "ETag": file.etag, "Cache-Control": caching}
    if file.etag in request.headers.get("if-none-match", ""):
        return Response(status_code=304, headers=headers)
    return Response(file.body, media_type=file.media_type, headers=headers)
