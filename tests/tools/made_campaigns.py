"""Campaigns made without a flight, their results in closed form: what a report of them must say."""

import json
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from sim_harness.mission.documents import read_toml
from sim_harness.mission.mission import find
from tools.campaign.plan import encoded
from tools.campaign.profiles import FIELDS, Spool

SPEEDS = np.linspace(2400.0, 7900.0, 128)
MASS, GAMMA = "vehicle.mass_kg", "entry.flight_path_angle_deg"
BOUND, BOTH = 1.05, 1.06
REQUIREMENTS = [
    {"metric": "heat_flux_max_ratio", "max": BOUND, "min": None, "probability": 0.9,
     "confidence": 0.9, "title": "flux within 5 %"},
    {"metric": "ground_range_km", "max": None, "min": 5000.0, "probability": 0.99865,
     "confidence": 0.9, "title": "range of 5,000 km"},
]  # fmt: skip


def samples(n: int, seed: int) -> pa.Table:
    """Mass and entry angle, evenly spread and in no order."""
    random = np.random.default_rng(seed)
    return pa.table({
        "run": np.arange(1, n + 1),
        "seed": random.integers(0, 1 << 32, n),
        MASS: 430.0 + 40.0 * (random.permutation(n) + 0.5) / n,
        GAMMA: -3.0 + 0.2 * (random.permutation(n) + 0.5) / n,
    })  # fmt: skip


def rows(drawn: pa.Table, shift: float) -> list[dict]:
    """Results that follow from the samples; `shift` tells laws apart."""
    found = []
    for sample in drawn.to_pylist():
        mass, gamma = (sample[MASS] - 450.0) / 20.0, (sample[GAMMA] + 2.9) / 0.1
        flux = 1.0 + 0.04 * gamma + 0.03 * mass + 0.01 * shift
        found.append({
            "run": sample["run"], "mission": "hyperion-1", "seed": sample["seed"],
            "outcome": "end condition",
            "heat_load_mjpm2": 1250.0 + 60.0 * mass - 20.0 * shift,
            "ground_range_km": 5700.0 + 300.0 * gamma,
            "heat_flux_max_ratio": flux,
            "load_factor_max_g": 4.3 + 0.1 * mass * mass,
            "bank_reversals": 3 + int(mass > 0.0),
            "frames_rejected": 0,
            "command_sha256": f"{sample['run']:064x}",
            "outcome_class": "limit exceeded" if flux > BOUND else "nominal",
            "limits_exceeded": "heat flux, load factor" if flux > BOTH
            else "heat flux" if flux > BOUND else "",
        })  # fmt: skip
    return found


def manifest(drawn: pa.Table, law: str, seed: int) -> dict:
    """campaign.json of it."""
    return {
        "identity": {
            "mission": "hyperion-1", "mission_hash": "0", "law": law, "load_crc32": "0x12345678",
            "design_hash": "0", "dispersions": "made", "n": len(drawn), "seed": seed,
            "samples_hash": f"{seed:016x}", "sources_hash": "0123456789abcdef",
        },
        "state": "done",
        "title": "A campaign <made> & judged",
        "command": f"aeroshell campaign hyperion-1 --law {law}",
        "version": "0.1.0",
        "requirements": REQUIREMENTS,
        "told_to_both": [],
        "fixed": {"end.speed_mps": "2400", "design.lqy.lead_s": 12.5},
        "job": encoded({
            "mission_tree": read_toml(find("hyperion-1")), "told_tree": {}, "design_tree": {},
            "mission_file": "hyperion-1.toml", "law": law, "load_file": f"{law}.load",
        }),
    }  # fmt: skip


def profile(mass_kg: float) -> bytes:
    """A flight's profile: a drag that grows as the speed falls, heavier ones less."""
    found = np.ones((len(FIELDS), len(SPEEDS)), np.float32)
    drag = 4.0 * (7900.0 / SPEEDS) ** 2 * 450.0 / mass_kg
    for name, values in (
        ("drag_mps2", drag), ("lift_mps2", 0.4 * drag), ("dynamic_pressure_pa", 400.0 * drag),
        ("load_factor_g", drag / 9.81), ("heat_flux_wpm2", 1.7e6 * (SPEEDS / 7900.0) ** 2),
        ("alt_m", 30e3 + 6.0 * SPEEDS),
    ):  # fmt: skip
        found[FIELDS.index(name)] = values
    return found.tobytes()


def make(folder: Path, n: int, law: str = "lqy", seed: int = 1, shift: float = 0.0) -> Path:
    """A finished campaign in a new folder."""
    folder.mkdir(parents=True)
    drawn = samples(n, seed)
    pq.write_table(drawn, folder / "samples.parquet")
    pq.write_table(pa.Table.from_pylist(rows(drawn, shift)), folder / "results.parquet")
    (folder / "campaign.json").write_text(json.dumps(manifest(drawn, law, seed)))
    spool = Spool(folder, SPEEDS)
    for run, mass_kg in enumerate(drawn[MASS].to_pylist(), start=1):
        spool.add(run, profile(mass_kg))
    spool.finish(n)
    spool.close()
    return folder
