"""What the paper leaves open, and the values to which the sensitivity study moves it."""

from __future__ import annotations

import copy
import re
from dataclasses import dataclass
from typing import Any

Json = dict[str, Any]


@dataclass(frozen=True)
class Variation:
    """One parameter at another value; `changes` maps dotted fields of a scenario to values.

    ifem_only: it concerns that controller's own settings.
    """

    parameter: str
    value: str
    changes: tuple[tuple[str, Any], ...] = ()
    ifem_only: bool = False

    @property
    def name(self) -> str:
        """Parameter and value, good in a file name."""
        return re.sub(r"[^\w.]+", "-", f"{self.parameter} {self.value}")


def _gauge(number: int, outer_mm: float, inner_mm: float) -> Variation:
    tube = (("needle.outer_diameter_mm", outer_mm), ("needle.inner_diameter_mm", inner_mm))
    return Variation("needle", f"{number}G", tube)


VARIATIONS = (
    Variation("nominal", "defaults"),
    Variation("gain", "0.5", (("controller.gain", 0.5),), ifem_only=True),
    Variation("gain", "1.5", (("controller.gain", 1.5),), ifem_only=True),
    Variation("direction speed", "100 mm/s", (("controller.direction_speed_mm_s", 100.0),), ifem_only=True),
    Variation("direction speed", "300 mm/s", (("controller.direction_speed_mm_s", 300.0),), ifem_only=True),
    Variation("speed limit", "25 mm/s", (("robot.max_speed_mm_s", 25.0),)),
    Variation("speed limit", "100 mm/s", (("robot.max_speed_mm_s", 100.0),)),
    Variation("turn limit", "15 deg/s", (("robot.max_turn_deg_s", 15.0),)),
    Variation("turn limit", "120 deg/s", (("robot.max_turn_deg_s", 120.0),)),
    _gauge(16, 1.651, 1.194),
    _gauge(20, 0.908, 0.603),
    _gauge(22, 0.718, 0.413),
    Variation("friction", "0", (("interaction.friction", 0.0), ("interaction.adhesion_n_per_mm", 0.0))),
    Variation("friction", "0.3", (("interaction.friction", 0.3),)),
    Variation("tip", "held", (("interaction.tip", "held"),)),
    Variation("puncture", "0.1 N", (("interaction.puncture_n", 0.1),)),
    Variation("coupling", "hard points", (("interaction.line_compliance", False), ("interaction.tip", "held"))),
    Variation("fixed faces", "y and back", (("tissue.fixed_faces", ["y_min", "y_max", "z_max"]),)),
    Variation("fixed faces", "x = 0", (("tissue.fixed_faces", ["x_min"]),)),
    Variation("amplitude", "0.5 mm", (("trajectory.amplitude_mm", 0.5),)),
    Variation("amplitude", "1.5 mm", (("trajectory.amplitude_mm", 1.5),)),
    Variation("stiffness", "3.2 kPa", (("tissue.young_kpa", 3.2),)),
    Variation("stiffness", "8.5 kPa", (("tissue.young_kpa", 8.5),)),
    Variation("model", "separate", (("controller.model", {"kind": "separate"}),), ifem_only=True),
    Variation(
        "model", "separate 5.0 kPa", (("controller.model", {"kind": "separate", "young_kpa": 5.0}),), ifem_only=True
    ),
    Variation("jacobian", "exact", (("controller.derivative", "exact"),), ifem_only=True),
    Variation("dt", "half", (("dt_s", 0.5),)),
    Variation("dt", "double", (("dt_s", 2.0),)),
)
_FACTORS = ("dt_s",)  # given as a factor of the scale's value


def apply_variation(scenario: Json, variation: Variation) -> Json:
    """The scenario with the variation's fields; a change of the sine's amplitude leaves a straight path as it is."""
    data = copy.deepcopy(scenario)
    for field, value in variation.changes:
        *blocks, leaf = field.split(".")
        holder = data
        for block in blocks:
            holder = holder.setdefault(block, {})
        if leaf == "amplitude_mm" and holder["kind"] == "line":
            continue
        holder[leaf] = holder[leaf] * value if field in _FACTORS else copy.deepcopy(value)
    if isinstance(model := data.get("controller", {}).get("model"), dict):
        model.setdefault("element_size_mm", data["tissue"]["element_size_mm"])
    return data
