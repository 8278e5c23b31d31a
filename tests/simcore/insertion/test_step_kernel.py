"""The step as one kernel, and composed of its kernels by Python: the same bits at every step."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pytest

from simcore.insertion import step_kernel
from simcore.rollout.rollout import compile_kernels, run
from tests.simcore.rollout.test_reproducibility import KINDS, OTHERS

if TYPE_CHECKING:
    from collections.abc import Callable

SHORT = {"tissue frame", "dynamic", "failing", "push, pull, push", "linearised", "hard", "breathing", "exact Jacobian"}
CASES = {name: data for name, data in (KINDS | OTHERS).items() if name in SHORT}


def counted(calls: list[str], name: str, function: Callable[..., Any]) -> Callable[..., Any]:
    def called(*arguments: Any) -> Any:
        calls.append(name)
        return function(*arguments)

    return called


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_compiled_and_composed_steps_have_the_same_digest(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    compile_kernels()
    compiled, calls = run(CASES[name]), list[str]()
    for part in step_kernel.COMPOSED:
        plain = getattr(step_kernel, part).py_func
        monkeypatch.setattr(step_kernel, part, counted(calls, part, plain))
    composed = run(CASES[name])
    assert composed.digest == compiled.digest
    assert composed.message == compiled.message
    assert calls.count("evaluate") >= calls.count("correct") >= len(compiled.series["t_s"]) - 1
    assert ("iterate" in calls) == (name != "linearised")
