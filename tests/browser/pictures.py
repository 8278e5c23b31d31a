"""Pictures of the pages for the documentation: `make pictures` runs real insertions and writes benchmarks/pictures.

Numbers that depend on the machine (times, hashes) are in them: they are taken when the pages change.
"""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from tests.acceptance.server import ROOT, running_server
from tests.browser.browser import chromium

if TYPE_CHECKING:
    from playwright.sync_api import Browser

    from needlebench import Client

FOLDER = ROOT / "benchmarks" / "pictures"


class Picture(NamedTuple):
    """A page as it is shown. address: with `{job}` for the insertion; size: width and height, pixels."""

    name: str
    address: str
    size: tuple[int, int]
    scheme: str = "light"


PICTURES = (
    Picture("page-jobs", "/?all=1", (1440, 860)),
    Picture("page-job", "/jobs/{job}", (1280, 900)),
    Picture("page-submit", "/submit?from=demo", (1280, 760)),
    Picture("page-phone", "/?q=E#jobs", (390, 844), "dark"),
)


def _fill(client: Client) -> str:
    """Insertions into softer and stiffer tissue, one of them named and tagged; its id."""
    grid = {"tissue.young_kpa": [3, 6.3], "controller.kind": ["ifem", "open_loop"]}
    client.wait_campaign(client.start_campaign({"name": "softness", "grid": grid}).id)
    job = client.wait(client.submit("demo").id)
    client.edit(job.id, tags=["liver", "paper-2"], note="The reference of the study.")
    return job.id


def _take(browser: Browser, url: str, job: str, picture: Picture) -> None:
    width, height = picture.size
    window = browser.new_context(
        base_url=url,
        viewport={"width": width, "height": height},
        color_scheme=picture.scheme,  # type: ignore[arg-type]
    )
    page = window.new_page()
    page.goto(picture.address.format(job=job))
    page.wait_for_timeout(1500)  # plots are drawn, and the stream of events has begun
    page.screenshot(path=FOLDER / f"{picture.name}.png")
    window.close()


def main() -> None:
    """Write every picture."""
    with tempfile.TemporaryDirectory() as folder, running_server(Path(folder), runner="") as server:
        job = _fill(server.client)
        with chromium() as browser:
            for picture in PICTURES:
                _take(browser, server.url, job, picture)
                print(FOLDER / f"{picture.name}.png")


if __name__ == "__main__":
    main()
