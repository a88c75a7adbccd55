"""The largest crossrange of [BETTS10]'s orbiter, found with the flight computer's own motion.

The controls are straight lines between knots over the energy lost, as a plan's; a flight ahead is
`flight_sw.model.propagation`, a leg for each so many knots as a profile takes. A sequential
quadratic programme moves the knots, with central differences of whole flights as its slopes.

Limits: the fixed end of the problem leaves no path limit; that of heat flux is not tried.
"""

import math
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.optimize import minimize

from flight_sw.model.motion import GAMMA, N_STATES, PHI, V, jacobi_energy
from flight_sw.model.onboard import ONBOARD
from flight_sw.model.profile import BY_ENERGY, KNOTS_MAX, PROFILE, merge_breaks
from flight_sw.model.propagation import CONDITIONS, ENDED, FAILED, GOING, PATH, WORK, advance, begin
from flight_sw.runtime.jit import kernel
from sim_harness.mission.mission import Mission, stated_mission
from sim_harness.world.assembly import world_of
from tools.gains.body import fill_onboard

F8 = npt.NDArray[np.float64]
Rows = npt.NDArray[np.void]

FT_M = 0.3048
SLUG_KG = 14.593902937206364  # 1 lbf s2/ft
BANK_DEG, ALPHA_DEG = (-89.0, 1.0), (-90.0, 90.0)  # bounds of [BETTS10]
END_SPEED_MPS, END_PATH_RAD = 2500.0 * FT_M, math.radians(-5.0)
END_ALT_M = 80_000.0 * FT_M
START = {
    "alt_m": 260_000.0 * FT_M,
    "v_rel_mps": 25_600.0 * FT_M,
    "path_deg": -1.0,
    "head_deg": 90.0,
}
BANK_INTERVALS, ALPHA_INTERVALS = KNOTS_MAX - 1, 3  # of a leg
GUESS_BANK_DEG, GUESS_ALPHA_DEG = (-75.0, 0.0), 17.5  # best lift over drag; bank rolled out evenly
STEPS_MAX = 100_000
MOVED_RAD = 1e-5  # for a central difference: its error and its round-off are both about 1e-9
SPEED_UNIT_MPS, PATH_UNIT_RAD = 10.0, math.radians(1.0)  # of the constraints
ENERGY_UNIT_MPS = 1000.0
ITERATIONS_MAX = 400
PRECISION_DEG = 1e-6  # of the objective, where the programme ends


def orbiter() -> Mission:
    """[BETTS10]'s planet, air and vehicle as a mission, in SI."""
    weight_lbf, g0_ftps2, area_ft2 = 203_000.0, 32.174, 2690.0
    raw: dict[str, Any] = {
        "name": "betts",
        "title": "Orbiter of the maximum crossrange problem",
        "planet": {
            "radius_km": 20_902_900.0 * FT_M / 1e3,
            "mu_m3ps2": 0.14076539e17 * FT_M**3,
            "rotation_radps": 0.0,
        },
        "atmosphere": {
            "model": "exponential",
            "density_ref_kgpm3": 0.002378 * SLUG_KG / FT_M**3,
            "scale_height_m": 23_800.0 * FT_M,
            "sound_speed_mps": 300.0,  # no coefficient depends on the Mach number
        },
        "vehicle": {
            "mass_kg": weight_lbf / g0_ftps2 * SLUG_KG,
            "reference_area_m2": area_ft2 * FT_M**2,
            "aerodynamics": {
                "model": "polynomial",
                "lift_powers": [[-0.20704], [0.029244]],
                "drag_powers": [[0.07854], [-0.0061592], [0.000621408]],
            },
        },
        "entry": {
            "altitude_km": START["alt_m"] / 1e3,
            "longitude_deg": 0.0,
            "latitude_deg": 0.0,
            "speed_mps": START["v_rel_mps"],
            "flight_path_angle_deg": START["path_deg"],
            "heading_deg": START["head_deg"],
        },
        "guidance": {"law": "none"},
    }
    return stated_mission(raw, Path("betts.toml"), "betts")


@kernel
def fly_legs(
    onboard: Any, air: Any, legs: Any, conditions: Any, path: Any, work: Any, start: Any
) -> int:
    """Flies the legs one after the other from a state of shape (6,); ends as `advance` does."""
    planet = onboard[0]["planet"]
    begin(path[0], legs[0], planet, start, 0.0)
    leg = 0
    for _ in range(STEPS_MAX):
        code = advance(onboard[0], air[0], legs[leg], conditions[0], path[0], work[0])
        if code != GOING:
            return code
        if path[0]["next_break"] >= legs[leg]["n_breaks"] and leg < len(legs) - 1:
            leg += 1
            begin(path[0], legs[leg], planet, path[0]["x"], path[0]["t_s"])
    return FAILED


@kernel
def put_knots(legs: Any, knots_rad: Any) -> None:
    """Writes the banks and then the angles of attack of all legs; neighbours share a knot."""
    n_legs = len(legs)
    n_bank = n_legs * BANK_INTERVALS + 1
    for leg in range(n_legs):
        for i in range(BANK_INTERVALS + 1):
            legs[leg]["bank_rad"][i] = knots_rad[leg * BANK_INTERVALS + i]
        for i in range(ALPHA_INTERVALS + 1):
            legs[leg]["alpha_rad"][i] = knots_rad[n_bank + leg * ALPHA_INTERVALS + i]


@kernel
def slopes(
    onboard: Any, air: Any, legs: Any, conditions: Any, path: Any, work: Any, start: Any,
    knots_rad: Any, out: Any,
) -> bool:  # fmt: skip
    """Central differences of the end's speed, path angle and latitude over each knot: (3, n)."""
    for k in range(len(knots_rad)):
        at = knots_rad[k]
        for side in (-1.0, 1.0):
            knots_rad[k] = at + side * MOVED_RAD
            put_knots(legs, knots_rad)
            if fly_legs(onboard, air, legs, conditions, path, work, start) != ENDED:
                knots_rad[k] = at
                return False
            x = path[0]["x"]
            for row, state in enumerate((V, GAMMA, PHI)):
                before = 0.0 if side < 0.0 else out[row, k]
                out[row, k] = before + side * x[state] / (2.0 * MOVED_RAD)
        knots_rad[k] = at
    return True


class Found(NamedTuple):
    """The end of the best flight."""

    latitude_deg: float
    t_s: float
    speed_error_mps: float
    path_error_deg: float
    iterations: int
    knots_rad: F8


class Search:
    """The problem with so many legs and a step of the flights ahead."""

    def __init__(self, n_legs: int, step_s: float) -> None:
        world = world_of(orbiter())[0]
        self.onboard = np.zeros(1, ONBOARD.dtype)
        fill_onboard(self.onboard[0], world)
        self.air = np.zeros(1, world["atmosphere"].dtype)
        self.air[0] = world["atmosphere"]
        self.path, self.work = np.zeros(1, PATH), np.zeros(1, WORK)
        self.conditions = np.zeros(1, CONDITIONS)
        self.conditions["step_s"], self.conditions["end_alt_m"] = step_s, END_ALT_M
        self.conditions["heat_flux_limit_wpm2"] = np.inf
        self.conditions["heat_flux_unit_wpm2"] = 1.0
        radius_m = float(self.onboard["planet"]["radius_m"][0])
        self.start = np.zeros(N_STATES)
        self.start[:4] = (
            START["v_rel_mps"], math.radians(START["path_deg"]), math.radians(START["head_deg"]),
            radius_m + START["alt_m"],
        )  # fmt: skip
        self.legs = self._legs(n_legs, radius_m)

    def _legs(self, n_legs: int, radius_m: float) -> Rows:
        """Knots at even distances over the speed of the energy, from the start to the end."""
        planet = self.onboard["planet"][0]
        end = np.array([0.0, 0.0, 0.0, radius_m + END_ALT_M, 0.0, 0.0])
        at_rest_jpkg = float(jacobi_energy(planet, end))
        first_mps = math.sqrt(2.0 * (float(jacobi_energy(planet, self.start)) - at_rest_jpkg))
        last = (first_mps - END_SPEED_MPS) / ENERGY_UNIT_MPS
        legs = np.zeros(n_legs, PROFILE)
        legs["index_by"], legs["energy_ref_jpkg"] = BY_ENERGY, at_rest_jpkg
        legs["index_speed_mps"], legs["index_unit_mps"] = first_mps, ENERGY_UNIT_MPS
        legs["n_bank"], legs["n_alpha"] = BANK_INTERVALS + 1, ALPHA_INTERVALS + 1
        banks = np.linspace(0.0, last, n_legs * BANK_INTERVALS + 1)
        alphas = np.linspace(0.0, last, n_legs * ALPHA_INTERVALS + 1)
        for leg in range(n_legs):
            b, a = leg * BANK_INTERVALS, leg * ALPHA_INTERVALS
            legs[leg]["bank_index"][: BANK_INTERVALS + 1] = banks[b : b + BANK_INTERVALS + 1]
            legs[leg]["alpha_index"][: ALPHA_INTERVALS + 1] = alphas[a : a + ALPHA_INTERVALS + 1]
            merge_breaks(legs[leg])
        return legs

    @property
    def n_bank(self) -> int:
        """Knots of the bank."""
        return len(self.legs) * BANK_INTERVALS + 1

    @property
    def n_alpha(self) -> int:
        """Knots of the angle of attack."""
        return len(self.legs) * ALPHA_INTERVALS + 1

    @property
    def _flight(self) -> tuple[Any, ...]:
        return (
            self.onboard, self.air, self.legs, self.conditions, self.path, self.work, self.start
        )  # fmt: skip

    @cached_property
    def guess(self) -> F8:
        """Bank rolled out evenly at the angle of the best glide."""
        banks = np.linspace(*GUESS_BANK_DEG, self.n_bank)
        return np.radians([*banks, *[GUESS_ALPHA_DEG] * self.n_alpha])

    def end(self, knots_rad: F8) -> F8:
        """Speed, path angle and latitude at the end altitude; not a number if it is not reached."""
        put_knots(self.legs, knots_rad)
        if fly_legs(*self._flight) != ENDED:
            return np.full(3, np.nan)
        return np.array(self.path["x"][0][[V, GAMMA, PHI]])

    def slopes(self, knots_rad: F8) -> F8:
        """Of `end`, by the knots."""
        out = np.zeros((3, len(knots_rad)))
        if not slopes(*self._flight, knots_rad.copy(), out):
            return np.full(out.shape, np.nan)
        return out

    def best(self) -> Found:
        """The knots with the largest final latitude that end at speed and path angle."""
        bounds = np.radians([*[BANK_DEG] * self.n_bank, *[ALPHA_DEG] * self.n_alpha])
        scale = np.array([SPEED_UNIT_MPS, PATH_UNIT_RAD])
        wanted = np.array([END_SPEED_MPS, END_PATH_RAD])
        found = minimize(
            lambda u: -math.degrees(self.end(u)[2]),
            self.guess,
            jac=lambda u: -np.degrees(self.slopes(u)[2]),
            method="SLSQP",
            bounds=bounds,
            constraints={
                "type": "eq",
                "fun": lambda u: (self.end(u)[:2] - wanted) / scale,
                "jac": lambda u: self.slopes(u)[:2] / scale[:, None],
            },
            options={"maxiter": ITERATIONS_MAX, "ftol": PRECISION_DEG},
        )
        speed, path, latitude = map(float, self.end(found.x))
        return Found(
            math.degrees(latitude), float(self.path["t_s"][0]), speed - END_SPEED_MPS,
            math.degrees(path - END_PATH_RAD), int(found.nit), found.x,
        )  # fmt: skip
