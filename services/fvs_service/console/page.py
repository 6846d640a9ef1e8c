"""What a browser finds at ``/``: the console and its files. They need no key: nothing in them is secret."""

from typing import Annotated, Any

from fastapi import Header, Request, Response
from starlette.datastructures import Headers
from starlette.responses import FileResponse, RedirectResponse

from fvs_service.console.built_files import BuiltFile, built_file, index_page
from fvs_service.errors import NotFoundError
from fvs_service.gateway.capabilities import ARCHIVE_URL
from fvs_service.gateway.rest.dependencies import KnownQuery
from fvs_service.gateway.rest.pages import DOCS_URL
from fvs_service.gateway.rest.routing import HeadRouter
from fvs_service.settings import BasemapSettings, Settings

_FOREVER = "public, max-age=31536000, immutable"
"""For built files, whose names contain a hash of their content."""


def console_router(settings: Settings) -> HeadRouter:
    """The start of the service at ``/``, and, unless ``settings`` leave it out, the console."""
    router = HeadRouter(dependencies=[KnownQuery], include_in_schema=False)

    @router.get("/", response_model=None)
    def get_index(request: Request, accept: Annotated[str, Header()] = "") -> dict[str, Any] | Response:
        """The service's name, its version, and where to go on; browsers get a page."""
        if "text/html" in accept:
            return _page(request) if settings.console else RedirectResponse(DOCS_URL)
        app = request.app
        return {
            "name": app.title,
            "version": app.version,
            "api": "/v1",
            "docs": DOCS_URL,
            "openapi": app.openapi_url,
        }

    if settings.console:
        _add_files(router, settings.basemap)

    def _page(request: Request) -> Response:
        headers = {"Content-Security-Policy": security_policy(settings.basemap)}
        return _response(index_page(), request, headers)

    return router


def security_policy(basemap: BasemapSettings) -> str:
    """The ``Content-Security-Policy``: the service's own files, WebAssembly for splats, the host of tiles."""
    contacted = " ".join(["'self'", *basemap.origins])
    return (
        f"default-src 'self'; script-src 'self' 'wasm-unsafe-eval'; connect-src {contacted}; "
        "object-src 'none'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    )


def _add_files(router: HeadRouter, basemap: BasemapSettings) -> None:
    policy = security_policy(basemap)  # of workers, which are files, too

    @router.get("/console/assets/{name}")
    def get_file(request: Request, name: str) -> Response:
        """One file of the page."""
        file = built_file(name)
        if file is None:
            raise NotFoundError("The console has no such file.", hint="Load the page again.")
        return _response(file, request, {"Cache-Control": _FOREVER, "Content-Security-Policy": policy})

    if (archive := basemap.archive) is not None:

        @router.get(ARCHIVE_URL)
        def get_basemap() -> FileResponse:
            """The archive of the map's tiles, of which the page reads ranges."""
            if not archive.is_file():
                raise NotFoundError(
                    "The archive of the map's tiles is gone.",
                    hint="Put the file of FVS_BASEMAP__ARCHIVE back.",
                )
            return FileResponse(archive, media_type="application/vnd.pmtiles")


def _response(file: BuiltFile, request: Request, headers: dict[str, str]) -> Response:
    headers = {**headers, "Vary": "Accept, Accept-Encoding"}
    if not _accepts_gzip(request.headers):
        return Response(file.content, headers=headers, media_type=file.media_type)
    return Response(
        file.compressed, headers={**headers, "Content-Encoding": "gzip"}, media_type=file.media_type
    )


def _accepts_gzip(headers: Headers) -> bool:
    """Whether a client with these headers of a request reads gzip."""
    offered = (part.partition(";") for part in headers.get("accept-encoding", "").lower().split(","))
    return any(
        name.strip() in ("gzip", "*") and weight.replace(" ", "") not in ("q=0", "q=0.0", "q=0.00", "q=0.000")
        for name, _, weight in offered
    )
