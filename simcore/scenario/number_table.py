"""Tables of numbers in text: a row a line, commas between the numbers, a heading if there is one."""

from __future__ import annotations

import codecs
import io
import warnings
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from simcore.arrays import Floats


def comma_separated(data: bytes) -> Floats:
    """(rows, columns) numbers. A first line without any number is a heading; so may be a byte order mark before it.

    Raises ValueError, with what is wrong and where.
    """
    text = data.removeprefix(codecs.BOM_UTF8)
    first = text.lstrip().partition(b"\n")[0].strip()
    for name, mark in (("semicolons", b";"), ("tabs", b"\t")):
        if mark in first:
            raise ValueError(f"its columns are separated by {name}; commas are read, with points in the numbers")
    heading = 0 if any(map(_is_number, first.split(b","))) else 1
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # of an empty file
        try:
            return np.loadtxt(
                io.BytesIO(text.lstrip()), delimiter=",", ndmin=2, skiprows=heading, encoding="utf-8", dtype=float
            )
        except UserWarning:
            raise ValueError("it holds no numbers") from None


def _is_number(cell: bytes) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True
