"""A table or image that a full disk cuts short is told with its name, and leaves nothing behind."""

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
LIMIT_BYTES = 20_000

# A limit on the size of files ends a write as a full disk does, in another word.
FILLER = f"""
import resource, sys
from pathlib import Path
import numpy as np
import pyarrow as pa
from flight_sw.runtime.program import run
from tools.campaign.columns import write_table
from tools.gains.image import write_atomically

def table(path):
    write_table(pa.table({{"a": np.random.default_rng(1).random(50_000)}}), path)

def image(path):
    write_atomically(path, bytes(100_000))

resource.setrlimit(resource.RLIMIT_FSIZE, ({LIMIT_BYTES}, {LIMIT_BYTES}))
path = Path(sys.argv[2])
sys.exit(run("aeroshell", lambda: {{"table": table, "image": image}}[sys.argv[1]](path) or 0))
"""


@pytest.mark.parametrize("before", [None, b"what was there"], ids=["new", "there"])
@pytest.mark.parametrize("what", ["table", "image"])
def test_a_full_disk_is_one_sentence_that_names_the_file(
    tmp_path: Path, what: str, before: bytes | None
) -> None:
    path = tmp_path / "a.out"
    if before is not None:
        path.write_bytes(before)
    ended = subprocess.run(
        [sys.executable, "-c", FILLER, what, str(path)],
        capture_output=True,
        text=True,
        cwd=ROOT,
        timeout=60.0,
        check=False,
    )
    assert (ended.returncode, ended.stdout) == (1, "")
    assert ended.stderr == f"aeroshell: {path}: File too large\n"
    kept = {found.name: found.read_bytes() for found in tmp_path.iterdir()}
    assert kept == ({} if before is None else {"a.out": before})
