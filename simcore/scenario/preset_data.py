"""The built-in scenarios as data: what each changes of the defaults."""

from __future__ import annotations

from typing import Any

from simcore.scenario.suggestions import did_you_mean

PRESETS: dict[str, tuple[str, dict[str, Any]]] = {
    "demo": (
        "I-FEM, full depth, an S to both sides on which the tissue visibly moves and a steel needle stays elastic",
        {
            "seed": 1,
            "trajectory": {"kind": "sine", "target_mm": [18, 38, 122], "amplitude_mm": 2.0},
        },
    ),
    "line": (
        "I-FEM along a straight oblique line, full depth",
        {"trajectory": {"kind": "line", "target_mm": [24, 41, 122]}},
    ),
    "sine": (
        "I-FEM along the same line with a sine overlay of 1.0 mm",
        {"trajectory": {"kind": "sine", "target_mm": [24, 41, 122], "amplitude_mm": 1.0}},
    ),
    "replay": (
        "prescribed base poses: push 30 mm straight in, hold, pull 1.5 mm back, push again",
        {
            "trajectory": {"kind": "line", "target_mm": [18, 31, 30]},
            "controller": {
                "kind": "replay",
                "poses": [
                    [18.0, 31.0, round(-180.0 + depth, 6), 1.0, 0.0, 0.0, 0.0]
                    for depth in [
                        *(0.1 * (i + 1) for i in range(300)),
                        *(30.0 for _ in range(20)),
                        *(30.0 - 0.05 * (i + 1) for i in range(30)),
                        *(28.5 + 0.05 * (i + 1) for i in range(30)),
                    ]
                ],
            },
        },
    ),
}


def unknown_preset(name: str) -> str:
    """What is wrong with a name that is none of theirs."""
    return f"is not a built-in scenario: {', '.join(PRESETS)}{did_you_mean(name, PRESETS)}"
