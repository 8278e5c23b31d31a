"""The published liver forces: their unit, their spread, and where they end."""

from __future__ import annotations

import pytest

from benchmarks.studies.bovine_liver import CUTTING_N, PUNCTURE_N, MeanAndDeviation, friction_n_per_mm


def test_friction_is_coulomb_and_viscous() -> None:
    """By hand at 10 mm/s: 10.57 + 212.31 * 0.01 = 12.69 N/m on the way in, 11.96 + 2.93 = 14.89 N/m on the way out."""
    assert friction_n_per_mm("in", 10.0).mean == pytest.approx(12.6931e-3)
    assert friction_n_per_mm("in", 10.0).deviation == pytest.approx(4.797e-3)
    assert friction_n_per_mm("out", 10.0).mean == pytest.approx(14.8908e-3)


@pytest.mark.parametrize("speed", [0.0, -3.0, 20.1])
def test_a_speed_that_was_not_measured_is_refused(speed: float) -> None:
    with pytest.raises(ValueError, match=f"speed_mm_s = {speed:g}: friction was measured above 0 and up to 20 mm/s"):
        friction_n_per_mm("in", speed)


def test_shown_with_its_deviation() -> None:
    assert [str(value) for value in (PUNCTURE_N, CUTTING_N, MeanAndDeviation(-0.014891, 0.0047))] == [
        "2.304 ± 0.829",
        "0.94 ± 0.36",
        "-0.01489 ± 0.0047",
    ]
