"""Tables as editors and spreadsheets write them."""

from __future__ import annotations

import numpy as np
import pytest

from simcore.scenario.number_table import comma_separated

ROWS = [[18.0, 31.0, 5.0], [18.5, 32.0, 1e1]]


@pytest.mark.parametrize(
    "text",
    [
        "18,31,5\n18.5,32,1e1",
        "x_mm,y_mm,z_mm\n18,31,5\n18.5,32,10\n",
        '"x_mm","y_mm","z_mm"\r\n18,31,5\r\n18.5,32,10\r\n',
        "\ufeffx_mm,y_mm,z_mm\r\n18,31,5\r\n18.5,32,10\r\n",
        "\ufeff18,31,5\n18.5,32,10\n",
        "\n\n(mm),(mm),(mm)\n 18, 31, 5\n18.5, 32, +10.\n\n",
    ],
)
def test_the_same_numbers_in_every_spelling(text: str) -> None:
    np.testing.assert_array_equal(comma_separated(text.encode()), ROWS)


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("", "it holds no numbers"),
        ("x,y,z\n", "it holds no numbers"),
        ("18;31;5\n", "separated by semicolons"),
        ("x;y;z\n18,5;31;5\n", "separated by semicolons"),
        ("18\t31\t5\n", "separated by tabs"),
        ("18,3l,5\n18,32,10\n", "3l"),  # one wrong number in the first line is no heading
        ("18,31,5\n18,32\n", "number of columns changed"),
    ],
)
def test_what_is_wrong_is_said(text: str, why: str) -> None:
    with pytest.raises(ValueError, match=why):
        comma_separated(text.encode())
