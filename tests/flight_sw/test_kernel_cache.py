"""Processes that save kernels at the same time do not mix them up."""

import subprocess
import sys
import time
from pathlib import Path

import pytest
from numba.core.caching import IndexDataCacheFile

SAVERS = 4
KEYS = 40
START_S = 3.0  # all savers are up by then and begin together

SAVE = """
import sys, time
from numba.core.caching import IndexDataCacheFile
from flight_sw import kernel_cache
folder, saver, start, keys = sys.argv[1:]
kernel_cache.serialise_saves()
file = IndexDataCacheFile(folder, "kernel", 0)
time.sleep(max(0.0, float(start) - time.time()))
for i in range(int(keys)):
    file.save((saver, i), (saver, i))
"""


@pytest.mark.jit_only
def test_every_key_gives_back_what_was_saved_under_it(tmp_path: Path, repo_root: Path) -> None:
    start = str(time.time() + START_S)
    command = [sys.executable, "-c", SAVE, str(tmp_path)]
    savers = [
        subprocess.Popen([*command, str(saver), start, str(KEYS)], cwd=repo_root)
        for saver in range(SAVERS)
    ]
    assert [process.wait(timeout=60) for process in savers] == [0] * SAVERS
    keys = [(str(saver), i) for saver in range(SAVERS) for i in range(KEYS)]
    file = IndexDataCacheFile(str(tmp_path), "kernel", 0)
    assert [file.load(key) for key in keys] == keys
