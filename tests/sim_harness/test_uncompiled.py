"""The kernels give the same bits without the compiler."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from sim_harness.world.records import TRUTH
from tests.sim_harness.hashed_flights import MISSIONS, flight_bytes, report_bytes

ROOT = Path(__file__).parents[2]


@pytest.mark.jit_only
def test_uncompiled_flights_give_the_same_bits():
    done = subprocess.run(
        [sys.executable, "-m", "tests.sim_harness.hashed_flights"],
        cwd=ROOT,
        env=os.environ | {"NUMBA_DISABLE_JIT": "1"},
        capture_output=True,
        text=True,
        check=True,
        timeout=120,
    )
    *lines, reports = done.stdout.splitlines()
    assert reports == report_bytes()
    for line, (name, changes) in zip(lines, MISSIONS.items(), strict=True):
        compiled = np.frombuffer(bytes.fromhex(flight_bytes(changes)), TRUTH)[0]
        uncompiled = np.frombuffer(bytes.fromhex(line), TRUTH)[0]
        for field in TRUTH.names:
            assert compiled[field] == uncompiled[field], f"{name}: {field}"
        assert compiled.tobytes() == uncompiled.tobytes(), name
