"""Behaviour cloning: a policy that imitates I-FEM, learned with scikit-learn, steers the environment.

    python docs/example_cloning.py cloning.svg

prints the errors of open loop, policy and I-FEM along paths that none of them was trained on, and draws them.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray
from sklearn.neural_network import MLPRegressor
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

import needlebench.gym
from benchmarks.svg_plot import Line, Panel, svg
from needlebench import Scenario, run
from needlebench.gym import actions_of
from simcore.rotations import matrix_from_quaternion

Values = NDArray[np.float64]

TRAINING, TEST = range(8), range(100, 104)  # seeds of the environment
COARSE = {"tissue.element_size_mm": 12, "needle.elements": 12, "dt_s": 0.02}
DEPTH_MM = 40.0
NOISE_MM = 0.25  # of the target while I-FEM shows what it does: it must show how to come back to the path


@dataclass(frozen=True)
class Insertion:
    """One insertion. depth_mm, error_mm: (steps,) of the tip and from its target."""

    depth_mm: Values
    error_mm: Values


def environment(depth_mm: float) -> gymnasium.Env[Any, Any]:
    """Curves to random points of one depth, in a coarse mesh."""
    return gymnasium.make("needlebench/Curve-v0", depth_mm=depth_mm, changes=COARSE)


def scenario_of(env: gymnasium.Env[Any, Any], seed: int, **changes: Any) -> Scenario:
    """What the environment draws for a seed, with other fields."""
    return Scenario.load({**env.reset(seed=seed)[1]["scenario"], **changes})


def features(base: Values, tip: Values, target: Values) -> Values:
    """(n, 12): what the policy sees of pose of the base (n, 7), tip (n, 3) and target (n, 3): error, target, base."""
    error, axis = target - tip, np.array([matrix_from_quaternion(q)[:2, 2] for q in base[:, 3:]])
    return np.hstack([1e3 * error, 1e2 * target, 1e2 * base[:, :3], 1e2 * axis, 1e2 * tip[:, 2:]])


def demonstrations(scenario: Scenario) -> tuple[Values, Values]:
    """What I-FEM saw (n, 12), and the actions (n, 6) that it answered with."""
    rollout = run(scenario)
    series = rollout.series
    base = np.hstack([series["base_position_m"], series["base_rotation"]])
    seen = features(base[:-1], series["tip_seen_m"][:-1], series["target_noisy_m"][:-1])
    return seen, actions_of(rollout)


def train(env: gymnasium.Env[Any, Any], seeds: range) -> Any:
    """A small network on the demonstrations of these seeds."""
    pairs = [demonstrations(scenario_of(env, seed, noise_mm=NOISE_MM)) for seed in seeds]
    seen, moves = (np.concatenate(parts) for parts in zip(*pairs, strict=True))
    network = MLPRegressor(hidden_layer_sizes=(64, 64), max_iter=300, random_state=0)
    return make_pipeline(StandardScaler(), network).fit(seen, moves)


def steer(env: gymnasium.Env[Any, Any], policy: Any, seed: int) -> Insertion:
    """The policy in the environment."""
    seen, _ = env.reset(seed=seed)
    done = False
    while not done:
        row = features(seen["base"][None].astype(float), seen["tip"][None], seen["target"][None])
        action = np.clip(policy.predict(row)[0], -1.0, 1.0).astype(np.float32)
        seen, _, terminated, truncated, _ = env.step(action)
        done = terminated or truncated
    return judged(env.unwrapped.rollout)  # type: ignore[attr-defined]


def judged(rollout: Any) -> Insertion:
    """Errors of a rollout: each step against the target that it was commanded for."""
    series = rollout.series
    error = 1e3 * np.linalg.norm(series["tip_m"][1:] - series["target_m"][:-1], axis=1)
    return Insertion(1e3 * series["depth_m"][1:], error)


def compare(depth_mm: float, training: range, test: range) -> dict[str, list[Insertion]]:
    """Every test insertion by open loop, by the policy and by I-FEM."""
    env = environment(depth_mm)
    policy = train(env, training)
    return {
        "open loop": [judged(run(scenario_of(env, seed, controller={"kind": "open_loop"}))) for seed in test],
        "cloned policy": [steer(env, policy, seed) for seed in test],
        "I-FEM": [judged(run(scenario_of(env, seed))) for seed in test],
    }


def rmse_mm(insertions: list[Insertion]) -> float:
    """Over all steps of all insertions."""
    return float(np.sqrt(np.mean(np.concatenate([one.error_mm for one in insertions]) ** 2)))


def figure(found: dict[str, list[Insertion]]) -> str:
    """SVG: error over depth, the mean of the test insertions."""
    deepest = min(one.depth_mm[-1] for insertions in found.values() for one in insertions)
    depth = np.linspace(0.0, deepest, 60)
    lines = [
        Line(
            f"{name}, RMSE {rmse_mm(insertions):.2f} mm",
            depth.tolist(),
            np.mean([np.interp(depth, one.depth_mm, one.error_mm) for one in insertions], axis=0),
            markers=False,
        )
        for name, insertions in found.items()
    ]
    return svg([[Panel("", "depth, mm", "error of the tip, mm", tuple(lines))]], width=640, height=360)


def main(path: Path) -> None:
    """Train, steer, print and draw."""
    found = compare(DEPTH_MM, TRAINING, TEST)
    for name, insertions in found.items():
        print(f"{name:<14} {rmse_mm(insertions):6.3f} mm over {len(insertions)} insertions")  # noqa: T201
    path.write_text(figure(found), encoding="utf-8")


if __name__ == "__main__":
    assert needlebench.gym.IDS
    main(Path(sys.argv[1]))
