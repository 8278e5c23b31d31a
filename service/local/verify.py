"""Reruns a result from its own provenance and compares: identical, equal, or different and where."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from service.files.strict_json import without_nan
from service.files.upload_names import SCHEME, UPLOAD_ID
from simcore.arms import PLUGIN, REMOTE, Arm, arm_of
from simcore.errors import ARCHIVE_ERRORS, NeedlebenchError
from simcore.file_names import NoSuchFileError, content_in, names_mean
from simcore.provenance import provenance

if TYPE_CHECKING:
    from simcore.rollout.records import Observer
    from simcore.rollout.result import Rollout

EQUAL_MM = 1e-6  # of the tip's path: what another library or system may change in a stable run
Arrays = Mapping[str, NDArray[Any]]


class CannotVerifyError(NeedlebenchError):
    """A result that does not say how it came about, or whose controller is not here any more as it ran."""


ROUNDING = ("llvm_cpu", "llvm_features", "blas_core", "blas_version")  # the processor that code was chosen for


@dataclass(frozen=True, kw_only=True)
class Difference:
    """Where two runs part. step: the first row that differs; largest: over all rows, in the array's own unit."""

    array: str
    step: int
    before: float
    now: float
    largest: float


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """identical: to the last bit. equal: the tip's path within 1e-6 mm. changed: what is not as it was then, such as
    the commit: name -> [then, now]."""

    verdict: Literal["identical", "equal", "different"]
    digest_before: str
    digest_now: str
    status_before: str
    status_now: str
    tip_mm: float | None
    first: Difference | None
    note: str
    changed: dict[str, list[Any]]

    @property
    def reproduced(self) -> bool:
        """Identical or equal."""
        return self.verdict != "different"

    def data(self) -> dict[str, Any]:
        """As JSON data; numbers that are not finite become null."""
        return dict(without_nan(asdict(self)))


class Files:
    """What names of files in a scenario mean when it is run again: paths, and uploads that are in `folder`."""

    def __init__(self, folder: Path | None) -> None:
        self._folder = folder

    def __call__(self, name: str) -> Path:
        """The file. Raises NoSuchFileError."""
        if not name.startswith(SCHEME):
            return Path(name)
        place = "it is not known of which" if self._folder is None else f"{self._folder} does not have it"
        found = None if self._folder is None else self._folder / name.removeprefix(SCHEME)
        if found is None or not re.fullmatch(UPLOAD_ID, found.name) or not found.is_file():
            message = "is an upload of a service, and {}: give the service's data folder by --data, or verify its job"
            raise NoSuchFileError(message.format(place))
        return found


def uploads_beside(path: Path) -> Path | None:
    """The uploads of the data folder in which a result lies, as jobs/JOB/ATTEMPT/result.json; else None."""
    above = path.absolute().parents
    return above[3] / "uploads" if len(above) > 3 and above[2].name == "jobs" else None


def verify(
    result: Mapping[str, Any],
    series: Arrays | None,
    observer: Observer | None = None,
    *,
    uploads: Path | None = None,
    beside: Path | None = None,
) -> Verdict:
    """Run `result["provenance"]["scenario"]` again and compare.

    series: the arrays beside the result; without them the verdict is "identical" or "different". uploads: folder of
    those that the scenario names by their ids. beside: folder of the result; a model that is not where it was is looked
    for there and among the uploads by its content.
    Raises CannotVerifyError for what is no result and for a controller whose code or files are not those that ran,
    ScenarioError for a scenario that this version refuses.
    """
    from simcore.rollout.rollout import run
    from simcore.scenario.scenario import Scenario

    origin = origin_of(result)
    scenario = {**origin["scenario"], "recording": {"enabled": False}}  # which the digest leaves out
    folders = [folder for folder in (beside, uploads) if folder is not None]
    with names_mean(Files(uploads)), content_in(*folders):
        loaded = Scenario.load(scenario)
        check_arm(origin, arm_of(loaded.resolved()))
        return compare(result, series, run(loaded, observer))


def check_arm(origin: Mapping[str, Any], now: Arm) -> None:
    """Raises CannotVerifyError where the controller that would run is not the one that ran."""
    if now.kind == REMOTE:
        message = "steered from another process, whose code is not known here: run the scenario again beside it"
        raise CannotVerifyError(f"controller {now.controller!r} {message}")
    if "arm" not in origin or now.kind != PLUGIN:
        return
    then = Arm.of_data(origin["arm"])
    if then.code_sha256 is None:
        message = "has left no digest of its code (it was defined in no file), so nobody can say what ran"
        raise CannotVerifyError(f"controller {then.controller!r} {message}")
    if (then.version, then.code_sha256) != (now.version, now.code_sha256):
        message = f"is not the code that ran: then {then.edition}, now {now.edition or 'in no file'}"
        raise CannotVerifyError(f"controller {then.controller!r} {message}; install that one to verify the result")
    for name, sha256 in then.files.items():
        if now.files.get(name) != sha256:
            found = "there is none" if name not in now.files else f"now {now.files[name][:8]}"
            message = f"controller.settings.{name} names a file that is not the one that was read"
            raise CannotVerifyError(f"{message}: SHA-256 then {sha256[:8]}, {found}")


def origin_of(result: Mapping[str, Any]) -> Mapping[str, Any]:
    """The provenance of a result. Raises CannotVerifyError."""
    origin = result.get("provenance")
    if not isinstance(origin, Mapping) or not isinstance(origin.get("scenario"), Mapping):
        raise CannotVerifyError("this is no result: it has no provenance.scenario to run again")
    if not isinstance(result.get("digest"), str):
        raise CannotVerifyError("this is no result: it has no digest")
    return origin


def compare(result: Mapping[str, Any], series: Arrays | None, again: Rollout) -> Verdict:
    """The verdict on a run and its original."""
    identical = again.digest == result["digest"]
    first = None if identical or series is None else first_difference(series, again.series)
    tip_mm = 0.0 if identical else _tip_mm(series, again.series)
    same_end = str(result.get("status")) == str(again.status)
    equal = same_end and tip_mm is not None and tip_mm <= EQUAL_MM
    return Verdict(
        verdict="identical" if identical else "equal" if equal else "different",
        digest_before=result["digest"],
        digest_now=again.digest,
        status_before=str(result.get("status")),
        status_now=str(again.status),
        tip_mm=tip_mm,
        first=first,
        note=_note(identical, series, again.series),
        changed=changed(origin_of(result), provenance(again.scenario.resolved())),
    )


def first_difference(before: Arrays, now: Arrays) -> Difference | None:
    """The first row in which a digested array of one row a step differs, the tip's path before others of that row."""
    from simcore.rollout.digest import DIGESTED

    found = []
    for name in sorted(before.keys() & now.keys() & set(DIGESTED), key=lambda name: (name != "tip_m", name)):
        difference = _in_array(name, before[name], now[name])
        if difference is not None:
            found.append(difference)
    return min(found, key=lambda difference: difference.step, default=None)


def _in_array(name: str, before: NDArray[Any], now: NDArray[Any]) -> Difference | None:
    if before.ndim == 0 or now.ndim == 0 or before.shape[1:] != now.shape[1:]:
        return None
    rows = min(len(before), len(now))
    old, new = (array[:rows].reshape(rows, -1).astype(np.float64) for array in (before, now))
    unequal = ~((old == new) | (np.isnan(old) & np.isnan(new)))
    if not unequal.any():
        return None
    step = int(np.argmax(unequal.any(axis=1)))
    column = int(np.argmax(unequal[step]))
    values = float(old[step, column]), float(new[step, column])
    apart = np.abs(old - new)[unequal]
    largest = float(np.where(np.isnan(apart), np.inf, apart).max())
    return Difference(array=name, step=step, before=values[0], now=values[1], largest=largest)


def _tip_mm(before: Arrays | None, now: Arrays) -> float | None:
    """The largest distance between the tips of the same step, mm; None without a path of the same length."""
    if before is None or "tip_m" not in before or before["tip_m"].shape != now["tip_m"].shape:
        return None
    return 1e3 * float(np.linalg.norm(before["tip_m"] - now["tip_m"], axis=1).max())


def _note(identical: bool, before: Arrays | None, now: Arrays) -> str:
    if identical:
        return ""
    if before is None:
        return "no series.npz was found beside the result, so where the runs part is unknown"
    if "tip_m" in before and len(before["tip_m"]) != len(now["tip_m"]):
        return f"the run had {len(before['tip_m']) - 1} steps then, and has {len(now['tip_m']) - 1} now"
    return ""


def changed(before: Mapping[str, Any], now: Mapping[str, Any]) -> dict[str, list[Any]]:
    """Commit, versions and machine that are not the same: name -> [then, now]."""
    found = {}
    for name in ("commit", "platform", "cpu", "byte_order"):
        if before.get(name) != now.get(name):
            found[name] = [before.get(name), now.get(name)]
    for name in ROUNDING:
        if name in before and before[name] != now.get(name):
            found[name] = _apart(before[name], now.get(name))
    old, new = before.get("versions") or {}, now["versions"]
    for name in sorted(old.keys() | new.keys()):
        if old.get(name) != new.get(name):
            found[name] = [old.get(name), new.get(name)]
    return found


def _apart(before: Any, now: Any) -> list[Any]:
    """Of two lists of words, such as features, only those that the other has not."""
    if not (isinstance(before, str) and isinstance(now, str) and " " in before + now):
        return [before, now]
    then, since = before.split(), now.split()
    gone, new = [one for one in then if one not in since], [one for one in since if one not in then]
    return [f"with {' '.join(gone)}" if gone else "without", f"with {' '.join(new)}" if new else "without"]


def load_series(path: Path) -> dict[str, NDArray[Any]] | None:
    """The arrays of a series file, or None when there is none. Raises CannotVerifyError for one that cannot be read."""
    if not path.is_file():
        return None
    try:
        with path.open("rb") as opened, np.load(opened, allow_pickle=False) as file:
            return {name: file[name] for name in file.files}
    except ARCHIVE_ERRORS as error:
        raise CannotVerifyError(f"{path} cannot be read: {error}") from None
