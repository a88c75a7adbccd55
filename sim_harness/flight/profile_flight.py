"""A flight along a bank profile, without a flight computer: how a nominal trajectory is made."""

from flight_sw.guidance.drag.bank_profile import nominal_bank
from flight_sw.records.types_ import Frames, Record
from sim_harness.jit import kernel
from sim_harness.world.motion import rates
from sim_harness.world.records import FLYING
from sim_harness.world.vehicle import advance, ended


@kernel
def bank_of_frame(world: Record, profile: Record, truth: Record) -> float:
    """Bank at the speed of mid-frame: second order in the frame."""
    moving = rates(
        world,
        truth["held"],
        truth["lat_rad"],
        truth["alt_m"],
        truth["v_rel_mps"],
        truth["flight_path_angle_rad"],
        truth["heading_rad"],
    )
    return nominal_bank(profile, truth["v_rel_mps"] + 0.5 * world["dt_s"] * moving[3])


@kernel
def fly_profile(worlds: Frames, profiles: Frames, truths: Frames, log: Frames) -> tuple[int, int]:
    """Fly to the end with the bank of a profile and the entry's angle of attack.

    Leaves the truth of every frame in `log`, the last one included; returns their number and the
    outcome, FLYING if the log is full.
    """
    world, profile, truth = worlds[0], profiles[0], truths[0]
    alpha_rad = truth["alpha_rad"]
    for i in range(len(log)):
        log[i] = truth
        outcome = ended(world, truth)
        if outcome != FLYING:
            return i + 1, outcome
        advance(world, truth, bank_of_frame(world, profile, truth), alpha_rad)
    return len(log), FLYING
