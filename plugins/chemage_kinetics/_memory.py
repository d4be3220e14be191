"""How kernels are compiled, and the two things about memory that numba itself cannot express.

Both are written as LLVM code, here and nowhere else. They read and set members of numba's array structure: ``data``,
``strides``, ``meminfo`` and ``parent``, which are the same in numba 0.59 to 0.68.
"""

from __future__ import annotations

from typing import Any, TypeAlias

import numba as nb
from llvmlite import ir
from numba.core import types
from numba.extending import intrinsic

#: Numbers in kernels: int64 and float64. To a type checker they are Any, as are the elements of arrays.
Int: TypeAlias = Any
Float: TypeAlias = Any

#: For functions that Python calls.
jit = nb.njit(cache=True, nogil=True, error_model="numpy")
_KERNELS_ONLY: Any = {"nogil": True, "error_model": "numpy", "no_cpython_wrapper": True, "no_cfunc_wrapper": True}
#: For functions that only kernels call: part of their machine code, without a wrapper for Python or a cache entry.
inner = nb.njit(**_KERNELS_ONLY)
#: For functions that a kernel runs at every event: always inlined, because an array takes up to ten machine words as
#: an argument of a call.
hot = nb.njit(forceinline=True, **_KERNELS_ONLY)


def _typed_prefetch(typingctx: Any, array: Any, row: Any) -> Any:
    """Prefetch the cache line where a row of an array starts. Does not wait; harmless outside the array."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        view = context.make_array(signature.args[0])(context, builder, args[0])
        byte, word, long = ir.IntType(8).as_pointer(), ir.IntType(32), ir.IntType(64)
        fetch = builder.module.declare_intrinsic(
            "llvm.prefetch", (byte,), ir.FunctionType(ir.VoidType(), [byte, word, word, word])
        )
        step = builder.mul(args[1], builder.extract_value(view.strides, 0))
        address = builder.add(builder.ptrtoint(view.data, long), step)
        builder.call(fetch, [builder.inttoptr(address, byte), word(0), word(3), word(1)])
        return context.get_dummy_value()

    return types.void(array, types.int64), codegen


prefetch: Any = intrinsic(_typed_prefetch)


def _without_owner(context: Any, builder: Any, kind: Any, value: Any) -> Any:
    """The value of an array without its owner; of a tuple, the tuple of such values; of anything else, itself."""
    if isinstance(kind, types.Array):
        view = context.make_array(kind)(context, builder, value)
        view.meminfo = ir.Constant(view.meminfo.type, None)
        view.parent = ir.Constant(view.parent.type, None)
        return view._getvalue()
    if isinstance(kind, types.BaseTuple):
        for at, part in enumerate(kind):  # pyright: ignore[reportArgumentType]
            inside = _without_owner(context, builder, part, builder.extract_value(value, at))
            value = builder.insert_value(value, inside, at)
    return value


def _typed_borrowed(typingctx: Any, bundle: Any) -> Any:
    """The same bundle of arrays without their owners, so that passing them about in a kernel counts no references.

    Numba counts references by atomic operations, which take more than half of the time of an event where it cannot see
    that they cancel. Only for arguments of the running function, because its caller keeps them alive.
    """

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return _without_owner(context, builder, signature.args[0], args[0])

    return bundle(bundle), codegen


borrowed: Any = intrinsic(_typed_borrowed)
