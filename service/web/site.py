"""How a page is rendered: templates, security policy, and the pages of errors."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

from fastapi import Request
from jinja2 import Environment, FileSystemLoader, StrictUndefined
from starlette.responses import HTMLResponse

from benchmarks.paper.table import BESIDE, arm_name
from service.access import SESSION_COOKIE
from service.api.root_path import root, rooted_page
from service.display import shown, size_text
from service.version import installed_version
from service.web import assets, formatting

TEMPLATES = Path(__file__).with_name("templates")
POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; connect-src 'self'; "
    "frame-src 'self'; form-action 'self'; base-uri 'none'; frame-ancestors 'none'"
)
HEADERS = {
    "Content-Security-Policy": POLICY,
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "same-origin",
    "Cache-Control": "no-store",
}


@cache
def environment() -> Environment:
    """The templates; values are escaped, and an undefined name is an error."""
    templates = Environment(
        loader=FileSystemLoader(TEMPLATES),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    templates.filters.update(
        arm=arm_name,
        state=formatting.state,
        num=formatting.number,
        span=formatting.span,
        when=formatting.when,
        local_time=formatting.local_time,
        shown=shown,
        size=size_text,
        sentence=formatting.sentence,
        interval=formatting.interval,
    )
    templates.globals.update(asset=assets.url, version=installed_version(), ABSENT=formatting.ABSENT, BESIDE=BESIDE)
    return templates


def page(request: Request, template: str, *, status: int = 200, **values: Any) -> HTMLResponse:
    """A page of this service."""
    html = environment().get_template(template)
    logged_in = SESSION_COOKIE in request.cookies
    text = rooted_page(html.render(path=request.url.path, root=root(), logged_in=logged_in, **values))
    return HTMLResponse(text, status_code=status, headers=HEADERS)


def problem(request: Request, status: int, title: str, detail: str) -> HTMLResponse:
    """The page of an error."""
    return page(request, "problem.html", status=status, code=status, title=title, detail=detail)


def missing(request: Request, what: str) -> HTMLResponse:
    """The page of something that does not exist."""
    return page(request, "missing.html", status=404, what=what)
