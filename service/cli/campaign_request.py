"""From the options of `needlebench campaign run` to the request: a suite, or controllers and a grid of values."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from simcore.arms import PLUGIN, makes_arm
from simcore.errors import Problem, ScenarioError


def campaign_request(suite: str | None, options: dict[str, Any]) -> dict[str, Any]:
    """The JSON of the request that the options describe. Raises ScenarioError."""
    request: dict[str, Any] = {"priority": options.get("priority", -10)}
    if options.get("name"):
        request["name"] = options["name"]
    arms = options.get("controllers") or ()
    if suite is not None and not (options["axes"] or arms):
        return {**request, "suite": suite, "model": options["model"]}
    if suite is not None or not (options["axes"] or arms):
        raise ScenarioError([Problem("SUITE", suite, "give either a suite, or --controller or --grid")])
    if options["source"]:
        from service.cli.local import read_source

        request["scenario"] = read_source(options["source"])
    axes = dict(_axis(text) for text in options["axes"])
    if arms and any(makes_arm(path) for path in axes):
        where = next(path for path in axes if makes_arm(path))
        raise ScenarioError([Problem(f"--grid {where}", axes[where], "cannot be given beside --controller")])
    return {**request, "grid": {**({"controller": [controller_block(text) for text in arms]} if arms else {}), **axes}}


def controller_block(text: str) -> dict[str, Any]:
    """The block of `--controller`: NAME, or NAME:FIELD=VALUE,... with fields of the kind or settings of the plug-in.
    Raises ScenarioError."""
    from simcore.scenario.controller_blocks import KINDS

    name, sign, fields = text.partition(":")
    values = dict(_field(part, text) for part in json_items(fields)) if sign else {}
    if name.strip() in KINDS.replace(" or ", ", ").split(", "):
        return {"kind": name.strip(), **values}
    return {"kind": PLUGIN, "name": name.strip(), "settings": values}


def _field(part: str, text: str) -> tuple[str, Any]:
    field, sign, value = part.partition("=")
    if not sign or not field.strip() or not value.strip():
        message = "must be NAME or NAME:FIELD=VALUE,FIELD=VALUE, as in ifem:gain=0.5"
        raise ScenarioError([Problem("--controller", text, message)])
    return field.strip(), _value(value.strip(), "--controller")


def check_request(request: dict[str, Any]) -> None:
    """What can be said before a service is started for it: names of suites, and each value of each axis once, with the
    first values of the others. Raises ScenarioError. What names an upload is left to the service."""
    from benchmarks.suites.catalogue import suite_names
    from simcore.scenario.presets import with_changes
    from simcore.scenario.scenario import Scenario
    from simcore.scenario.suggestions import did_you_mean

    if "suite" in request:
        known = suite_names()
        if request["suite"] not in known:
            meant = did_you_mean(request["suite"], known)
            raise ScenarioError([Problem("suite", request["suite"], f"is none of {', '.join(known)}{meant}")])
        return
    axes: dict[str, list[Any]] = request["grid"]
    if "artefact:" in json.dumps(request) or not all(axes.values()):
        return
    ordered = sorted(axes, key=lambda path: (path.count("."), not path.endswith("kind")))
    for path in ordered:
        for value in axes[path]:
            chosen = {**{name: axes[name][0] for name in ordered}, path: value}
            changes = [f"{name}={json.dumps(one)}" for name, one in chosen.items()]
            Scenario.load(with_changes(request.get("scenario", {}), changes))


def _axis(text: str) -> tuple[str, list[Any]]:
    path, sign, values = text.partition("=")
    if not sign or not path.strip() or not values.strip():
        raise ScenarioError(
            [Problem("--grid", text, "must be FIELD=V1,V2,..., as in tissue.young_kpa=3,6.3, or FIELD=@FILE.json")]
        )
    return path.strip(), _of_file(values.strip(), path) if values.strip().startswith("@") else _values(values, path)


def _of_file(text: str, path: str) -> list[Any]:
    """The values in a JSON file that holds a list of them."""
    try:
        found = json.loads(Path(text[1:]).read_bytes())
    except (OSError, ValueError, RecursionError) as error:
        raise ScenarioError([Problem(f"--grid {path}", text, f"is no readable file of JSON: {error}")]) from None
    if not isinstance(found, list):
        raise ScenarioError([Problem(f"--grid {path}", text, "must hold a JSON list of values")])
    return found


def _values(text: str, path: str) -> list[Any]:
    """A JSON list of values, or values separated by commas, each JSON or a word: lists and objects stay whole."""
    text = text.strip()
    separated = json_items(text)
    if len(separated) > 1 or not text.startswith("["):
        return [_value(value, path) for value in separated]
    found = _value(text, path)
    if not isinstance(found, list):
        raise ScenarioError([Problem(f"--grid {path}", text, "is not a JSON list")])
    return found


def json_items(text: str) -> list[str]:
    """Parts of a text between the commas that stand outside of brackets and quotes."""
    items, depth, quoted, begin = [], 0, False, 0
    for i, letter in enumerate(text):
        if letter == '"' and (i == 0 or text[i - 1] != "\\"):
            quoted = not quoted
        elif not quoted:
            depth += (letter in "[{") - (letter in "]}")
            if letter == "," and depth == 0:
                items.append(text[begin:i].strip())
                begin = i + 1
    return [*items, text[begin:].strip()]


def _value(text: str, path: str) -> Any:
    try:
        return json.loads(text)
    except ValueError:
        if text.startswith(("[", "{")):
            raise ScenarioError([Problem(f"--grid {path}", text, "is not a JSON list or object")]) from None
        return text
