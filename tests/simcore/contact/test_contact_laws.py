"""The dense problem of all contact laws against brute force over modes, and the laws themselves on its solutions."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from simcore.contact.laws import Law, Response, Staircase, solve_laws, staircases
from tests.budget import examples
from tests.verification import verify

Vector = np.ndarray
LENGTH_M, CUTTING_N, PUNCTURE_N = 0.1, 0.1, 0.12
SLACK_N = 3e-9  # the laws are settled to 1e-9 N each
quick = settings(max_examples=examples(150), deadline=None)


@dataclass
class Problem:
    """Elements 0 (tip or contact), 1, 2, ... with a random compliance; arrays as `solve_laws` takes them."""

    w: Vector
    gap: Vector
    arc: Vector
    force: Vector
    base: Vector
    friction: float
    contact: bool
    arc_old: Vector
    mode: Vector
    stair: Staircase
    slide: Vector
    free: Vector  # (a,) bears no lateral force

    @property
    def speed(self) -> Vector:
        return np.linspace(0.9, 1.1, len(self.arc))

    def solved(self) -> tuple[Vector, Vector]:
        """(a, 3) N and (a,) m; the modes are updated in place."""
        force, arc = np.empty_like(self.gap), np.empty_like(self.arc)
        response = Response(self.w, self.gap, self.arc, self.speed, self.force)
        law = Law(self.stair, self.base, self.friction, self.contact, self.free)
        assert solve_laws(response, law, self.mode, self.slide, force, arc)
        return force, arc

    def gaps(self, force: Vector) -> Vector:
        """(a, 3) m: gap + w (force' - force)."""
        return self.gap + (self.w @ (force - self.force).ravel()).reshape(-1, 3)

    def levels(self, i: int, lateral: float) -> Vector:
        return self.stair.sign[i] * (self.base[i] + self.friction * lateral) + self.stair.extra[i]


def random_problem(
    seed: int, elements: int, friction: float, *, contact: bool = False, withdrawn: bool = False, free_tip: bool = False
) -> Problem:
    """Compliances of tissue size (10 mm/N, coupled), gaps of 2 mm, forces of 0.1 N; a free tip has no lateral force."""
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(3 * elements, 3 * elements))
    w = 1e-2 * (np.eye(3 * elements) + root @ root.T / (3 * elements))
    gap = rng.normal(scale=2e-3, size=(elements, 3))
    arc_old: Vector = LENGTH_M - 0.01 * np.arange(elements) + (1e-3 if withdrawn else 0.0)
    stair = Staircase.of_size(elements)
    mode = rng.integers(0, 3, elements)
    base = np.zeros(elements) if contact else rng.uniform(0.0, 0.06, elements)
    numbers = (LENGTH_M, CUTTING_N, PUNCTURE_N)
    staircases(contact, np.arange(elements), arc_old, *numbers, mode, stair)
    force = rng.normal(scale=0.05, size=(elements, 3))
    free = np.arange(elements) == (0 if free_tip else -1)
    arc = arc_old + rng.normal(scale=1e-3, size=elements)
    state = (w, gap, arc, force, base, friction, contact, arc_old)
    return Problem(*state, mode, stair, np.zeros(2), free)


def consistent(p: Problem, force: Vector, arc: Vector, mode: Vector) -> bool:
    """Whether forces and arc lengths obey the staircases of specification of the interaction in these modes."""
    for i in range(len(arc)):
        k, levels = mode[i] // 2, p.levels(i, np.hypot(*force[i, :2]))
        breaks = p.stair.breaks[i, : p.stair.steps[i]]
        if mode[i] % 2 == 1:
            inside = levels[k] - SLACK_N <= force[i, 2] <= levels[k + 1] + SLACK_N
            if not inside or abs(arc[i] - breaks[k]) > 1e-10:
                return False
        else:
            behind = k == len(breaks) or arc[i] >= breaks[k] - 1e-10
            ahead = k == 0 or arc[i] <= breaks[k - 1] + 1e-10
            if not (behind and ahead) or abs(force[i, 2] - levels[k]) > SLACK_N:
                return False
    return True


def brute_force(p: Problem) -> list[tuple[Vector, Vector, Vector]]:
    """Every consistent solution (force, arc, mode): all combinations of modes, each by fixed-point iteration on the
    friction's |lambda_n|."""
    found = []
    for mode in product(*(range(2 * count + 1) for count in p.stair.steps)):
        force = fixed_modes(p, np.array(mode))
        if force is None:
            continue
        arc = p.arc + p.gaps(force)[:, 2] / p.speed
        if consistent(p, force, arc, np.array(mode)):
            found.append((force, arc, np.array(mode)))
    return found


def fixed_modes(p: Problem, mode: Vector) -> Vector | None:
    """(a, 3) N with zero lateral gaps, or zero lateral force where free, sticking rows at their breakpoints and sliding
    rows at their levels."""
    force, a = p.force.copy(), len(mode)
    for _ in range(500):
        matrix, right = p.w.copy(), p.w @ p.force.ravel() - p.gap.ravel()
        for i in range(a):
            row, k = 3 * i + 2, mode[i] // 2
            if mode[i] % 2 == 1:
                right[row] += (p.stair.breaks[i, k] - p.arc[i]) * p.speed[i]
            else:
                matrix[row], right[row] = np.eye(3 * a)[row], p.levels(i, np.hypot(*force[i, :2]))[k]
            for side in range(3 * i, 3 * i + 2 if p.free[i] else 3 * i):
                matrix[side], right[side] = np.eye(3 * a)[side], 0.0
        new = np.linalg.solve(matrix, right).reshape(a, 3)
        if np.abs(new - force).max() < 1e-13:
            return new
        force = new
    return None


seeds = st.integers(0, 2**32 - 1)
frictions = st.just(0.0) | st.floats(0.01, 0.3)


@pytest.mark.slow
@quick
@given(seeds, st.integers(1, 3), st.sampled_from([0.0, 0.1, 0.3]), st.booleans(), st.booleans())
def test_solution_is_one_of_brute_force(
    seed: int, elements: int, friction: float, withdrawn: bool, free_tip: bool
) -> None:
    """All laws at once equal the enumeration of every mode, with a tip at the channel end or withdrawn from it, held
    sideways or free."""
    p = random_problem(seed, elements, friction, withdrawn=withdrawn, free_tip=free_tip)
    expected = brute_force(p)
    assert expected
    if friction == 0.0:
        assert np.ptp([force for force, _, _ in expected], axis=0).max() < 1e-8  # monotone laws: unique
    force, arc = p.solved()
    assert min(np.abs(force - other).max() for other, _, _ in expected) < 1e-8
    assert min(np.abs(arc - other).max() for _, other, _ in expected) < 1e-10


@pytest.mark.slow
@pytest.mark.parametrize("friction", [0.0, 0.1, 0.3])
def test_friction_states_are_those_of_the_fixed_point_reference(friction: float) -> None:
    """Stick, slip and cutting of each point, and the forces, in 60 problems of two and three points, the tip at the
    channel end or withdrawn from it: one of the solutions that the reference finds."""
    states, misses = 0, []
    for seed in range(60):
        p = random_problem(seed, 2 + seed % 2, friction, withdrawn=seed % 3 == 0)
        expected = brute_force(p)
        force, _ = p.solved()
        nearest = min(expected, key=lambda found: float(np.abs(force - found[0]).max()))
        states += int((p.mode != nearest[2]).any())
        misses.append(np.abs(force - nearest[0]).max())
    text, source = (
        f"friction at mu = {friction:g}, 60 problems",
        "all modes, each by fixed-point iteration on |lambda_n|",
    )
    verify("coupled", f"{text}: other friction state", expected=0, measured=states, tolerance=0, source=source)
    verify("coupled", f"{text}: forces", expected=0, measured=misses, tolerance=1e-8, source=source, unit="N")


@pytest.mark.slow
@quick
@given(seeds, st.integers(1, 6), frictions, st.booleans())
def test_solution_obeys_the_laws(seed: int, elements: int, friction: float, withdrawn: bool) -> None:
    """Bilateral lateral rows; |axial force| <= b + f_cut; stick at the breakpoint inside the bounds, else slip at
    a bound, against the slip (specification of the interaction). A tip that is held."""
    p = random_problem(seed, elements, friction, withdrawn=withdrawn)
    force, arc = p.solved()
    assert np.abs(p.gaps(force)[:, :2]).max() < 1e-12
    np.testing.assert_allclose(arc - p.arc, p.gaps(force)[:, 2] / p.speed, atol=1e-12)
    assert consistent(p, force, arc, p.mode)
    bound = p.base + friction * np.hypot(*force[:, :2].T)
    bound[0] += CUTTING_N
    assert (np.abs(force[:, 2]) <= bound + SLACK_N).all()
    assert (force[1:, 2] * (arc - p.arc_old)[1:] <= 1e-12).all()  # dissipation: a falling s moves the needle forward


@pytest.mark.slow
@quick
@given(seeds, st.integers(1, 6), frictions, st.booleans())
def test_a_free_element_bears_no_lateral_force(seed: int, elements: int, friction: float, withdrawn: bool) -> None:
    """Exactly none, whatever its gap and the forces before; all other rows and every axial law hold as ever, and its
    axial level is without Coulomb's share."""
    p = random_problem(seed, elements, friction, withdrawn=withdrawn, free_tip=True)
    force, arc = p.solved()
    assert np.abs(force[0, :2]).max() == 0.0
    assert np.abs(p.gaps(force)[1:, :2]).max(initial=0.0) < 1e-12
    np.testing.assert_allclose(arc - p.arc, p.gaps(force)[:, 2] / p.speed, atol=1e-12)
    assert consistent(p, force, arc, p.mode)
    assert abs(force[0, 2]) <= p.base[0] + CUTTING_N + SLACK_N
    held = random_problem(seed, elements, friction, withdrawn=withdrawn)
    assert np.abs(held.solved()[0][0, :2]).max() > 0.0  # the same tip, held, would bear one


@pytest.mark.slow
@quick
@given(seeds, st.integers(1, 5), frictions, st.floats(1e-4, 1.0))
def test_compliance_of_a_row_belongs_to_w_and_to_its_gap(
    seed: int, elements: int, friction: float, compliance: float
) -> None:
    """With C in w and C lambda in the gap a row says p - c + C lambda = 0: the bare gap that is left is -C times the
    force, in both lateral directions; C -> 0 is the hard row."""
    p, hard = (random_problem(seed, elements, friction) for _ in range(2))
    springs = np.tile(np.array([compliance, 0.6 * compliance, 0.0]), elements)
    p.w = p.w + np.diag(springs)
    p.gap = p.gap + springs.reshape(-1, 3) * p.force
    force, arc = p.solved()
    assert consistent(p, force, arc, p.mode)
    bare = hard.gaps(force)[:, :2]
    np.testing.assert_allclose(bare, -springs.reshape(-1, 3)[:, :2] * force[:, :2], atol=1e-11)


@pytest.mark.slow
@quick
@given(seeds, frictions)
def test_cutting_is_complementary_to_its_force(seed: int, friction: float) -> None:
    """0 <= f_cut + b - lambda_t, advance >= 0, and the product of both is 0."""
    p = random_problem(seed, 2, friction)
    force, arc = p.solved()
    spare = CUTTING_N + p.base[0] + friction * np.hypot(*force[0, :2]) - force[0, 2]
    advance = max(LENGTH_M - arc[0], 0.0)
    assert spare >= -SLACK_N
    assert spare * advance <= 1e-11


@pytest.mark.slow
@quick
@given(seeds)
def test_surface_contact_is_signorini_and_coulomb(seed: int) -> None:
    """0 <= lambda_n, penetration <= 0 before puncture, complementary; |lambda_t| <= mu lambda_n."""
    p = random_problem(seed, 1, 0.2, contact=True)
    p.mode[:] = 1
    p.arc[:] = LENGTH_M
    force, arc = p.solved()
    normal, open_by = force[0, 2], arc[0] - LENGTH_M
    assert -SLACK_N <= normal <= PUNCTURE_N + SLACK_N
    if p.mode[0] < 2:
        assert open_by >= -1e-12
        assert normal * open_by <= 1e-14
    tangential = np.hypot(*force[0, :2])
    assert tangential <= 0.2 * normal + SLACK_N
    if tangential < 0.2 * normal - SLACK_N:
        assert np.abs(p.gaps(force)[0, :2]).max() < 1e-12


def test_surface_slip_is_opposite_to_its_friction() -> None:
    """Coulomb: the friction on the tissue has the direction in which the needle slips, for any lateral compliance."""
    p = random_problem(0, 1, 0.2, contact=True)
    p.w = np.diag([2e-2, 1e-2, 1e-2])
    p.gap, p.force = np.array([[-4e-3, -3e-3, -1e-3]]), np.zeros((1, 3))
    p.mode[:], p.arc[:] = 1, LENGTH_M
    force, _ = p.solved()
    slip = -p.gaps(force)[0, :2]
    size = np.hypot(*force[0, :2])
    numbers: dict[str, Any] = {"tolerance": 1e-9, "source": "Coulomb"}
    text = "surface contact that slips over an anisotropic tissue"
    verify("coupled", f"{text}: |friction| / normal force", expected=0.2, measured=size / force[0, 2], **numbers)
    slipping = slip / np.hypot(*slip)
    verify("coupled", f"{text}: direction of the friction", expected=slipping, measured=force[0, :2] / size, **numbers)


def test_stick_and_slip_both_occur() -> None:
    """Non-vacuity of the cases above: each mode of each kind of element is met."""
    met: dict[str, set[int]] = {key: set() for key in ("tip", "withdrawn", "shaft", "contact")}
    for seed in range(300):
        plain = random_problem(seed, 2, 0.1)
        plain.solved()
        away = random_problem(seed, 2, 0.1, withdrawn=True)
        away.solved()
        touching = random_problem(seed, 1, 0.1, contact=True)
        touching.mode[:], touching.arc[:] = 1, LENGTH_M
        touching.solved()
        for key, mode in zip(met, (plain.mode[0], away.mode[0], plain.mode[1], touching.mode[0]), strict=True):
            met[key].add(int(mode))
    assert met == {"tip": {0, 1, 2}, "withdrawn": {0, 1, 2, 3, 4}, "shaft": {0, 1, 2}, "contact": {0, 1, 2}}
