"""The C library's calls that the flight computer makes itself, callable from kernels.

They are declared by name, never by address, so that a kernel which makes them can be cached. In an
uncompiled run the same names are bound through ctypes.

Limits: Linux on a 64-bit processor.
"""

import ctypes
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils as llvm_tools
from numba.core import config as compiler
from numba.extending import intrinsic

from flight_sw.runtime.jit import kernel

cgutils: Any = llvm_tools  # neither has type annotations
config: Any = compiler

CLOCK_MONOTONIC = 1
TIMER_ABSTIME = 1
NS_PER_S = 1_000_000_000
MSG_DONTWAIT = 0x40
MSG_NOSIGNAL = 0x4000
MSG_TRUNC = 0x20
POLLIN, POLLOUT, POLLERR, POLLHUP, POLLNVAL, POLLRDHUP = 0x1, 0x4, 0x8, 0x10, 0x20, 0x2000

IOVEC = np.dtype([("base", "u8"), ("size", "u8")], align=True)
MMSGHDR = np.dtype(
    [
        ("name", "u8"),
        ("name_size", "u4"),
        ("iov", "u8"),
        ("iov_count", "u8"),
        ("control", "u8"),
        ("control_size", "u8"),
        ("flags", "i4"),
        ("pad", "i4"),
        ("size", "u4"),  # msg_len in C: bytes moved
    ],
    align=True,
)
"""struct mmsghdr, 64 bytes."""
POLLFD = np.dtype([("fd", "i4"), ("events", "i2"), ("revents", "i2")], align=True)

LLVM_I32, LLVM_I64 = ir.IntType(32), ir.IntType(64)
LLVM_TIMESPEC = ir.LiteralStructType([LLVM_I64, LLVM_I64])


def c_function(name: str, result: Any, *arguments: Any) -> Callable[..., int]:
    """A function of the C library under its name; addresses are passed as integers."""
    if not config.DISABLE_JIT:
        return types.ExternalFunction(name, result(*arguments))
    function = getattr(ctypes.CDLL(None, use_errno=True), name)
    function.restype = getattr(ctypes, f"c_{result.name}")
    kinds = {"uint64": ctypes.c_uint64, "int32": ctypes.c_int32, "uint32": ctypes.c_uint32}
    function.argtypes = [kinds[argument.name] for argument in arguments]
    return function


poll = c_function("poll", types.int32, types.uint64, types.uint64, types.int32)
recvmmsg = c_function(
    "recvmmsg", types.int32, types.int32, types.uint64, types.uint32, types.int32, types.uint64
)
sendmmsg = c_function("sendmmsg", types.int32, types.int32, types.uint64, types.uint32, types.int32)
sched_yield = c_function("sched_yield", types.int32)


def _errno_intrinsic(typing_context: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        kind = ir.FunctionType(LLVM_I32.as_pointer(), [])
        location = cgutils.get_or_insert_function(builder.module, kind, "__errno_location")
        return builder.load(builder.call(location, []))

    return types.int32(), generate


def _monotonic_ns_intrinsic(typing_context: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        kind = ir.FunctionType(LLVM_I32, [LLVM_I32, LLVM_TIMESPEC.as_pointer()])
        function = cgutils.get_or_insert_function(builder.module, kind, "clock_gettime")
        now = cgutils.alloca_once(builder, LLVM_TIMESPEC)
        builder.call(function, [LLVM_I32(CLOCK_MONOTONIC), now])
        seconds = builder.load(cgutils.gep_inbounds(builder, now, 0, 0))
        nanoseconds = builder.load(cgutils.gep_inbounds(builder, now, 0, 1))
        return builder.add(builder.mul(seconds, LLVM_I64(NS_PER_S)), nanoseconds)

    return types.int64(), generate


def _sleep_until_ns_intrinsic(typing_context: Any, deadline_ns: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        pointer = LLVM_TIMESPEC.as_pointer()
        kind = ir.FunctionType(LLVM_I32, [LLVM_I32, LLVM_I32, pointer, pointer])
        function = cgutils.get_or_insert_function(builder.module, kind, "clock_nanosleep")
        until = cgutils.alloca_once(builder, LLVM_TIMESPEC)
        per_s = LLVM_I64(NS_PER_S)
        builder.store(builder.sdiv(arguments[0], per_s), cgutils.gep_inbounds(builder, until, 0, 0))
        builder.store(builder.srem(arguments[0], per_s), cgutils.gep_inbounds(builder, until, 0, 1))
        flags = LLVM_I32(TIMER_ABSTIME)
        return builder.call(
            function, [LLVM_I32(CLOCK_MONOTONIC), flags, until, ir.Constant(pointer, None)]
        )

    return types.int32(types.int64), generate


_errno: Any = intrinsic(_errno_intrinsic)
_monotonic_ns: Any = intrinsic(_monotonic_ns_intrinsic)
_sleep_until_ns: Any = intrinsic(_sleep_until_ns_intrinsic)


def _sleep_in_interpreter(deadline_ns: int) -> int:
    time.sleep(max(0, deadline_ns - time.monotonic_ns()) / NS_PER_S)
    return 0


if config.DISABLE_JIT:
    last_errno: Any = ctypes.get_errno
    monotonic_ns: Any = time.monotonic_ns
    sleep_until_ns: Any = _sleep_in_interpreter
else:

    @kernel
    def last_errno() -> int:
        """Why the last call into the C library failed."""
        return _errno()

    @kernel
    def monotonic_ns() -> int:
        """The monotonic clock."""
        return _monotonic_ns()

    @kernel
    def sleep_until_ns(deadline_ns: int) -> int:
        """Sleep until the monotonic clock shows `deadline_ns`; not 0 if a signal ended it."""
        return _sleep_until_ns(deadline_ns)
