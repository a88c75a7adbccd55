"""Campaigns: processor time a flight over real time, and what a second thread brings.

Processor time is compared, not the clock: it means the same on a machine that is shared.
"""

from pathlib import Path
from typing import Any

import pytest

from tools.campaign.engine import run_campaign
from tools.campaign.plan import Wanted

FLIGHTS = 40
WANTED = Wanted("hyperion-1", "sensitivity", FLIGHTS, 1, "integrated")


def processor_s(folder: Path, jobs: int) -> float:
    """Processor time a flight."""
    campaign = run_campaign(WANTED, folder, jobs)
    return float(campaign.manifest["flown"]["cpu_s"]) / FLIGHTS


def test_campaign(tmp_path: Path, benchmark: Any) -> None:
    run_campaign(WANTED._replace(n=1), tmp_path / "warm", 1)
    alone_s = processor_s(tmp_path / "one", 1)
    beside_s = benchmark.pedantic(lambda: processor_s(tmp_path / "two", 2), rounds=1)
    share = alone_s / beside_s
    benchmark.extra_info |= {"processor_s": beside_s, "linear": share}
    print(
        f"\ncampaign: {beside_s * 1e3:.0f} ms of processor time a flight, two at a time; "
        f"scaling {share:.2f} of linear"
    )
    assert share == pytest.approx(1.0, abs=0.5)
