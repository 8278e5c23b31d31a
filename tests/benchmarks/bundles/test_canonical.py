"""One spelling of JSON: the examples of RFC 8785."""

from __future__ import annotations

import json
import struct

import pytest

from benchmarks.bundles.canonical import BundleError, canonical, digest_of, read_canonical

NUMBERS = {  # appendix B: IEEE 754 in hexadecimal -> text
    "0000000000000000": "0",
    "8000000000000000": "0",
    "0000000000000001": "5e-324",
    "8000000000000001": "-5e-324",
    "7fefffffffffffff": "1.7976931348623157e+308",
    "4340000000000000": "9007199254740992",
    "c340000000000000": "-9007199254740992",
    "4430000000000000": "295147905179352830000",
    "44b52d02c7e14af5": "9.999999999999997e+22",
    "44b52d02c7e14af6": "1e+23",
    "44b52d02c7e14af7": "1.0000000000000001e+23",
    "444b1ae4d6e2ef4e": "999999999999999700000",
    "444b1ae4d6e2ef50": "1e+21",
    "3eb0c6f7a0b5ed8c": "9.999999999999997e-7",
    "3eb0c6f7a0b5ed8d": "0.000001",
    "41b3de4355555553": "333333333.3333332",
    "becbf647612f3696": "-0.0000033333333333333333",
    "43143ff3c1cb0959": "1424953923781206.2",
}


@pytest.mark.parametrize(("bits", "text"), NUMBERS.items(), ids=NUMBERS.values())
def test_numbers_are_those_of_the_standard(bits: str, text: str) -> None:
    (value,) = struct.unpack(">d", bytes.fromhex(bits))
    assert canonical(value) == text.encode()


def test_names_are_sorted_by_utf_16_and_texts_are_escaped_as_little_as_can_be() -> None:
    data = {"\u20ac": "Euro Sign", "\r": "Carriage Return", "\ufb33": "Hebrew Letter Dalet With Dagesh", "1": "One"}
    data |= {"\U0001f600": "Emoji: Grinning Face", "\u0080": "Control", "\u00f6": "Latin Small Letter O With Diaeresis"}
    order = ["\r", "1", "\u0080", "\u00f6", "\u20ac", "\U0001f600", "\ufb33"]
    assert list(json.loads(canonical(data))) == order
    assert (
        canonical({"string": '\u20ac$\u000f\nA\'B"\\\\"/'}) == '{"string":"€$\\u000f\\nA\'B\\"\\\\\\\\\\"/"}'.encode()
    )


def test_data_in_another_order_has_the_same_digest_and_other_data_another() -> None:
    assert digest_of({"a": 1.0, "b": [True, None]}) == digest_of({"b": [True, None], "a": 1})
    assert digest_of({"a": 1}) != digest_of({"a": 2})


@pytest.mark.parametrize("value", [float("nan"), float("inf"), 2**60, {1: 2}], ids=["nan", "inf", "2^60", "key"])
def test_what_has_no_spelling_is_refused(value: object) -> None:
    with pytest.raises(BundleError, match="cannot be written as canonical JSON"):
        canonical(value)


@pytest.mark.parametrize("text", [b'{"b":1,"a":2}', b'{"a": 1}', b'{"a":1,"a":1}', b'{"a":1.0}', b"[" * 100_000, b"{"])
def test_any_other_spelling_is_refused(text: bytes) -> None:
    with pytest.raises(BundleError, match=r"manifest.json is not (canonical|readable) JSON"):
        read_canonical(text, "manifest.json")
