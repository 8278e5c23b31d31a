from __future__ import annotations

import json
import re
from collections import Counter
from html.parser import HTMLParser
from importlib.resources import files
from typing import TYPE_CHECKING
from urllib.parse import quote, urljoin

import pytest
from sqlalchemy import update
from starlette.testclient import TestClient

from service.api.context import Service
from service.store import schema
from service.store.job import Outcome
from service.store.job_lists import JobFilter
from service.web import assets
from service.web.models import errors_drawing
from tests.service.http import finish, finish_training, idle_service
from tests.service.learned import dataset_bytes, model_bytes

if TYPE_CHECKING:
    from collections.abc import Iterator

HOSTILE = "<script>alert(1)</script>\"'&"
VOID = {"area", "base", "br", "col", "hr", "img", "input", "link", "meta", "source"}


class Page(HTMLParser):
    """Every tag with its attributes; complains about tags that are not closed in order."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.found: list[tuple[str, dict[str, str | None]]] = []
        self._open: list[str] = []
        self.feed(text)
        assert not self._open

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        assert len(attrs) == len(dict(attrs)), f"an attribute stands twice: {attrs}"
        self.found.append((tag, dict(attrs)))
        if tag not in VOID:
            self._open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        if tag not in VOID:
            assert self._open.pop() == tag

    def values(self, name: str) -> list[str]:
        return [str(attributes[name]) for _, attributes in self.found if name in attributes]


Site = tuple[TestClient, Service, dict[str, str]]


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Site]:
    """A service with a job in most states, campaigns that ended and one that did not, a schedule with a history."""
    with idle_service(tmp_path_factory.mktemp("site")) as (http, service):
        done = http.post("/api/v1/jobs", json={"scenario": {"name": "done"}}).json()["id"]
        finish(service)
        grid = {
            "scenario": {"noise_mm": 0.25},
            "grid": {"controller.kind": ["ifem", "open_loop"], "seed": [0, 1]},
            "name": HOSTILE,
        }
        ended = [http.post("/api/v1/campaigns", json=grid).json()["id"] for _ in range(2)]
        for _ in range(8):
            finish(service)
        service.campaigns.settle()
        later = http.post("/api/v1/campaigns", json=grid).json()["id"]
        nightly = {"name": HOSTILE, "cron": "0 2 * * *", "campaign": grid}
        schedule = http.post("/api/v1/schedules", json=nightly).json()["id"]
        http.post(f"/api/v1/schedules/{schedule}/trigger")
        queued = http.post("/api/v1/jobs", json={"scenario": "replay"}).json()["id"]
        compared = [one["job"] for one in http.get(f"/api/v1/campaigns/{ended[0]}/jobs").json()["items"][:2]]
        failed = _failed(http, service)
        trained, training, model = _trained(http, service)
        barrel = (files("service") / "cli" / "examples" / "mesh.msh").read_bytes()
        mesh = http.post("/api/v1/uploads", params={"kind": "mesh", "name": "a.msh"}, content=barrel).json()["id"]
        service.history.tick()
        a, b = ended
        where = {
            "/": "jobs",
            "/?state=finished": "jobs of a state",
            "/?state=timed_out": "no jobs",
            "/submit": "form",
            f"/submit?from={done}": "form from a job",
            "/submit?from=replay": "form from a built-in scenario",
            f"/jobs/{done}": "a job that is done",
            f"/jobs/{queued}": "a job that waits",
            f"/jobs/{failed}": "a job that failed",
            "/campaigns": "campaigns",
            f"/campaigns/{a}?sort=rmse&down=1": "a campaign",
            f"/campaigns/{later}": "a campaign that runs",
            "/schedules": "schedules",
            "/trends": "trends",
            f"/trends/{quote(HOSTILE, safe='')}": "a trend",
            "/models": "models",
            "/models/elm": "a bundled model",
            f"/models/{trained}": "a model that was trained here",
            f"/models/{model}": "an uploaded model",
            f"/jobs/{training}": "a training that is done",
            f"/submit?from={trained}": "form from a model",
            "/submit?from=mlp": "form from a bundled model",
            f"/side-by-side?job={compared[0]}&job={compared[1]}&job={done}": "jobs side by side",
            "/docs": "the API",
            "/suites": "suites",
            f"/suites/{quote(HOSTILE, safe='')}": "a suite",
            f"/campaigns/{a}?picture=scatter&x=push&color=seed": "a campaign as points",
            "/uploads": "uploads",
            "/uploads?kind=mesh": "uploads of a kind",
            f"/uploads/{mesh}": "an uploaded mesh",
            "/service": "the service",
            "/keys": "keys, none yet",
            "/compare": "comparison",
            f"/compare?a={a}": "comparison, half chosen",
            f"/compare?a={a}&b={b}": "two campaigns",
            f"/compare?a={a}&first=ifem&second=open_loop": "two controllers",
        }
        yield http, service, where


def _trained(http: TestClient, service: Service) -> tuple[str, str, str]:
    """A model that was trained, the job of its training, and an uploaded model that a job steers by."""

    def send(data: bytes, kind: str, name: str) -> str:
        answer = http.post("/api/v1/uploads", params={"kind": kind, "name": name}, content=data)
        reference: str = answer.json()["reference"]
        return reference

    data = send(dataset_bytes(), "dataset", "data.npz")
    body = {"data": data, "name": HOSTILE, "priority": 100}
    training = http.post("/api/v1/models/train", json=body).json()["id"]
    trained = (finish_training(service).metrics or {})["model"]
    told = json.loads(model_bytes("linear"))
    told["provenance"]["data_commit"] = HOSTILE
    model = send(json.dumps(told).encode(), "model", "sent in.json")
    steer = {"name": "steered", "controller": {"kind": "linear", "model": model}}
    http.post("/api/v1/jobs", json={"scenario": steer})
    return trained, training, model.removeprefix("artefact:")


def _failed(http: TestClient, service: Service) -> str:
    """A job that failed, with a name and an error that no request could give it."""
    made: str = http.post("/api/v1/jobs", json={"scenario": "demo", "priority": 100}).json()["id"]
    job = service.store.claim()
    assert job is not None
    assert job.id == made
    service.store.finish(job, Outcome(state="failed", error_kind="exception", error=HOSTILE))
    with service.store.writing() as connection:
        connection.execute(update(schema.job).where(schema.job.c.id == made).values(name=HOSTILE))
    return made


@pytest.mark.slow
def test_pages_are_sound_html_and_accessible(site: Site) -> None:
    http, _, pages = site
    for address in pages:
        answer = http.get(address)
        assert answer.status_code == 200, address
        page = Page(answer.text)
        ids = Counter(page.values("id"))
        assert max(ids.values()) == 1, (address, ids.most_common(2))
        for name in ("for", "aria-labelledby", "aria-describedby", "list"):
            wanted = {one for value in page.values(name) for one in value.split()}
            assert wanted <= ids.keys(), (address, name, wanted - ids.keys())
        tags = Counter(tag for tag, _ in page.found)
        assert tags["h1"] == tags["main"] == tags["header"] == 1, address
        assert all("scope" in attributes for tag, attributes in page.found if tag == "th"), address
        assert all("alt" in attributes for tag, attributes in page.found if tag == "img"), address


@pytest.mark.slow
def test_every_control_has_a_name(site: Site) -> None:
    http, _, pages = site
    for address in pages:
        text = http.get(address).text
        page = Page(text)
        labelled = set(page.values("for"))
        for tag, attributes in page.found:
            if tag in ("input", "select", "textarea") and attributes.get("type") != "hidden":
                named = attributes.get("id") in labelled or "aria-label" in attributes
                inside = attributes.get("type") in ("checkbox", "radio")  # stands within its label
                assert named or inside, (address, attributes)


@pytest.mark.slow
def test_pages_keep_to_a_strict_policy_and_load_nothing_from_elsewhere(site: Site) -> None:
    http, _, pages = site
    for address in pages:
        answer = http.get(address)
        policy = answer.headers["content-security-policy"]
        assert policy.startswith("default-src 'none'")
        assert not re.search(r"unsafe|https?:|\*", policy)
        for tag, attributes in Page(answer.text).found:
            assert tag != "style"
            assert tag != "script" or str(attributes["src"]).startswith("/static/")
            assert not any(name.startswith("on") or name == "style" for name in attributes), (address, attributes)
            for name in ("src", "href", "action"):
                assert not re.match(r"(\w+:)?//", str(attributes.get(name, ""))), (address, attributes)


@pytest.mark.slow
def test_every_link_answers(site: Site) -> None:
    http, _, pages = site
    links = set()
    for address in pages:
        page = Page(http.get(address).text)
        links |= {urljoin(address, link) for name in ("href", "src") for link in page.values(name)}
    assert len(links) > 50
    for link in sorted(link.partition("#")[0] for link in links):
        waits = re.fullmatch(r"/recordings/.*", link)  # of a job that waits it is a stream without end
        waits = waits or re.fullmatch(r"/side-by-side/.*\.rrd", link)  # of the stand-ins for recordings there is none
        assert waits or http.get(link).status_code == 200, link


@pytest.mark.slow
def test_hostile_names_stay_text(site: Site) -> None:
    http, _, pages = site
    seen = 0
    for address in pages:
        text = http.get(address).text
        assert "<script>alert" not in text, address
        seen += "&lt;script&gt;alert(1)" in text
    assert seen >= 8


@pytest.mark.slow
def test_a_variant_of_a_job_leaves_the_spacing_to_be_derived(site: Site) -> None:
    http, service, _ = site
    job = service.store.page(JobFilter(state="finished")).items[-1].id
    (given,) = Page(http.get(f"/submit?from={job}").text).values("data-given")
    assert json.loads(given)["interaction"]["spacing_mm"] is None


@pytest.mark.slow
def test_what_is_not_there_has_a_page(site: Site) -> None:
    http, _, _ = site
    for address in (
        "/jobs/0",
        "/campaigns/0",
        "/models/forest",
        "/trends/none",
        "/submit?from=nothing",
        "/jobs/%3Cb%3E",
    ):
        answer = http.get(address)
        assert answer.status_code in (404, 422)
        assert "<b>" not in answer.text or "html" not in answer.headers["content-type"]
    assert "There is no job 0" in http.get("/jobs/0").text
    assert http.get("/compare?a=0&b=1").status_code == 422


def test_login_shows_a_way_out(site: Site) -> None:
    http, _, _ = site
    assert "Log out" not in http.get("/").text
    assert "Log out" in http.get("/", headers={"Cookie": "needlebench_session=x"}).text


@pytest.mark.slow
def test_the_page_of_a_model_says_how_it_was_trained_and_who_steers_by_it(site: Site) -> None:
    http, _, pages = site
    of = {text: address for address, text in pages.items()}
    elm = http.get("/models/elm").text
    assert 'aria-label="Root mean square error of Delta P in mm' in elm
    assert elm.count("<rect") == 6
    packaged = json.loads((files("simcore") / "models" / "elm.json").read_text())["provenance"]
    for error in packaged["train_rmse_mm"] + packaged["test_rmse_mm"]:
        assert f"{error:.3f} mm" in elm
    assert "9000" in elm
    used = http.get(of["an uploaded model"]).text
    assert ">steered</a>" in used
    trained = http.get(of["a model that was trained here"]).text
    assert f'href="{of["a training that is done"]}"' in trained
    assert "None yet." in trained
    done = http.get(of["a training that is done"]).text
    assert f'href="{of["a model that was trained here"]}"' in done
    assert "Recording" not in done
    listed = http.get("/models").text
    assert listed.count("Steer<span") == 5
    assert "data.npz: 80 rows, 2 insertions" in listed


def test_errors_are_drawn_to_scale() -> None:
    drawing = errors_drawing([0.1, 0.0, 0.2], [0.2, 0.1, 0.4])
    assert drawing is not None
    widths = [bar.width for bar in drawing.bars]
    assert max(widths) == widths[5]
    assert [width / widths[5] for width in widths] == pytest.approx([0.25, 0.5, 0.0, 0.25, 0.5, 1.0], abs=1e-3)
    assert errors_drawing(None, [0.1] * 3) is None
    flat = errors_drawing([0.0] * 3, [0.0] * 3)
    assert flat is not None
    assert {bar.width for bar in flat.bars} == {0.0}


# ---- static files


def test_static_files_are_kept_for_good_and_change_their_address(site: Site) -> None:
    http, _, _ = site
    answer = http.get(assets.url("site.css"))
    assert "immutable" in answer.headers["cache-control"]
    assert answer.headers["content-type"].startswith("text/css")
    again = http.get(assets.url("site.css"), headers={"If-None-Match": answer.headers["etag"]})
    assert again.status_code == 304
    assert http.get("/static/0000/site.css").status_code == 404
    for name in ("../site.py", "..%2Fsite.py", "%2e%2e/web/site.py", "nothing.css"):
        assert http.get(f"/static/{assets.digest()}/{name}").status_code == 404
