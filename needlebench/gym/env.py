"""The environment: an episode with random end points, rewards and pictures."""

from __future__ import annotations

import json
import tempfile
import uuid
from pathlib import Path
from typing import TYPE_CHECKING, Any

import gymnasium
import numpy as np

from needlebench.gym import spaces
from needlebench.gym.picture import picture
from needlebench.gym.tasks import DEPTH_MM, TASKS
from simcore.episode import Episode
from simcore.errors import Status
from simcore.rollout.recorder import Recorder
from simcore.rollout.records import Observer, Silent, StepTiming
from simcore.scenario.build import insertion_of
from simcore.scenario.presets import with_changes
from simcore.scenario.scenario import LARGEST_SEED, Scenario

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from service.recording.observer import RerunObserver
    from simcore.insertion.insertion import Insertion
    from simcore.insertion.state import Kept
    from simcore.rollout.records import StepRecord
    from simcore.rollout.result import Rollout

    Seen = dict[str, NDArray[np.float32]]

RCM_WEIGHT, FORCE_WEIGHT = 0.1, 0.1  # of a mm of remote-centre error and of a N of push, beside a mm of tip error
FAILURE, SUCCESS = -100.0, 10.0
PLANT = ("dt_s", "tissue", "needle", "interaction", "motion", "solver")  # with the entry: what an insertion is made of


def checked_action(action: Any, shape: tuple[int, ...], episode: Episode) -> NDArray[np.float64]:
    """The action as floats. Raises ValueError for one of another shape, or of no numbers."""
    try:
        given = np.asarray(action, float)
    except (TypeError, ValueError):
        raise ValueError(f"step {episode.step_number}: the action is {action!r:.80}, no array of numbers") from None
    if given.shape != shape:
        raise ValueError(f"step {episode.step_number}: the action has the shape {given.shape}, not {shape}")
    return given


class NeedleEnv(gymnasium.Env[Any, Any]):
    """Steer a needle's base; the tip should follow its target.

    task: name of one of `needlebench.gym.tasks`, which draws a scenario at every reset. depth_mm: of its end points, or
    of the deepest of them. changes: of every scenario that it draws, as {"tissue.element_size_mm": 10}. look_ahead:
    number of coming targets that are seen, 0 to 100. privileged: show shaft, contact forces and material as well.
    render_mode: rgb_array, or rerun, which writes a recording of each episode into `folder` (default: a temporary one).
    Raises ValueError; reset raises ScenarioError for changes that do not fit.

    reset(options={"scenario": ...}) runs that one instead, with its own seed. One seed, one episode, to the bit.
    """

    metadata: dict[str, Any] = {"render_modes": ["rgb_array", "rerun"], "render_fps": 20}  # noqa: RUF012

    def __init__(
        self,
        task: str = "Line",
        *,
        depth_mm: float = DEPTH_MM,
        changes: dict[str, Any] | None = None,
        look_ahead: int = 10,
        privileged: bool = False,
        render_mode: str | None = None,
        folder: str | Path | None = None,
    ) -> None:
        if task not in TASKS:
            raise ValueError(f"task = {task!r}: must be one of {', '.join(TASKS)}")
        if not 0 <= look_ahead <= 100:
            raise ValueError(f"look_ahead = {look_ahead}: must be 0 to 100 coming targets")
        if render_mode not in (None, *self.metadata["render_modes"]):
            raise ValueError(f"render_mode = {render_mode!r}: must be None, rgb_array or rerun")
        self.task, self.changes, self.privileged = task, dict(changes or {}), privileged
        self.render_mode, self.folder, self.depth_mm = render_mode, folder, depth_mm
        self.action_space = spaces.action_space()
        self.observation_space: Any = spaces.observation_space(look_ahead, privileged=privileged)
        self.refusal: str | None = None  # why the coming action cannot be executed: of a wrapper that made it
        self.rollout: Rollout | None = None  # of the last episode that ended
        self.recording: Path | None = None  # of the last episode, with render_mode = rerun
        self._plants: tuple[dict[str, Any], Insertion, Kept] | None = None
        self._episode: Episode | None = None
        self._watching: RerunObserver | None = None

    @property
    def episode(self) -> Episode:
        """What is stepped. Raises RuntimeError before the first reset."""
        if self._episode is None:
            raise RuntimeError("reset the environment first")
        return self._episode

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Seen, dict[str, Any]]:
        """A new episode: of the scenario in options, else of one that the task draws. Raises ValueError for unknown
        options, and ScenarioError."""
        super().reset(seed=seed)
        if unknown := set(options or {}) - {"scenario"}:
            raise ValueError(f"options {sorted(unknown)}: only `scenario` is known")
        given = (options or {}).get("scenario")
        scenario = self._drawn() if given is None else given if isinstance(given, Scenario) else Scenario.load(given)
        self._close_recording()
        self._episode = Episode(scenario, insertion=self._insertion(scenario))
        self.recorder = Recorder(self._episode, self._observer())
        self.record: StepRecord = self.recorder.first
        self.rollout = self.refusal = None
        return self._seen(), {"scenario": scenario.resolved()}

    def step(self, action: Any) -> tuple[Seen, float, bool, bool, dict[str, Any]]:
        """One step of the scenario's dt. terminated: the run ended by a named failure; truncated: at the end of its
        path or time. An action that is not finite is such a failure. Raises ValueError for one of another shape."""
        given = checked_action(action, (6,), self.episode)
        episode, refusal, self.refusal = self.episode, self.refusal, None
        if refusal is None and not np.isfinite(given).all():
            refusal = f"the action is {given.tolist()}, values that are not finite"
        if refusal is None or episode.done:
            self._advance(np.clip(given, -1.0, 1.0))
        else:
            episode.end(Status.CONTROLLER_FAILED, refusal)
        failed = episode.status is not Status.COMPLETED
        info: dict[str, Any] = self._end() if episode.done else {"is_success": False}
        terms = self._reward_terms(failed=failed, success=info["is_success"])
        info["reward_terms"] = terms
        return self._seen(), sum(terms.values()), failed, episode.done and not failed, info

    def _advance(self, action: NDArray[np.float64]) -> None:
        """Step, and keep a record of it. Raises EpisodeOverError after the end."""
        episode, made = self.episode, self.episode.step_number
        pose = spaces.pose_of(action, episode.state.base, episode.limits, episode.scenario.dt_s)
        seen, _ = episode.step(pose)
        if episode.step_number > made:
            self.record = self.recorder.add(pose, seen, StepTiming(episode.plant_s, 0.0, 0.0))

    def render(self) -> Any:
        """With rgb_array a picture (480, 480, 3); with rerun nothing: see `recording`."""
        if self.render_mode != "rgb_array" or self._episode is None:
            return None
        return picture(self.recorder.builder.scene, self.record)

    def close(self) -> None:
        """Close the recording. Harmless twice."""
        self._close_recording()

    def _drawn(self) -> Scenario:
        data = TASKS[self.task](self.np_random, self.depth_mm)
        data["seed"] = int(self.np_random.integers(LARGEST_SEED))
        data["name"] = self.task
        listed = [f"{path}={json.dumps(value)}" for path, value in self.changes.items()]
        return Scenario.load(with_changes({**data, "recording": {"enabled": self.render_mode == "rerun"}}, listed))

    def _insertion(self, scenario: Scenario) -> Insertion | None:
        """That of the last episode, as it was made, where the scenario has the same needle in the same tissue."""
        data = scenario.resolved()
        wanted = {name: data[name] for name in PLANT} | {"entry_mm": data["trajectory"]["entry_mm"]}
        if self._plants is None or self._plants[0] != wanted:
            made = insertion_of(scenario, keeps_tissue=False)
            self._plants = (wanted, made, made.workspace.kept())
        _, insertion, fresh = self._plants
        insertion.workspace.restore(fresh)
        return insertion

    def _observer(self) -> Observer:
        if self.render_mode != "rerun":
            return Silent()
        from service.recording.observer import RerunObserver

        if self.folder is None:
            self.folder = tempfile.mkdtemp(prefix="needlebench-gym-")
        folder = Path(self.folder)
        folder.mkdir(parents=True, exist_ok=True)
        recording_id = uuid.uuid4().hex
        self.recording = folder / f"{self.task}-{recording_id[:8]}.rrd"
        self._watching = RerunObserver(self.recording, recording_id=recording_id)
        return self._watching

    def _close_recording(self) -> None:
        if self._watching is not None:
            self._watching.close()

    def _seen(self) -> Seen:
        extra = spaces.privileged_arrays(self.episode) if self.privileged else {}
        return spaces.arrays(self.episode.observation, self.observation_space, extra)

    def _end(self) -> dict[str, Any]:
        self.rollout = rollout = self.recorder.finished()
        return {
            "is_success": rollout.success,
            "metrics": rollout.metrics,
            "status": str(rollout.status),
            "message": rollout.message,
            "digest": rollout.digest,
        }

    def _reward_terms(self, *, failed: bool, success: bool) -> dict[str, float]:
        """Dense: errors in mm and N of the true state; a failure or a success once, at the end."""
        record = self.record
        return {
            "tip": -1e3 * float(np.linalg.norm(record.tip_m - record.target_m)),
            "rcm": -RCM_WEIGHT * 1e3 * record.rcm_error_m,
            "push": -FORCE_WEIGHT * max(0.0, record.insertion_force_n),
            "failure": FAILURE if failed else 0.0,
            "success": SUCCESS if success else 0.0,
        }
