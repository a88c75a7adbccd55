"""What is told of a flight when it is over: summary.json's object."""

import json
import math
from typing import Any

from flight_sw import icd
from flight_sw.can.error_frames import account_of
from flight_sw.load_image import TELEMETRY_PREFIX, messages_of
from flight_sw.reception.receiver import LOST, OK, VERDICTS
from flight_sw.records.types_ import Record
from flight_sw.runtime.identity import name_of
from sim_harness.flight.flight import FlightRun, verdicts
from sim_harness.flight.navigation_watch import held_values
from sim_harness.flight.outcomes import limits_exceeded, outcome_class
from sim_harness.flight.terminal import told

TIMING_KEY = "timing"  # of a recording's results
LOST_KEY = "bus_rows_lost"  # frames that were on the bus and are not in the recording
NOT_REJECTED = {VERDICTS[OK], VERDICTS[LOST]}


def rejected(counted: dict[str, int]) -> dict[str, int]:
    """The refusals among a receiver's counters."""
    return {k: n for k, n in counted.items() if k not in NOT_REJECTED}


def pace_text(pace: float) -> str:
    """A pace as the command line takes it."""
    if pace <= 0.0:
        return "lockstep"
    return "realtime" if pace == 1.0 else f"{pace:g}x"


def slips(run: FlightRun) -> int:
    """Frames not finished before the next, on either side of the bus."""
    return int(run.punctuality.get("harness_slips", 0)) + int(run.computer.get("slips", 0))


def timing(run: FlightRun) -> dict[str, Any]:
    """All that was measured of the flight's punctuality."""
    keys = ("step_time_us", "step_time_bins_us", "wake_up_us", "wake_up_bins_us", "slips", "ticks")
    computer = {key: run.computer[key] for key in keys if key in run.computer}
    return {"computer": computer, "harness": run.punctuality}


def punctuality_of(run: FlightRun) -> dict[str, Any]:
    """How the flight kept time: the same keys in summary.json and in the recording."""
    return {
        "pace": pace_text(run.plan.pace),
        "pace_reached": run.punctuality.get("pace_reached"),
        "pace_held": run.punctuality.get("pace_held", True),
        "slips": slips(run),
        "ticks": int(run.computer.get("ticks", 0)),
        "late_commands": run.punctuality.get("late_commands", 0),
        "timing": timing(run),
    }


def results_of(run: FlightRun) -> dict[str, str]:
    """What the recording keeps of the summary, in the form that its metadata takes."""
    kept = {key: getattr(run.plan, key) for key in ("bus", "synchronisation")}
    frames = int(run.harness["truth"]["minor_frames"][0])
    period_s = run.plan.mission.dt_s
    results = {**kept, "minor_frames": frames, "period_s": period_s, **punctuality_of(run)}
    lost = int(run.harness["bus_rows_lost"][0])
    return {TIMING_KEY: json.dumps(results), LOST_KEY: str(lost)}


def ratio(value: float, limit: float) -> float | None:
    """Share of a limit that was reached; None where there is no limit."""
    return float(value) / float(limit) if math.isfinite(limit) else None


def heating_of(run: FlightRun) -> dict[str, float | None]:
    """Heat load and fluxes: null for a mission without heating, the error null without a limit."""
    truth, metrics = run.harness[0]["truth"], run.harness[0]["metrics"]
    peak_wpm2, limit_wpm2 = float(truth["heat_flux_max_wpm2"]), metrics["heat_flux_limit_wpm2"]
    before_wpm2 = float(metrics["heat_flux_max_before_wpm2"])
    after_wpm2 = float(metrics["heat_flux_max_after_wpm2"])
    values = {
        "heat_load_mjpm2": float(truth["heat_load_jpm2"]) / 1e6,
        "heat_flux_max_kwpm2": peak_wpm2 / 1e3,
        "heat_flux_max_before_activation_kwpm2": before_wpm2 / 1e3,
        "heat_flux_max_after_activation_kwpm2": after_wpm2 / 1e3,
        "heat_flux_max_ratio": ratio(peak_wpm2, limit_wpm2),
        "heat_flux_max_after_activation_ratio": ratio(after_wpm2, limit_wpm2),
        "heat_flux_error_mjpm2": float(metrics["heat_flux_error_jpm2"]) / 1e6,
        "heat_flux_over_s": float(metrics["heat_flux_over_s"]),
    }
    untold = () if run.plan.mission.heating else tuple(values)
    if not math.isfinite(limit_wpm2):
        untold += ("heat_flux_error_mjpm2",)
    return {key: None if key in untold else value for key, value in values.items()}


def bank_step_rms_deg(metrics: Record) -> float:
    """Root mean square of the bank command's change from one frame to the next while tracking."""
    steps = int(metrics["bank_steps"])
    return math.degrees(math.sqrt(float(metrics["bank_step_sq_rad2"]) / steps)) if steps else 0.0


def loads_of(run: FlightRun) -> dict[str, float | None]:
    """Load factor and dynamic pressure: peaks, ratios to their limits, time over them."""
    truth, metrics = run.harness[0]["truth"], run.harness[0]["metrics"]
    load_g, pressure_pa = truth["load_factor_max_g"], truth["dynamic_pressure_max_pa"]
    return {
        "load_factor_max_g": float(load_g),
        "dynamic_pressure_max_kpa": float(pressure_pa) / 1e3,
        "load_factor_max_ratio": ratio(load_g, metrics["load_factor_limit_g"]),
        "dynamic_pressure_max_ratio": ratio(pressure_pa, metrics["dynamic_pressure_limit_pa"]),
        "load_factor_over_s": float(metrics["load_factor_over_s"]),
        "load_factor_over_gs": float(metrics["load_factor_over_gs"]),
        "dynamic_pressure_over_s": float(metrics["dynamic_pressure_over_s"]),
    }


def effort_facts(run: FlightRun) -> dict[str, Any]:
    """What the guidance spent."""
    metrics = run.harness["metrics"][0]
    return {
        "bank_effort_degs": math.degrees(float(metrics["bank_effort_rads"])),
        "bank_step_rms_deg": bank_step_rms_deg(metrics),
        "bank_travel_deg": math.degrees(float(metrics["bank_travel_rad"])),
        "bank_reversals": int(metrics["bank_reversals"]),
        "tracking_time_s": float(metrics["tracking_time_s"]),
        "bank_saturated_s": float(metrics["bank_saturated_s"]),
        "alpha_saturated_s": float(metrics["alpha_saturated_s"]),
        "without_fix_s": float(metrics["without_fix_s"]),
    }


def frame_facts(run: FlightRun) -> dict[str, Any]:
    """What went over the bus and what was refused."""
    port = run.harness["port"][0]
    by_computer = rejected(run.computer["verdicts"]) if "verdicts" in run.computer else {}
    by_harness = rejected(verdicts(port["rx"]["counted"]))
    return {
        "minor_frames": int(run.harness["truth"]["minor_frames"][0]),
        "period_s": run.plan.mission.dt_s,
        "frames_sent": int(port["frames_sent"]),
        "frames_received": int(port["frames_received"]),
        "frames_rejected": sum(by_computer.values()) + sum(by_harness.values()),
        "incomplete_sets": int(run.computer.get("incomplete_sets", 0)),
        "navigation_dropouts": int(run.harness["navigation"]["dropouts"][0]),
        "navigation_saturations": int(run.harness["navigation"]["saturations"].sum()),
        "navigation_refused": int(port["tx_refused"]),
        "command_sha256": run.command_sha256,
        "load_crc32": f"0x{run.image.crc32:08x}",
    }


def flight_facts(run: FlightRun) -> dict[str, Any]:
    """The scalars of a finished flight: the same on every bus, and a campaign's row."""
    truth = run.harness["truth"][0]
    facts = {
        "mission": run.plan.mission.name,
        "case": run.plan.case,
        "law": run.image.law,
        "seed": run.plan.seed,
        "outcome": run.outcome_text,
        "flight_time_s": float(truth["t_s"]),
        "ground_range_km": float(truth["ground_range_m"]) / 1e3,
        **told(run.plan.mission, run.harness["world"][0], truth, run.outcome),
        **heating_of(run),
        **loads_of(run),
        **effort_facts(run),
        "final_altitude_km": float(truth["alt_m"]) / 1e3,
        "final_speed_mps": float(truth["v_rel_mps"]),
        "final_longitude_deg": math.degrees(float(truth["lon_rad"])),
        "final_latitude_deg": math.degrees(float(truth["lat_rad"])),
        "final_flight_path_angle_deg": math.degrees(float(truth["flight_path_angle_rad"])),
        "final_heading_deg": math.degrees(float(truth["heading_rad"])),
        "plan_target_error": law_telemetry(run).get("plan_target_error"),
        "bank_final_deg": math.degrees(float(truth["bank_rad"])),
        **frame_facts(run),
    }
    judgement = run.plan.mission.judgement
    return {
        **facts,
        "limits_exceeded": limits_exceeded(facts, judgement),
        "outcome_class": outcome_class(facts, judgement),
    }


def law_telemetry(run: FlightRun) -> dict[str, float]:
    """What the law last told of itself, by signal."""
    received = run.harness["port"]["received"][0]
    return {
        signal.name: float(received[icd.value_index(message.name, signal.name)])
        for message in messages_of(run.image.law)
        if message.name.startswith(TELEMETRY_PREFIX)
        for signal in message.signals
    }


def _number(number: int) -> str | None:
    return name_of(int(number)) if number else None


def summary_of(run: FlightRun) -> dict[str, Any]:
    """The summary's object, its units in its keys; numbers as flown, not rounded for display."""
    harness = run.harness[0]
    port = harness["port"]
    reported = "verdicts" in run.computer
    facts = flight_facts(run)
    errors = account_of(port["errors"])
    return {
        **facts,
        "harness": name_of(run.number),
        "computer": name_of(int(port["computer"])),
        "bus": run.plan.bus,
        "navigation_held": held_values(harness["navigation"]),
        "synchronisation": run.plan.synchronisation,
        "candidates_believed": int(run.computer.get("candidates_believed", 0)),
        "rejected_by_flight_computer": rejected(run.computer["verdicts"]) if reported else None,
        "other_harness": _number(port["other_harness"]),
        "other_computer": _number(port["other_computer"]),
        "rejected_by_harness": rejected(verdicts(port["rx"]["counted"])),
        "frames_dropped": run.frames_dropped + int(run.computer.get("frames_dropped", 0)),
        "error_frames": errors.frames,
        "bus_off": errors.bus_off,
        "bus_errors": list(errors.words),
        "recording_failure": run.unrecorded or None,
        "bus_losses": int(run.computer.get("bus_losses", 0)),
        "bus_rows_lost": int(harness["bus_rows_lost"]),
        "command_rows_lost": int(harness["command_rows_lost"]),
        "law_telemetry": law_telemetry(run),
        "step_time_us": run.computer.get("step_time_us"),
        **punctuality_of(run),
        "speedup": facts["flight_time_s"] / run.wall_s if run.wall_s > 0.0 else 0.0,
        "compile_s": round(run.compile_s, 3),
        "computer_compile_s": run.computer.get("compile_s"),
    }
