"""The sum of products in LANES partial sums: as many on every processor, however wide its registers are.

A loop of sums may not be reordered, so no compiler makes it SIMD code; here the order is that of LANES numbers side by
side, and the compiler cuts them into the registers that there are.
"""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils

from simcore.compiled import written_in_llvm

LANES = 16
_INDEX = ir.IntType(64)


def _sum_of_products(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    first, second = (
        cgutils.create_struct_proxy(kind)(context, builder, value)  # type: ignore[no-untyped-call]
        for kind, value in zip(signature.args, arguments, strict=True)
    )
    lanes = ir.VectorType(ir.FloatType(), LANES)
    sums = cgutils.alloca_once_value(builder, ir.Constant(lanes, [0.0] * LANES))  # type: ignore[no-untyped-call]
    last = builder.sub(first.nitems, ir.Constant(_INDEX, LANES - 1))
    with cgutils.for_range_slice(builder, _INDEX(0), last, _INDEX(LANES), intp=_INDEX) as (start, _):
        a, b = (
            builder.load(builder.bitcast(builder.gep(array.data, [start]), lanes.as_pointer()), align=4)
            for array in (first, second)
        )
        builder.store(builder.fadd(builder.load(sums), builder.fmul(a, b)), sums)
    return _added_lanes(builder, builder.load(sums))


def _added_lanes(builder: Any, sums: Any) -> Any:
    while sums.type.count > 1:
        half = sums.type.count // 2
        nothing, kind = ir.Constant(sums.type, ir.Undefined), ir.VectorType(ir.IntType(32), half)
        low, high = ir.Constant(kind, list(range(half))), ir.Constant(kind, list(range(half, 2 * half)))
        sums = builder.fadd(builder.shuffle_vector(sums, nothing, low), builder.shuffle_vector(sums, nothing, high))
    return builder.extract_element(sums, ir.IntType(32)(0))


def _lane_dot(_context: Any, a: Any, b: Any) -> Any:
    """Inside kernels: a . b of two arrays (n,) of single precision, n a multiple of LANES.

    Lane k sums the products k, k + LANES, ... one after the other; then the lanes' halves are added until one is left.
    """
    if not (a == b == types.Array(types.float32, 1, "C")):
        return None
    return types.float32(a, b), _sum_of_products


lane_dot = written_in_llvm(_lane_dot)
