"""What navigation reports to the bus: the truth, or what sensors and a filter make of it.

`measure` writes a report, in the signals' units, into the flat vector of bus values. A report with
errors is the truth of some reports ago, through lag and scale, with constant error and noise. The
noise is a function of seed, channel and report number; where it is correlated in time it is a
first-order Gauss-Markov process that starts in its steady state. NAV_STATE is what navigation
remembers between reports.

Limits: errors are independent of each other and of the motion; there is no filter behind them.
"""

import math

import numpy as np

from flight_sw import icd
from flight_sw.icd import value_index
from flight_sw.model.angles import wrapped
from flight_sw.records.types_ import F8, Record
from sim_harness.jit import kernel
from sim_harness.world import noise
from sim_harness.world.noise import gaussians, uniforms
from sim_harness.world.records import NAV_CHANNELS, NAV_PAIRS

LON = value_index("NAV_POSITION", "lon_rad")
LAT = value_index("NAV_POSITION", "lat_rad")
ALT = value_index("NAV_VERTICAL", "alt_m")
V_REL = value_index("NAV_VERTICAL", "v_rel_mps")
FLIGHT_PATH_ANGLE = value_index("NAV_DIRECTION", "flight_path_angle_rad")
HEADING = value_index("NAV_DIRECTION", "heading_rad")
DRAG = value_index("NAV_AERO", "drag_mps2")
LIFT = value_index("NAV_AERO", "lift_mps2")
BANK = value_index("NAV_ATTITUDE", "bank_rad")
ALPHA = value_index("NAV_ATTITUDE", "alpha_rad")
HEAT_FLUX = value_index("NAV_HEATING", "heat_flux_wpm2")
TIME = value_index("NAV_TIME", "t_s")

CHANNELS = (LAT, LON, ALT, V_REL, FLIGHT_PATH_ANGLE, HEADING, DRAG, LIFT, BANK, ALPHA, HEAT_FLUX)
"""What each channel of an error is about; the first two in metres north and east."""
STREAMS = (
    noise.NAV_POSITION,
    noise.NAV_VERTICAL,
    noise.NAV_DIRECTION,
    noise.NAV_AERO,
    noise.NAV_ATTITUDE,
    noise.NAV_HEATING,
)
"""Of the noise of each pair of channels."""
REPORTED = (*CHANNELS, TIME)
N_REPORTED = len(REPORTED)
REPORTED_NAMES = tuple(icd.VALUE_NAMES[index] for index in REPORTED)
"""Message and signal of each value of a report."""

_SIGNALS = [signal for message in icd.LAYOUT for signal in message.signals]
LOWEST = np.array([signal.low for signal in _SIGNALS])
HIGHEST = np.array([signal.high for signal in _SIGNALS])

COS_LAT_MIN = 1e-6  # floor on cos(lat): an eastward error within 6 m of a pole is no longer told
LATENCY_MAX_REPORTS = 63
RING = LATENCY_MAX_REPORTS + 1

WHOLE_SET = (1 << len(STREAMS)) - 1  # a bit for each navigation message, none for the time

NAV_STATE = np.dtype(
    [
        ("seed", "i8"),  # of the flight
        ("reports", "i8"),  # since entry
        ("saturations", "i8", (N_REPORTED,)),  # values beyond their signal's range, held at its end
        ("cut_off", "i8"),  # values below zero of a signal that has none: noise about nothing
        ("dropouts", "i8"),  # reports of which something was withheld
        ("dropout_left", "i8"),  # reports to the end of the present one
        ("withheld", "u4"),  # bits of the messages that this report is sent without
        ("lagged", "f8", (NAV_CHANNELS,)),  # in the channels' units, as all below
        ("noise", "f8", (2 * NAV_PAIRS,)),  # in standard deviations
        ("ring", "f8", (RING, NAV_CHANNELS)),  # the last reports before latency
    ],
    align=True,
)
"""What navigation remembers; the channels are those of CHANNELS."""


@kernel
def report_truth(truth: Record, values: F8) -> None:
    """The truth as bus values; lift is reported by its magnitude."""
    values[LON] = truth["lon_rad"]
    values[LAT] = truth["lat_rad"]
    values[ALT] = truth["alt_m"]
    values[V_REL] = truth["v_rel_mps"]
    values[FLIGHT_PATH_ANGLE] = truth["flight_path_angle_rad"]
    values[HEADING] = truth["heading_rad"]
    values[DRAG] = truth["drag_mps2"]
    values[LIFT] = abs(truth["lift_mps2"])
    values[BANK] = truth["bank_rad"]
    values[ALPHA] = truth["alpha_rad"]
    values[HEAT_FLUX] = truth["heat_flux_wpm2"]
    values[TIME] = truth["t_s"]


@kernel
def _make_old(errors: Record, nav_state: Record, values: F8) -> None:
    """Puts the report through the sensors' lags, keeps it, and takes the one of `latency` ago."""
    report = nav_state["reports"]
    lagged = nav_state["lagged"]
    ring = nav_state["ring"]
    kept = report % RING
    for i in range(NAV_CHANNELS):
        value = values[CHANNELS[i]]
        if report == 0 or errors["lag_gain"][i] == 1.0:
            lagged[i] = value
        else:
            lagged[i] += errors["lag_gain"][i] * (value - lagged[i])
        ring[kept, i] = lagged[i]
    taken = max(report - errors["latency_reports"], 0) % RING
    for i in range(NAV_CHANNELS):
        values[CHANNELS[i]] = ring[taken, i]


@kernel
def _draw_noise(errors: Record, nav_state: Record) -> None:
    """The noise of this report, in standard deviations, for the channels that have any."""
    report = nav_state["reports"]
    kept = nav_state["noise"]
    for pair in range(NAV_PAIRS):
        if errors["noisy"][pair] == 0:
            continue
        memory = errors["memory"][pair]
        renewed = math.sqrt(1.0 - memory * memory)
        if report == 0:
            memory, renewed = 0.0, 1.0
        first, second = gaussians(nav_state["seed"], STREAMS[pair], report)
        kept[2 * pair] = memory * kept[2 * pair] + renewed * first
        kept[2 * pair + 1] = memory * kept[2 * pair + 1] + renewed * second


@kernel
def _add_errors(errors: Record, nav_state: Record, radius_m: float, values: F8) -> None:
    """Scale, constant error and noise on every channel; angles stay angles."""
    kept = nav_state["noise"]
    lat_rad = values[LAT]
    for i in range(NAV_CHANNELS):
        error = errors["bias"][i] + errors["sigma"][i] * kept[i]
        k = CHANNELS[i]
        if k == LAT:
            values[k] += error / (radius_m + values[ALT])
        elif k == LON:
            parallel_m = (radius_m + values[ALT]) * max(math.cos(lat_rad), COS_LAT_MIN)
            values[k] += error / parallel_m
        else:
            values[k] = errors["slope"][i] * values[k] + error
    values[LON] = wrapped(values[LON])
    values[HEADING] = wrapped(values[HEADING])
    values[BANK] = wrapped(values[BANK])
    values[ALPHA] = wrapped(values[ALPHA])


@kernel
def _drop_out(errors: Record, nav_state: Record) -> None:
    """Decides which messages this report is sent without."""
    if nav_state["dropout_left"] > 0:
        nav_state["dropout_left"] -= 1
    else:
        nav_state["withheld"] = 0
        begins, which = uniforms(nav_state["seed"], noise.NAV_DROPOUT, nav_state["reports"])
        if begins < errors["dropout_ratio"]:
            nav_state["dropout_left"] = errors["dropout_reports"] - 1
            nav_state["withheld"] = WHOLE_SET
            if errors["dropout_of_message"] == 1:
                nav_state["withheld"] = 1 << int(which * len(STREAMS))
    if nav_state["withheld"] != 0:
        nav_state["dropouts"] += 1


@kernel
def _saturate(nav_state: Record, values: F8) -> None:
    """Holds every value inside the range of its signal: a message with one outside is not sent."""
    saturations = nav_state["saturations"]
    for i in range(N_REPORTED):
        k = REPORTED[i]
        if values[k] < LOWEST[k]:
            values[k] = LOWEST[k]
            if LOWEST[k] == 0.0:
                nav_state["cut_off"] += 1
            else:
                saturations[i] += 1
        elif values[k] > HIGHEST[k]:
            values[k] = HIGHEST[k]
            saturations[i] += 1


def beyond_the_bus(values: F8) -> str:
    """Which value of a report the bus cannot carry, in a sentence; empty if it carries all."""
    for index, (message, name) in zip(REPORTED, REPORTED_NAMES, strict=True):
        if not LOWEST[index] <= values[index] <= HIGHEST[index]:
            return (
                f"{name} is {values[index]:.12g}, allowed {LOWEST[index]:.12g} to "
                f"{HIGHEST[index]:.12g} by {message}"
            )
    return ""


@kernel
def measure(world: Record, truth: Record, nav_state: Record, values: F8) -> None:
    """Writes one report into the vector of bus values."""
    errors = world["navigation"]
    report_truth(truth, values)
    if errors["has_errors"] == 1:
        _make_old(errors, nav_state, values)
        _draw_noise(errors, nav_state)
        _add_errors(errors, nav_state, world["planet"]["radius_m"], values)
    if errors["dropout_ratio"] > 0.0:
        _drop_out(errors, nav_state)
    _saturate(nav_state, values)
    nav_state["reports"] += 1
