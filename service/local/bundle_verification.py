"""Some cases of a bundle run again, out of the bundle alone."""

from __future__ import annotations

import tempfile
from contextlib import ExitStack, nullcontext
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

from benchmarks.bundles.canonical import BundleError
from benchmarks.bundles.cases_text import CaseRecord, ids_of, origin_of
from benchmarks.bundles.choice import chosen_cases
from benchmarks.bundles.manifest import FILES, SERIES, Origin
from benchmarks.bundles.series_file import read_series
from benchmarks.bundles.verification import CaseVerification, Verification, measure_apart
from service.local.bundle_source import files_laid_out, running_source
from service.local.verify import CannotVerifyError, Verdict, changed, check_arm, compare
from simcore import plugins
from simcore.arms import PLUGIN, REMOTE, arm_of
from simcore.errors import NeedlebenchError
from simcore.file_names import NoSuchFileError, content_in, names_mean
from simcore.provenance import machine

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from contextlib import AbstractContextManager
    from typing import Any

    from benchmarks.bundles.check import Bundle
    from benchmarks.bundles.manifest import ArmRecord
    from simcore.rollout.result import Rollout


def verify_bundle(
    bundle: Bundle, *, count: int, seed: int, by: str | None, run_code: bool, say: Callable[[CaseVerification], None]
) -> Verification:
    """Run `count` cases, chosen by the seed, again. by: who verifies. run_code: whether code of plug-ins may be taken
    from the bundle and executed. say: hears of each case."""
    records = {record.id: record for record in bundle.records}
    found = list[CaseVerification]()
    with tempfile.TemporaryDirectory(prefix="needlebench-") as name:
        rerun = _Rerun(bundle, Path(name), run_code)
        for case_id in chosen_cases(ids_of(bundle.records), count, seed):
            found.append(rerun.case(records[case_id]))
            say(found[-1])
    here = origin_of({"provenance": machine()})
    return Verification(
        schema="needlebench/verification/1",
        bundle=bundle.id,
        suite=bundle.manifest.suite.name,
        at=datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ"),
        by=by,
        seed=seed,
        code=Origin(cases=len(found), **here),
        cases=found,
    )


def changes_since(bundle: Bundle) -> Iterator[tuple[int, str, Any, Any]]:
    """(cases, what, then, now) for everything that is not as it was when the cases were run."""
    now = machine()
    for origin in bundle.manifest.origins:
        for name, (then, since) in changed(origin.model_dump(exclude={"cases"}), now).items():
            yield origin.cases, name, then, since


class _Rerun:
    """Cases run again in this process. folder: where files of the bundle are unpacked."""

    def __init__(self, bundle: Bundle, folder: Path, run_code: bool) -> None:
        self.bundle, self.folder, self.run_code = bundle, folder, run_code
        self.names = {one.name: folder / one.entry for one in bundle.manifest.named_files}
        for file in bundle.manifest.files:
            if file.name.startswith(f"{FILES}/"):
                bundle.archive.extract(file.name, folder / file.name)

    def file(self, name: str) -> Path:
        """What a name in a scenario means. Raises NoSuchFileError: nothing outside of the bundle is read."""
        if name not in self.names:
            raise NoSuchFileError("names a file that the bundle does not hold")
        return self.names[name]

    def case(self, record: CaseRecord) -> CaseVerification:
        """The verdict on one case."""
        reason = self._hindrance(record)
        if reason:
            return CaseVerification(id=record.id, result="not run", where=reason)
        outcome = record.outcome(self.bundle.manifest)
        try:
            again = self._run(record, outcome.result["provenance"])
        except (CannotVerifyError, BundleError) as error:
            return CaseVerification(id=record.id, result="not run", where=str(error))
        except NeedlebenchError as error:
            return CaseVerification(id=record.id, result="different", where=f"cannot be run: {error}"[:2000])
        name = f"{SERIES}/{record.id}.npz"
        series = read_series(self.bundle.archive, name) if self.bundle.manifest.has(name) else None
        verdict = compare(outcome.result, series, again)
        apart = measure_apart(outcome.result["metrics"], again.metrics)
        return _judged(record.id, verdict, apart, with_series=series is not None)

    def _hindrance(self, record: CaseRecord) -> str:
        """Why a case is not run; empty if it is."""
        arm = self.bundle.arm(record.arm)
        if not isinstance(record.result.get("digest"), str) or arm is None:
            return f"it left no result to compare with: {record.result.get('status')}"
        if arm.kind == REMOTE:
            return "it was steered from another process, whose code is not in the bundle (open division)"
        if arm.kind == PLUGIN and not self.run_code and not _is_installed(arm):
            return (
                f"controller {arm.controller!r} is not installed here with the code that ran; --run-plugin-code "
                "executes the code in the bundle"
            )
        return ""

    def _run(self, record: CaseRecord, origin: dict[str, Any]) -> Rollout:
        from simcore.rollout.rollout import run
        from simcore.scenario.scenario import Scenario

        with ExitStack() as stack:
            stack.enter_context(names_mean(self.file))
            stack.enter_context(content_in(self.folder / FILES))
            if record.scenario["controller"]["kind"] == PLUGIN:
                stack.enter_context(files_laid_out(self.names))
            stack.enter_context(self._controller(record))
            scenario = Scenario.load({**record.scenario, "recording": {"enabled": False}})
            check_arm(origin, arm_of(scenario.resolved()))
            return run(scenario)

    def _controller(self, record: CaseRecord) -> AbstractContextManager[None]:
        arm = self.bundle.arm(record.arm)
        if arm is None or arm.kind != PLUGIN or _is_installed(arm):
            return nullcontext()
        return running_source(self.bundle, arm, self.folder)


def _is_installed(arm: ArmRecord) -> bool:
    """Whether the very code of a plug-in is installed here."""
    try:
        code = plugins.code_of(arm.controller)
    except (LookupError, OSError):
        return False
    return (code.version, code.sha256) == (arm.version, arm.code_sha256)


def _judged(case_id: str, verdict: Verdict, apart: str, *, with_series: bool) -> CaseVerification:
    """States and measures together. Without a series, measures alone can say that another digest is equal."""
    same_end = verdict.status_before == verdict.status_now
    result, where = verdict.verdict, apart
    if apart:
        result = "different"
    elif not with_series and same_end:
        result, where = ("equal", "by its measures; the bundle has no series of it") if result != "identical" else (
            result, "",
        )  # fmt: skip
    if not same_end:
        where = f"status: {verdict.status_before} then, {verdict.status_now} now"
    elif verdict.first is not None and result == "different":
        first = verdict.first
        where = f"step {first.step}, {first.array}: {first.before:.17g} then, {first.now:.17g} now" + (
            f"; {apart}" if apart else ""
        )
    return CaseVerification(id=case_id, result=result, where=where, tip_mm=verdict.tip_mm)
