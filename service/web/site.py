"""How a page is made: its template, its policy, and the page that says what went wrong."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

from fastapi import Request
from jinja2 import Environment, FileSystemLoader, StrictUndefined
from starlette.responses import HTMLResponse

from service.cli.result_table import shown, size_text
from service.version import installed_version
from service.web import assets
from service.web import formatting as words

TEMPLATES = Path(__file__).with_name("templates")
SESSION = "needlebench_session"  # cookie of a browser that has logged in
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
    """The templates; values are escaped, a name that is not given is an error."""
    made = Environment(
        loader=FileSystemLoader(TEMPLATES),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    made.filters.update(
        state=words.state,
        num=words.number,
        span=words.span,
        when=words.when,
        there=words.there,
        shown=shown,
        size=size_text,
        sentence=words.sentence,
    )
    made.globals.update(asset=assets.url, version=installed_version(), ABSENT=words.ABSENT)
    return made


def page(request: Request, template: str, *, status: int = 200, **values: Any) -> HTMLResponse:
    """A page of this service."""
    html = environment().get_template(template)
    logged_in = SESSION in request.cookies
    text = html.render(path=request.url.path, logged_in=logged_in, **values)
    return HTMLResponse(text, status_code=status, headers=HEADERS)


def problem(request: Request, status: int, title: str, detail: str) -> HTMLResponse:
    """The page of an error."""
    return page(request, "problem.html", status=status, code=status, title=title, detail=detail)


def missing(request: Request, what: str) -> HTMLResponse:
    """The page of a thing that there is not."""
    return page(request, "missing.html", status=404, what=what)
