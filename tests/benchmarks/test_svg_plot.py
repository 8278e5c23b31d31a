"""Pictures: valid XML, ticks at round values, points where they belong."""

from __future__ import annotations

import math
from xml.etree import ElementTree

import pytest

from benchmarks.svg_plot import Axis, Band, BoxMark, Line, Panel, fitted_axis, linear_ticks, log_ticks, number, svg

SPACE = "{http://www.w3.org/2000/svg}"


def texts(picture: str) -> list[str]:
    return [element.text or "" for element in ElementTree.fromstring(picture).iter(f"{SPACE}text")]


def test_a_picture_is_valid_xml_with_all_its_texts() -> None:
    line = Line("a < b & 'c'", [1.0, 10.0, 100.0], [0.1, 1.0, 10.0])
    panel = Panel("t < 1", "x & y", "µ", (line, Line("second", [1.0, 2.0], [3.0, 4.0], dashed=True)), x_log=True)
    picture = svg([[panel, panel], [panel]], title="<all>")
    found = texts(picture)
    for text in ("a < b & 'c'", "second", "t < 1", "x & y", "µ", "<all>"):
        assert text in found
    root = ElementTree.fromstring(picture)
    assert root.attrib["viewBox"] == "0 0 900 874"
    assert len({clip.attrib["id"] for clip in root.iter(f"{SPACE}clipPath")}) == 3


def test_points_that_have_no_place_interrupt_the_line() -> None:
    line = Line("", [1.0, 2.0, 3.0, 4.0, 5.0], [1.0, math.nan, 3.0, -1.0, 5.0])
    plain = ElementTree.fromstring(svg([[Panel("", "", "", (line,))]]))
    logarithmic = ElementTree.fromstring(svg([[Panel("", "", "", (line,), y_log=True)]]))
    assert len(list(plain.iter(f"{SPACE}circle"))) == 4
    assert len(list(logarithmic.iter(f"{SPACE}circle"))) == 3


@pytest.mark.parametrize("values", [[], [math.nan], [0.0, 0.0], [5.0, 5.0], [-3.0, -3.0]])
@pytest.mark.parametrize("log", [False, True])
def test_poor_data_still_give_a_picture(values: list[float], log: bool) -> None:
    line = Line("poor", [1.0] * len(values), values)
    ElementTree.fromstring(svg([[Panel("", "", "", (line,), y_log=log, y_zero=not log)]]))


def test_bands_and_named_ticks() -> None:
    panel = Panel("", "", "", (Line("", [0.0, 1.0], [1.0, 2.0]),), (Band("strip", 0.2, 0.4, "y"),), x_names=("p", "q"))
    found = texts(svg([[panel]]))
    assert {"p", "q", "strip"} <= set(found)


@pytest.mark.parametrize(
    ("low", "high", "ticks"),
    [
        (0.0, 1.0, [0.0, 0.2, 0.4, 0.6, 0.8, 1.0]),
        (-5.0, 20.0, [-5.0, 0.0, 5.0, 10.0, 15.0, 20.0]),
        (0.0, 0.0031, [0.0, 0.001, 0.002, 0.003]),
    ],
)
def test_linear_ticks_are_round(low: float, high: float, ticks: list[float]) -> None:
    assert linear_ticks(low, high) == pytest.approx(ticks)


def test_log_ticks_are_decades_or_finer() -> None:
    assert log_ticks(0.5, 2000.0) == pytest.approx([1, 10, 100, 1000])
    assert log_ticks(800.0, 9000.0) == pytest.approx([1000, 2000, 5000])
    assert log_ticks(0.363, 0.546) == pytest.approx([0.4, 0.45, 0.5])
    assert log_ticks(1e-12, 1e12) == pytest.approx([10.0**k for k in range(-12, 13, 4)])


def test_axes_map_their_ends() -> None:
    axis = fitted_axis([2.0, 10.0], 400.0, 100.0, log=False)
    assert axis.low == 0.0  # nearly reached
    assert axis.at(axis.low) == 400.0
    assert axis.at(axis.high) == 100.0
    assert Axis(1.0, 100.0, 0.0, 200.0, True).at(10.0) == pytest.approx(100.0)


@pytest.mark.parametrize(
    ("value", "text"), [(0.0, "0"), (0.25, "0.25"), (2000.0, "2000"), (1e-6, "10⁻⁶"), (-5e-7, "-5·10⁻⁷"), (1e6, "10⁶")]
)
def test_tick_labels(value: float, text: str) -> None:
    assert number(value) == text


def test_boxes_stand_in_their_place() -> None:
    mark = BoxMark(1.0, 0.1, 0.2, 0.3, 0.5, 0.9, (1.5, 2.0), 1, "0.3")
    panel = Panel("", "", "", (), x_names=("first\n20", "second"), boxes=(mark,), y_log=True)
    root = ElementTree.fromstring(svg([[panel]], name="p", about=("errors", "one box")))
    assert [element.text for element in root.iter() if element.tag in (f"{SPACE}title", f"{SPACE}desc")] == [
        "errors",
        "one box",
    ]
    assert root.attrib["aria-labelledby"] == "p-t p-d"
    assert len(list(root.iter(f"{SPACE}circle"))) == 2
    assert {"first", "20", "second", "0.3"} <= {element.text for element in root.iter(f"{SPACE}text")}
    box = next(element for element in root.iter(f"{SPACE}rect") if "fill-opacity" in element.attrib)
    top, bottom = float(box.attrib["y"]), float(box.attrib["y"]) + float(box.attrib["height"])
    median = next(e for e in root.iter(f"{SPACE}path") if e.attrib.get("stroke-width") == "2.6")
    assert top < float(median.attrib["d"].split()[1].split("h")[0]) < bottom


def test_panels_can_share_a_range_and_show_a_spread() -> None:
    line = Line("", [1.0, 2.0], [2.0, 2.0], spread=([1.0, math.nan], [3.0, 4.0]))
    wide = svg([[Panel("", "", "", (line,), y_also=(100.0,), y_zero=True)]])
    assert "100" in texts(wide)
    assert "100" not in texts(svg([[Panel("", "", "", (line,), y_zero=True)]]))
    assert wide.count("opacity='0.14'") == 1
