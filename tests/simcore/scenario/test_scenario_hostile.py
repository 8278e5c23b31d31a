"""Hostile and broken scenarios: a short answer to anything."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from simcore.scenario.scenario import Scenario
from tests.budget import examples
from tests.simcore.scenario.scenario_fields import (
    NUMBERS,
    STRAIGHT_IN,
    Json,
    NumberField,
    refusal,
    refusal_or_none,
    refused,
    replay,
)


@pytest.mark.parametrize("data", [None, True, 3, 2.5, [], [{}], math.nan])
def test_json_that_is_no_object_is_refused(data: Any) -> None:
    assert refusal(data).problems[0].field == "scenario"


@pytest.mark.parametrize(
    "data",
    ["", "{", "[demo", "{}{}", "{'a': 1}", '{"a": 1,}', "\x00", b"", b"\xff\xff\xff", b"\x80{}", '{"name": "\\ud800"}'],
)
def test_text_that_is_no_json_is_refused(data: str | bytes) -> None:
    (problem,) = refusal(data).problems
    assert problem.field == "scenario"
    assert "is not JSON" in problem.message


class Other:
    """Something that JSON cannot say."""


@pytest.mark.parametrize(
    "value",
    [{1, 2}, Other(), object, b"x", 1j, {(1, 2): 3}, bytearray(b"{}")],
    ids=lambda value: type(value).__name__,
)
def test_values_that_json_cannot_say_are_refused(value: Any) -> None:
    for data in (value, {"dt_s": value}) if not isinstance(value, bytes) else ({"dt_s": value},):
        (problem,) = refusal(data).problems
        assert "is not JSON" in problem.message


def test_a_loop_in_the_data_is_refused() -> None:
    data: Json = {}
    data["tissue"] = data
    assert "is not JSON" in str(refusal(data))


@pytest.mark.parametrize("depth", [150, 5_000, 200_000])
@pytest.mark.parametrize(("opening", "closing"), [("[", "]"), ('{"a":', "}")])
def test_deep_json_is_refused(depth: int, opening: str, closing: str) -> None:
    text = opening * depth + "1" + closing * depth
    for data in (text, f'{{"tissue": {text}}}', f'{{"dt_s": {text}}}'):
        assert len(str(refusal(data))) < 1000


@pytest.mark.slow
def test_deep_data_is_refused() -> None:
    data: Any = 1
    for _ in range(100_000):
        data = [data]
    assert "is not JSON" in str(refusal({"seed": data}))
    while isinstance(data, list):  # take it apart: freeing it at once would recurse
        data = data[0]


@pytest.mark.parametrize("digits", [20, 309, 400, 4300, 4301, 100_000])
def test_a_number_of_very_many_digits_is_refused(digits: int) -> None:
    for field in ("seed", "dt_s"):
        assert len(str(refusal(f'{{"{field}": {"9" * digits}}}'))) < 1000
    if digits <= 4300:
        refused({"seed": 10 ** (digits - 1)}, "seed", "0 to 2^53 - 1")
    else:
        refusal({"seed": 10 ** (digits - 1)})


@pytest.mark.slow
def test_huge_input_gives_a_short_answer() -> None:
    for data in (
        {"x" * 1_000_000: 1},
        {"name": "x" * 1_000_000},
        {"a\nb\x1b[31m": 1},
        {f"f{i}": 0 for i in range(5_000)},
    ):
        error = refusal(data)
        assert len(error.problems) <= 21
        assert max(map(len, str(error).splitlines())) < 400
    many = refusal(replay(*[[0.0, 0.0, 0.0]] * 5_000))
    assert len(many.problems) == 21
    assert "20000 problems" in str(many.problems[-1])


@pytest.mark.slow
def test_a_replay_of_a_long_log_loads() -> None:
    assert Scenario.load(json.dumps(replay(*[STRAIGHT_IN] * 50_000))).steps == 50_000


values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=8), inner, max_size=4),
    max_leaves=8,
)


@pytest.mark.slow
@settings(max_examples=examples(100), deadline=None)
@given(st.sampled_from(list(NUMBERS.values())), st.integers(1, 4), values)
def test_any_value_anywhere_is_taken_or_refused_by_name(field: NumberField, depth: int, value: Any) -> None:
    data = replace(field, path=field.path[:depth]).with_value(value)
    if refusal_or_none(data):
        assert refusal(data).problems
