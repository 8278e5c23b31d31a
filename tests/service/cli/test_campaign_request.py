"""From the options of `needlebench campaign run` to its request."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pytest

from service.cli.campaign_request import campaign_request
from simcore.errors import ScenarioError

if TYPE_CHECKING:
    from pathlib import Path


def test_controllers_are_given_by_name_with_their_fields() -> None:
    options = {"axes": ["seed=1"], "source": None, "controllers": ["ifem:gain=0.5", "mine", "mine:ki=0.2,law=[1, 2]"]}
    request = campaign_request(None, options)
    assert request["grid"] == {
        "controller": [
            {"kind": "ifem", "gain": 0.5},
            {"kind": "plugin", "name": "mine", "settings": {}},
            {"kind": "plugin", "name": "mine", "settings": {"ki": 0.2, "law": [1, 2]}},
        ],
        "seed": [1],
    }


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"axes": [], "controllers": ["mine:gain"]}, "NAME:FIELD=VALUE"),
        ({"axes": ["controller.gain=1"], "controllers": ["ifem"]}, "cannot be given beside --controller"),
        ({"axes": ["trajectory=@missing.json"]}, "is no readable file of JSON"),
        ({"axes": []}, "give either a suite, or --controller or --grid"),
    ],
)
def test_wrong_options_of_a_campaign_are_named(options: dict[str, Any], words: str) -> None:
    with pytest.raises(ScenarioError, match=words):
        campaign_request(None, {"source": None, **options})


def test_values_of_an_axis_may_come_from_a_file(tmp_path: Path) -> None:
    file = tmp_path / "paths.json"
    file.write_text('[{"kind": "line"}, {"kind": "sine"}]')
    request = campaign_request(None, {"axes": [f"trajectory=@{file}"], "source": None})
    assert request["grid"] == {"trajectory": [{"kind": "line"}, {"kind": "sine"}]}
