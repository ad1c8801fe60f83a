"""The live page: its frame, its script and style, and plotly.js out of its Python package.

The page holds no data: it asks for all of it, so it is answered without a token. What it is made of
is named by content and may be kept for ever; the frame itself is always asked for again.
"""

from __future__ import annotations

import gzip
import hashlib
import json
from dataclasses import dataclass
from functools import cache
from importlib.resources import files

from fastapi import APIRouter, Request, Response
from jinja2 import Environment, StrictUndefined

from exposight import __version__
from exposight.errors import MissingFileError
from exposight.report.palette import P_NORM_SCALE

router = APIRouter(include_in_schema=False)

_FOR_EVER = "public, max-age=31536000, immutable"
_POLICY = "; ".join(
    (
        "default-src 'self'",
        "img-src 'self' blob: data:",
        "style-src 'self' 'unsafe-inline'",  # plotly.js sets styles of its elements
        "object-src 'none'",
        "base-uri 'none'",
        "form-action 'none'",
        "frame-ancestors 'none'",
    )
)
_HEADERS = {
    "Content-Security-Policy": _POLICY,
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
}
_TYPES = {
    "js": "text/javascript; charset=utf-8",
    "css": "text/css; charset=utf-8",
    "svg": "image/svg+xml",
}


@dataclass(frozen=True, kw_only=True, eq=False)
class Asset:
    """A file that the page loads.

    Parameters
    ----------
    name : str
        With the checksum of its content in it.
    content, compressed : bytes
        As it is, and by gzip.
    media_type : str
    """

    name: str
    content: bytes
    compressed: bytes
    media_type: str

    @classmethod
    def of(cls, name: str, content: bytes) -> Asset:
        """Return the asset of a file."""
        stem, _, suffix = name.rpartition(".")
        checksum = hashlib.sha256(content).hexdigest()[:12]
        return cls(
            name=f"{stem}-{checksum}.{suffix}",
            content=content,
            compressed=gzip.compress(content, 6, mtime=0),
            media_type=_TYPES[suffix],
        )


@router.get("/")
def page() -> Response:
    """Return the live page's frame."""
    return Response(
        _frame(), media_type="text/html", headers={**_HEADERS, "Cache-Control": "no-cache"}
    )


@router.get("/assets/{name}")
def asset(name: str, request: Request) -> Response:
    """Return a file that the page loads."""
    found = {each.name: each for each in assets().values()}.get(name)
    if found is None:
        msg = f"there is no asset {name!r}; load the page again, which names those of this version"
        raise MissingFileError(msg)
    headers = {**_HEADERS, "Cache-Control": _FOR_EVER, "Vary": "Accept-Encoding"}
    accepted = request.headers.get("accept-encoding", "")
    if "gzip" not in {each.partition(";")[0].strip() for each in accepted.split(",")}:
        return Response(found.content, media_type=found.media_type, headers=headers)
    headers["Content-Encoding"] = "gzip"
    return Response(found.compressed, media_type=found.media_type, headers=headers)


@cache
def assets() -> dict[str, Asset]:
    """Return what the page loads, by plain names; read and compressed once."""
    own = files("exposight.service") / "templates"
    plotly = files("plotly") / "package_data" / "plotly.min.js"
    contents = {
        "live.js": (own / "live.js").read_bytes(),
        "live.css": (own / "live.css").read_bytes(),
        "mark.svg": (own / "mark.svg").read_bytes(),
        "plotly.js": plotly.read_bytes(),
    }
    return {name: Asset.of(name, content) for name, content in contents.items()}


@cache
def _frame() -> bytes:
    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True)
    source = (files("exposight.service") / "templates" / "live.html").read_text("utf-8")
    text = environment.from_string(source).render(
        assets={name: f"assets/{each.name}" for name, each in assets().items()},
        scale=json.dumps(P_NORM_SCALE),
        version=__version__,
    )
    return text.encode()
