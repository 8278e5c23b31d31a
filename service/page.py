"""The start page: what this is and what it is doing. One self-contained document under a strict policy."""

from __future__ import annotations

import secrets
from html import escape

from fastapi import APIRouter, Request
from starlette.responses import HTMLResponse

from service.core import ServiceOf
from service.schemas import JobSummary
from service.version import installed_version
from simcore.presets import preset_names

router = APIRouter(include_in_schema=False)

_STYLE = """
:root { color-scheme: light dark; --ink: #1c2733; --soft: #5c6b7a; --line: #dfe5eb; --back: #f6f8fa; --card: #fff;
  --good: #1a7f4b; --bad: #b3261e; --busy: #1663b5; }
@media (prefers-color-scheme: dark) { :root { --ink: #e4eaf0; --soft: #9aa8b6; --line: #2c3743; --back: #12181f;
  --card: #1a222b; --good: #5fce94; --bad: #ff8a80; --busy: #7db8f5; } }
body { margin: 0; background: var(--back); color: var(--ink); font: 16px/1.5 system-ui, sans-serif; }
main { max-width: 76rem; margin: 0 auto; padding: 2.5rem 1.25rem; }
h1 { margin: 0; font-size: 1.9rem; letter-spacing: -.02em; } h1 small { font: 1rem system-ui; color: var(--soft); }
p { max-width: 46rem; color: var(--soft); } a { color: var(--busy); }
pre { overflow-x: auto; padding: .9rem 1rem; } pre, .table { background: var(--card);
  border: 1px solid var(--line); border-radius: .6rem; } .table { overflow-x: auto; }
table { width: 100%; border-collapse: collapse; font-variant-numeric: tabular-nums; }
th, td { padding: .55rem .9rem; text-align: left; border-bottom: 1px solid var(--line); white-space: nowrap; }
tr:last-child td { border-bottom: 0; } th { color: var(--soft); font-weight: 600; font-size: .85rem; }
progress { width: 5rem; accent-color: var(--busy); } code { font-size: .92em; }
.succeeded { color: var(--good); } .failed, .timed_out { color: var(--bad); } .running { color: var(--busy); }
"""

_SCRIPT = """
async function refresh() {
  try {
    const answer = await fetch('/', {cache: 'no-store'});
    const fresh = new DOMParser().parseFromString(await answer.text(), 'text/html');
    document.getElementById('jobs').replaceWith(fresh.getElementById('jobs'));
  } catch (error) { /* the service is away: keep what is shown, try again */ }
  setTimeout(refresh, 2000);
}
setTimeout(refresh, 2000);
"""


@router.get("/")
def get_page(service: ServiceOf, request: Request) -> HTMLResponse:
    """The page; its own style and script carry a nonce, nothing else may run or load."""
    nonce = secrets.token_urlsafe(16)
    jobs = [JobSummary.of(job) for job in service.store.newest(limit=25)]
    policy = (
        f"default-src 'none'; style-src 'nonce-{nonce}'; script-src 'nonce-{nonce}'; connect-src 'self'; "
        "img-src data:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    )
    headers = {
        "Content-Security-Policy": policy,
        "X-Content-Type-Options": "nosniff",
        "Referrer-Policy": "no-referrer",
        "Cache-Control": "no-store",
    }
    return HTMLResponse(_page(jobs, nonce, str(request.base_url).rstrip("/")), headers=headers)


def _page(jobs: list[JobSummary], nonce: str, url: str) -> str:
    return f"""<!doctype html>
<html lang="en"><head><meta charset="utf-8"><title>needlebench</title>
<meta name="viewport" content="width=device-width, initial-scale=1"><link rel="icon" href="data:,">
<style nonce="{nonce}">{_STYLE}</style></head><body><main>
<h1>needlebench <small>{escape(installed_version())}</small></h1>
<p>Reproducible benchmarks for robotic needle steering in deforming tissue. Each job below is one simulated
insertion of a flexible needle. Submit one from a terminal:</p>
<pre><code>needlebench submit demo --wait --url {escape(url)}</code></pre>
<p>Built-in scenarios: {_scenarios()} The whole interface is described in
<a href="/openapi.json">openapi.json</a>.</p>
<h2>Jobs</h2>
{_table(jobs)}
</main><script nonce="{nonce}">{_SCRIPT}</script></body></html>
"""


def _scenarios() -> str:
    names = (
        f'<a href="/api/v1/scenarios/{escape(name)}">{escape(name)}</a> ({escape(text)})'
        for name, text in preset_names().items()
    )
    return "; ".join(names) + "."


def _table(jobs: list[JobSummary]) -> str:
    if not jobs:
        return '<div id="jobs"><p>None yet.</p></div>'
    head = "".join(
        f"<th>{name}</th>" for name in ("Job", "Scenario", "State", "Progress", "Depth", "Tip error", "RMSE", "Files")
    )
    rows = "".join(_row(job) for job in jobs)
    return f'<div class="table" id="jobs"><table><tr>{head}</tr>{rows}</table></div>'


def _row(job: JobSummary) -> str:
    state = job.state.replace("_", " ")
    done = job.progress.fraction
    cells = (
        f'<a href="{job.links.self}"><code>{escape(job.id)}</code></a>',
        escape(job.name),
        f'<span class="{job.state}">{state}{_verdict(job)}</span>',
        f'<progress max="1" value="{done:.4f}" aria-label="progress"></progress> {100 * done:.0f} %',
        _millimetres(job.progress.depth_mm, 1),
        _millimetres(job.progress.tip_error_mm, 3),
        _millimetres((job.metrics or {}).get("rmse_mm"), 3),
        _links(job),
    )
    return "<tr>" + "".join(f"<td>{cell}</td>" for cell in cells) + "</tr>"


def _verdict(job: JobSummary) -> str:
    """A job that did its work may still have missed: say so beside its state."""
    if job.state != "succeeded":
        return ""
    return ", on target" if (job.metrics or {}).get("success") else ", run without success"


def _millimetres(value: object, digits: int) -> str:
    return f"{value:.{digits}f} mm" if isinstance(value, int | float) else ""


def _links(job: JobSummary) -> str:
    found = (("metrics", job.links.metrics), ("series", job.links.series), ("recording", job.links.recording))
    return " ".join(f'<a href="{escape(url)}">{name}</a>' for name, url in found if url)
