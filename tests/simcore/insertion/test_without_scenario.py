"""The solver is used without JSON: an insertion of SI objects alone, in a process that cannot import pydantic."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

SCRIPT = """
import sys

sys.modules["pydantic"] = None  # an import of it is an ImportError

import numpy as np
from simcore.contact.channel import ChannelModel
from simcore.contact.laws import ContactLaw
from simcore.contact.line import LineCoupling, cylinder_compliance
from simcore.insertion.insertion import Insertion
from simcore.insertion.jacobian_exact import linearise_exactly
from simcore.insertion.model import CoupledModel, Tolerances
from simcore.insertion.state import Pose
from simcore.mesh.mesh import box_mesh
from simcore.mesh.numbering import held_nodes
from simcore.needle.model import NeedleModel, Tube
from simcore.tissue.model import Material, TissueModel

mesh = box_mesh(np.array([0.024, 0.04, 0.06]), (2, 4, 6))
tissue = TissueModel.of(mesh, held_nodes(mesh, ["y_min", "y_max"]), Material(young_pa=6300.0, poisson=0.4))
needle = NeedleModel.from_tube(Tube(0.09, 8, 1.27e-3, 0.838e-3, 200e9, 0.29))
entry = np.array([0.012, 0.02, 0.0])
sizes = {"spacing_m": 0.01, "bevel_m": 1.27e-3, "spread_m": 0.004, "longest_m": 0.09}
channel = ChannelModel.of(**sizes, mesh=mesh, entry_m=entry, hard=False)
law = ContactLaw(friction=0.1, adhesion_n_per_m=10.0, cutting_n=0.1, puncture_n=0.1)
across, along = cylinder_compliance(shear_pa=2250.0, poisson=0.4, needle_radius_m=6.35e-4, ball_radius_m=0.004)
line = LineCoupling(False, np.diag([across, across, along]), free_tip=True, bevel_m=1.27e-3, force_share_m_per_n=1e-3)
model = CoupledModel(tissue, needle, channel, law, line, Tolerances(), entry, dt_s=0.01)
insertion = Insertion(model)
state = insertion.initial_state(np.array([0.0, 0.0, 1.0]))
for _ in range(40):
    state = insertion.step(state, Pose(state.base.position_m + np.array([0.0, 0.0, 5e-4]), state.base.rotation))
    assert state.report.status == "completed", state.report
assert np.isfinite(linearise_exactly(insertion.model, state.solved).tip).all()
assert not [name for name in sys.modules if name.startswith("simcore.scenario")]
push = float(state.base_wrench[:3] @ state.base.rotation[:, 2])
print(state.inserted_m, push)
"""


@pytest.mark.slow
def test_an_insertion_of_si_objects_needs_no_pydantic() -> None:
    """20 mm of push: base force = f_cut + tau0 D, D the inserted length."""
    root = Path(__file__).resolve().parents[3]
    done = subprocess.run([sys.executable, "-c", SCRIPT], capture_output=True, text=True, cwd=root)
    assert done.returncode == 0, done.stderr
    inserted_m, push_n = map(float, done.stdout.split())
    assert 0.01 < inserted_m < 0.02
    assert abs(push_n - (0.1 + 10.0 * inserted_m)) < 1e-4
