"""The page's own files, and what a browser may do with them: fetch nothing from elsewhere, show them in no frame."""

from importlib.resources import files
from pathlib import PurePosixPath
from typing import NamedTuple

from aiohttp import web
from sense4hri.modalities import style_sheet

HEADERS = {
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; "
    "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cache-Control": "no-cache",
}
KINDS = {
    ".html": "text/html",
    ".css": "text/css",
    ".js": "text/javascript",
    ".svg": "image/svg+xml",
}


class PageFile(NamedTuple):
    """One file. kind: its media type."""

    content: bytes
    kind: str


async def add_headers(request: web.Request, response: web.StreamResponse) -> None:
    """Say with every answer what a browser may do with it."""
    for name, value in HEADERS.items():
        response.headers.setdefault(name, value)


def page_files() -> dict[str, PageFile]:
    """Return every file of the page by its path, the colours among them; read once, so that no path leads elsewhere."""
    found = {}
    pending = [("", files("web_gui") / "static")]
    while pending:
        prefix, folder = pending.pop()
        for entry in folder.iterdir():
            if entry.is_dir():
                pending.append((f"{prefix}{entry.name}/", entry))
            elif kind := KINDS.get(PurePosixPath(entry.name).suffix):
                found[prefix + entry.name] = PageFile(entry.read_bytes(), kind)
    return found | {"modalities.css": PageFile(style_sheet().encode(), KINDS[".css"])}
