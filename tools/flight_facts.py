"""What a recording says of its flight: manifest, modes, events, extremes, completeness."""

import re
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from flight_sw.errors import RecordingError
from flight_sw.guidance import LAWS
from sim_harness.telemetry.events import MODE, changes
from sim_harness.telemetry.reader import DBC_SUFFIX, Recording
from sim_harness.telemetry.wire import groups_of

CHANGES_MAX = 10_000  # of the mode that are told


class Extreme(NamedTuple):
    """A quantity of the truth whose largest or smallest value is told."""

    title: str
    name: str
    is_largest: bool
    running: str = ""
    """The field that holds the largest at any minor frame, not only at the samples."""


EXTREMES = (
    Extreme("peak heat flux", "heat_flux_wpm2", True, "heat_flux_max_wpm2"),
    Extreme("peak load factor", "load_factor_g", True, "load_factor_max_g"),
    Extreme("peak dynamic pressure", "dynamic_pressure_pa", True, "dynamic_pressure_max_pa"),
    Extreme("peak drag", "drag_mps2", True),
    Extreme("highest altitude", "alt_m", True),
    Extreme("lowest altitude", "alt_m", False),
    Extreme("highest speed", "v_rel_mps", True),
    Extreme("lowest speed", "v_rel_mps", False),
    Extreme("heat load", "heat_load_jpm2", True),
    Extreme("ground range", "ground_range_m", True),
)


def law_of(manifest: Mapping[str, str]) -> Any:
    """This version's law of the name that was flown; None where there is none."""
    return LAWS.get(manifest.get("law", ""))


def phases_of(manifest: Mapping[str, str]) -> dict[int, str]:
    """The names of the law's phases, of this version's law of that name."""
    return dict(enumerate(getattr(law_of(manifest), "PHASES", ())))


def named(text: str, phases: Mapping[int, str]) -> str:
    """An event of the guidance phase with the phases' names, which the bus does not carry."""
    if not text.startswith("guidance phase "):
        return text
    return re.sub(r"\d+", lambda found: phases.get(int(found[0]), found[0]), text)


def modes(recording: Recording) -> list[dict[str, Any]]:
    """The modes of the flight computer and since when, from its own reports."""
    message, signal = MODE
    try:
        t_s, columns = recording.message(message)
    except RecordingError:
        return []
    if signal not in columns or not len(t_s):
        return []
    values = columns[signal].astype(np.int64)
    names = recording.value_names(message)[signal]
    return [
        {"t_s": float(t_s[i]), "mode": names.get(int(values[i]), str(values[i]))}
        for i in changes(values)[:CHANGES_MAX].tolist()
    ]


def extremes(recording: Recording) -> list[dict[str, Any]]:
    """Largest and smallest values of the truth, and when they were sampled."""
    truth = recording.truth
    found = []
    for extreme in EXTREMES:
        if not len(truth) or extreme.name not in (truth.dtype.names or ()):
            continue
        column = truth[extreme.name]
        place = int(column.argmax() if extreme.is_largest else column.argmin())
        value = float(column[place])
        if extreme.running in (truth.dtype.names or ()):
            value = max(value, float(truth[extreme.running].max()))
        t_s = float(truth["t_s"][place])
        found.append({"title": extreme.title, "name": extreme.name, "value": value, "t_s": t_s})
    return found


def facts(recording: Recording) -> dict[str, Any]:
    """The object that `aeroshell info --json` prints."""
    has_dbc = sum(name.endswith(DBC_SUFFIX) for name in recording.attachments) == 1
    phases = phases_of(recording.manifest)
    return {
        "path": str(recording.path),
        "bytes": recording.path.stat().st_size,
        "is_complete": recording.is_complete,
        "damage": recording.damage or None,
        "until_s": recording.until_s,
        "from_journal_s": recording.from_journal_s,
        "manifest": dict(recording.manifest),
        "outcome": dict(recording.outcome),
        "frames": len(recording.bus),
        "minor_frames": len(groups_of(recording.bus["t_s"])),
        "missing_minor_frames": recording.missing_minor_frames,
        "frames_not_decoded": None if recording.dbc_failure else recording.frames_not_decoded,
        "truth_rows": len(recording.truth),
        "attachments": {name: len(data) for name, data in recording.attachments.items()},
        "is_of_this_dbc": recording.has_our_dbc if has_dbc else None,
        "dbc_failure": recording.dbc_failure or None,
        "modes": modes(recording),
        "events": [
            {"t_s": line.t_s, "level": line.level.name, "text": named(line.text, phases)}
            for line in sorted(recording.log, key=lambda line: line.t_s)
        ],
        "extremes": extremes(recording),
    }
