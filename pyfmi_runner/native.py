"""Calls of an FMU's C functions by address from numba-compiled code: no Python between the loop and
the FMU.
"""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba import types
from numba.extending import intrinsic as numba_intrinsic

__all__ = ["call_step", "call_step_3", "call_values", "call_values_3"]

# numba types what it decorates as the code generator below, with its typing context: what a caller
# sees is another function
intrinsic: Any = numba_intrinsic
_POINTER = ir.IntType(8).as_pointer()


def _call(builder: Any, address: Any, arguments: list[Any]) -> Any:
    """int (*)(...) at `address`, an integer."""
    kind = ir.FunctionType(ir.IntType(32), [a.type for a in arguments])
    return builder.call(builder.inttoptr(address, kind.as_pointer()), arguments)


@intrinsic
def call_values(
    typingctx: Any, function: Any, component: Any, references: Any, count: Any, values: Any
) -> Any:
    """fmi2SetReal, fmi2GetReal, fmi2SetBoolean: status = f(component, references, count, values);
    pointers as integers.
    """
    signature = types.int32(types.uintp, types.uintp, types.uintp, types.uintp, types.uintp)

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        f, c, r, n, v = args
        return _call(
            builder,
            f,
            [
                builder.inttoptr(c, _POINTER),
                builder.inttoptr(r, _POINTER),
                n,
                builder.inttoptr(v, _POINTER),
            ],
        )

    return signature, generate


@intrinsic
def call_values_3(
    typingctx: Any, function: Any, component: Any, references: Any, count: Any, values: Any
) -> Any:
    """fmi3SetFloat64, fmi3GetFloat64 and the like: status = f(component, references, count, values,
    count), of scalars; pointers as integers.
    """
    signature = types.int32(types.uintp, types.uintp, types.uintp, types.uintp, types.uintp)

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        f, c, r, n, v = args
        pointers = [builder.inttoptr(a, _POINTER) for a in (c, r, v)]
        return _call(builder, f, [pointers[0], pointers[1], n, pointers[2], n])

    return signature, generate


@intrinsic
def call_step_3(
    typingctx: Any, function: Any, component: Any, time: Any, step: Any, flags: Any
) -> Any:
    """fmi3DoStep: status = f(component, time, step, true, flags, flags + 1, flags + 2, flags + 8).
    flags: address of 16 bytes: event needed, terminate, early return; at 8 the last time [s].
    """
    signature = types.int32(types.uintp, types.uintp, types.float64, types.float64, types.uintp)

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        f, c, time, step, flags = args
        said = [
            builder.inttoptr(builder.add(flags, ir.Constant(flags.type, at)), _POINTER)
            for at in (0, 1, 2, 8)
        ]
        yes = ir.Constant(ir.IntType(32), 1)
        return _call(builder, f, [builder.inttoptr(c, _POINTER), time, step, yes, *said])

    return signature, generate


@intrinsic
def call_step(typingctx: Any, function: Any, component: Any, time: Any, step: Any) -> Any:
    """fmi2DoStep: status = f(component, time, step, fmi2True)."""
    signature = types.int32(types.uintp, types.uintp, types.float64, types.float64)

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        f, c, time, step = args
        return _call(
            builder, f, [builder.inttoptr(c, _POINTER), time, step, ir.Constant(ir.IntType(32), 1)]
        )

    return signature, generate
