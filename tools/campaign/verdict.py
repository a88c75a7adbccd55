"""A finished campaign judged: counts of the outcome classes, and every requirement's verdict."""

import json
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from flight_sw.errors import MissionError
from sim_harness.flight.outcomes import CLASSES, NOT_FLOWN
from sim_harness.mission.dispersion_keys import Requirement
from sim_harness.mission.errors import nearest
from sim_harness.mission.requirements import MET, Verdict, as_dict, judge
from tools.campaign.columns import TEXTS, numbers
from tools.campaign.folder import VERDICT, read_results
from tools.gains.image import write_atomically


def check_metrics(requirements: Sequence[Requirement], row: Mapping[str, Any]) -> None:
    """Refuse a requirement on what no flight tells, as soon as one has been flown."""
    numbers = [k for k, v in row.items() if not isinstance(v, str)]
    for i, requirement in enumerate(requirements, start=1):
        if requirement.metric not in numbers:
            raise MissionError(
                f"requirements {i}.metric is {requirement.metric}"
                f"{nearest(requirement.metric, numbers)}; allowed {', '.join(numbers)}"
            )


def judged(
    folder: Path, manifest: Mapping[str, Any], requirements: Sequence[Requirement]
) -> dict[str, Any]:
    """The verdict on a campaign's folder; written to verdict.json."""
    results = read_results(folder, dict(manifest))
    classes = np.array(results["outcome_class"].to_pylist())
    untold = np.isin(classes, NOT_FLOWN)
    verdicts: list[Verdict] = []
    for requirement in requirements:
        values = np.full(len(classes), np.nan)  # no flight was flown to where it is told
        if requirement.metric in results.column_names and requirement.metric not in TEXTS:
            values = numbers(results, requirement.metric)
        verdicts.append(judge(requirement, np.where(untold, np.nan, values)))
    counted = Counter(classes.tolist())
    told = {
        "outcome_classes": {name: counted.get(name, 0) for name in CLASSES},
        "requirements": [as_dict(verdict) for verdict in verdicts],
        "all_met": all(verdict.verdict == MET for verdict in verdicts),
    }
    write_atomically(folder / VERDICT, (json.dumps(told, indent=1) + "\n").encode())
    return told
