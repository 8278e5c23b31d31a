"""What becomes machine code, and when: the kernels that Python calls, with all that they call inside."""

from __future__ import annotations

import gc
from typing import TYPE_CHECKING, Any

import numba
import numba.core.event
import numpy as np
import pytest
from llvmlite.binding import Linkage
from numba.core.caching import NullCache

from simcore.compiled import kernel

if TYPE_CHECKING:
    from collections.abc import Callable

VALUES = np.array([0.1, 0.7, -1.3])


def never_kept(function: Callable[..., Any]) -> Any:
    """A kernel that is compiled in every test anew, whatever the cache of an earlier run holds."""
    made: Any = kernel(function)
    made._cache = NullCache()
    return made


def _power(value: float, exponent: int) -> float:
    if exponent < 0:
        raise ValueError("less than nothing")
    result = 1.0
    for _ in range(exponent):
        result *= value
    return result


class Kernels:
    """Two kernels, of which one calls the other."""

    def __init__(self) -> None:
        power = self.power = never_kept(_power)

        def polynomial(values: Any, least: int) -> float:
            total = 0.0
            for value in values:
                total += power(value, 2) + power(value, 3) + power(value, least)
            return total

        self.polynomial = never_kept(polynomial)


@pytest.fixture
def made() -> Kernels:
    return Kernels()


def visible(compiled: Any) -> set[str]:
    """Names of the functions in the machine code of a kernel that others could call."""
    (result,) = compiled.overloads.values()
    module = result.library._final_module
    return {f.name for f in module.functions if not f.is_declaration and f.linkage == Linkage.external}


def test_only_what_python_calls_becomes_machine_code(made: Kernels) -> None:
    expected = sum(v**2 + v**3 + v for v in VALUES)
    assert made.polynomial(VALUES, 1) == pytest.approx(expected, rel=1e-15)
    assert len(made.polynomial.signatures) == 1
    assert made.power.signatures == []
    names = visible(made.polynomial)
    assert len(names) == 2, "the kernel and what Python calls it by"
    assert all("polynomial" in name for name in names)


def test_numbers_written_out_at_a_call_need_no_code_of_their_own(made: Kernels) -> None:
    made.polynomial(VALUES, 1)
    assert len(made.power.inner.signatures) == 1


def test_a_kernel_gives_the_same_inside_another_and_called_from_python(made: Kernels) -> None:
    inside = made.polynomial(VALUES[:1], 5)
    outside = 0.0 + (made.power(VALUES[0], 2) + made.power(VALUES[0], 3) + made.power(VALUES[0], 5))
    assert inside == outside
    assert len(made.power.signatures) == 1


def test_what_a_called_kernel_raises_arrives_in_python(made: Kernels) -> None:
    with pytest.raises(ValueError, match="less than nothing"):
        made.polynomial(VALUES, -1)


def test_a_function_of_numba_itself_may_call_kernels(made: Kernels) -> None:
    polynomial = made.polynomial
    twice = numba.njit(lambda values: 2.0 * polynomial(values, 1))
    assert twice(VALUES) == 2.0 * polynomial(VALUES, 1)


def test_no_garbage_is_collected_while_a_kernel_is_compiled(made: Kernels) -> None:
    seen = []

    class Watch(numba.core.event.Listener):
        def on_start(self, event: Any) -> None:
            seen.append(gc.isenabled())

        def on_end(self, event: Any) -> None:
            seen.append(gc.isenabled())

    with numba.core.event.install_listener("numba:compile", Watch()):
        made.polynomial(VALUES, 1)
    assert seen
    assert not any(seen)
    assert gc.isenabled()
    gc.disable()
    try:
        made.power(2.0, 3)
        assert not gc.isenabled()
    finally:
        gc.enable()
