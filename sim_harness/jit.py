"""The harness's kernel decorator: flight_sw's flags, a cache that also depends on the harness."""

from pathlib import Path

from flight_sw.runtime.jit import FLIGHT_ROOT, kernel_decorator

kernel = kernel_decorator(FLIGHT_ROOT, Path(__file__).parent)
