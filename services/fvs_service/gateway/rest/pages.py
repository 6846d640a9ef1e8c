"""What a browser finds at ``/docs``: no key is needed, and nothing here is secret."""

from fastapi import Request
from fastapi.responses import HTMLResponse

from fvs_service.gateway.rest.dependencies import KnownQuery
from fvs_service.gateway.rest.docs_page import SECURITY_POLICY, docs_page
from fvs_service.gateway.rest.routing import HeadRouter

router = HeadRouter(dependencies=[KnownQuery], include_in_schema=False)

DOCS_URL = "/docs"


@router.get(DOCS_URL, response_class=HTMLResponse)
def get_docs(request: Request) -> HTMLResponse:
    """The OpenAPI document as a page."""
    state = request.app.state
    if not hasattr(state, "docs_page"):
        state.docs_page = docs_page(request.app.openapi())
    return HTMLResponse(state.docs_page, headers={"Content-Security-Policy": SECURITY_POLICY})
