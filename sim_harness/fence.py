"""A memory fence: what was written before it is seen by another thread before what follows."""

from typing import Any

from numba import types
from numba.core import config as compiler
from numba.extending import intrinsic

from sim_harness.jit import kernel

config: Any = compiler


def _fence_intrinsic(typing_context: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        builder.fence("seq_cst")
        return context.get_dummy_value()

    return types.void(), generate


_fence: Any = intrinsic(_fence_intrinsic)


def _nothing_in_interpreter() -> None:
    """The interpreter runs one thread at a time."""


if config.DISABLE_JIT:
    memory_fence: Any = _nothing_in_interpreter
else:

    @kernel
    def memory_fence() -> None:
        """Order the memory accesses on either side."""
        _fence()
