"""The pass of `make test-processor` computes otherwise than this processor does."""

import os
import platform
import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.rules.sources import ROOT

MAKEFILE = (ROOT / "Makefile").read_text(encoding="utf-8")
OTHER = dict(
    setting.split("=", maxsplit=1)
    for setting in re.findall(r"^OTHER_PROCESSOR := (.*)$", MAKEFILE, re.MULTILINE)[0].split()
)
FINGERPRINT = """
import hashlib, math, random
import numpy as np
chosen = random.Random(1)
values = [chosen.uniform(0.1, 0.9) for _ in range(20_000)]
for function in (math.sin, math.cos, math.exp, math.log, lambda x: (9.0 * x) ** 2.7):
    print(hashlib.sha256(np.array([function(x) for x in values])).hexdigest())
matrix = np.array(values[:10_000]).reshape(100, 100)
print(hashlib.sha256(np.linalg.solve(matrix, matrix @ matrix)).hexdigest())
"""
MATHEMATICS = 5  # lines before that of linear algebra


def fingerprint(**settings: str) -> list[str]:
    """Hashes of what the C library and linear algebra compute under these settings."""
    kept = {key: value for key, value in os.environ.items() if key not in OTHER}
    done = subprocess.run(
        [sys.executable, "-c", FINGERPRINT], env={**kept, **settings},
        capture_output=True, text=True, check=True, timeout=100,
    )  # fmt: skip
    return done.stdout.split()


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="the settings are glibc's")
@pytest.mark.skipif(
    " fma " not in Path("/proc/cpuinfo").read_text(), reason="a processor that has no FMA to leave"
)
def test_the_other_processor_is_another() -> None:
    assert set(OTHER) == {"GLIBC_TUNABLES", "OPENBLAS_CORETYPE"}
    here, there = fingerprint(), fingerprint(**OTHER)
    assert all(a != b for a, b in zip(here[:MATHEMATICS], there[:MATHEMATICS], strict=True))
    assert here[MATHEMATICS:] != there[MATHEMATICS:]
    assert fingerprint(**OTHER) == there
