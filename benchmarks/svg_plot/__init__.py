"""Line and box plots as SVG, without a plotting library: panels in a grid, linear and logarithmic axes, a legend each.

Every colour also has a class (`ink`, `pale`, `grid`, `paper`, `halo`, `band`, `s0` ... `s7`), so that the style
sheet of a page may replace it, in the dark for one.
"""

from benchmarks.svg_plot.axis import Axis, fitted_axis, linear_ticks, log_ticks
from benchmarks.svg_plot.drawing import svg
from benchmarks.svg_plot.elements import COLOURS, INK, PALE, number, picture, text
from benchmarks.svg_plot.panel import Band, BoxMark, Line, Panel

__all__ = [
    "COLOURS",
    "INK",
    "PALE",
    "Axis",
    "Band",
    "BoxMark",
    "Line",
    "Panel",
    "fitted_axis",
    "linear_ticks",
    "log_ticks",
    "number",
    "picture",
    "svg",
    "text",
]
