"""What a browser finds at ``/`` and ``/docs``: no key is needed, and nothing here is secret."""

from typing import Any

from fastapi import Request, Response
from fastapi.responses import HTMLResponse, RedirectResponse

from fvs_service.gateway.rest.dependencies import KnownQuery
from fvs_service.gateway.rest.docs_page import SECURITY_POLICY, docs_page
from fvs_service.gateway.rest.routing import HeadRouter

router = HeadRouter(dependencies=[KnownQuery], include_in_schema=False)

_DOCS, _OPENAPI = "/docs", "/openapi.json"


@router.get("/", response_model=None)
def get_index(request: Request) -> dict[str, Any] | Response:
    """The service's name, its version, and where to go on; browsers get the documentation."""
    if "text/html" in request.headers.get("accept", ""):
        return RedirectResponse(_DOCS)
    app = request.app
    return {"name": app.title, "version": app.version, "api": "/v1", "docs": _DOCS, "openapi": _OPENAPI}


@router.get(_DOCS, response_class=HTMLResponse)
def get_docs(request: Request) -> HTMLResponse:
    """The OpenAPI document as a page."""
    state = request.app.state
    if not hasattr(state, "docs_page"):
        state.docs_page = docs_page(request.app.openapi())
    return HTMLResponse(state.docs_page, headers={"Content-Security-Policy": SECURITY_POLICY})
