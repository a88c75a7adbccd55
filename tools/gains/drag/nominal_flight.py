"""The nominal flight of a drag-tracking law: solved on the ground, stored as a reference.

The bank is a straight line over speed; its two ends are solved so that the flight, when it has the
target's speed, is at the target's altitude and range. The flight is planar: the sideways part of
the lift is left out, as a tracker of drag leaves it to others.
"""

import hashlib
import itertools
import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from flight_sw.errors import DesignError
from flight_sw.guidance.drag.bank_profile import BANK_PROFILE, nominal_bank
from flight_sw.guidance.drag.dynamics import DYNAMICS, drag_dynamics, jacobi_energy
from flight_sw.guidance.drag.reference import BY_ENERGY, BY_SPEED, BY_TIME, ROWS
from flight_sw.model.great_circle import GROUND_TRACK, range_flown
from flight_sw.records.types_ import Record
from sim_harness.flight.profile_flight import fly_profile
from sim_harness.mission.mission import Mission
from sim_harness.world.assembly import truth_of, world_of
from sim_harness.world.ground_track import fill_ground_track
from sim_harness.world.records import END_CONDITION, OUTCOMES, TRUTH
from tools.gains.drag.choices import NominalFlight
from tools.gains.fixes import fix_of

Rows = npt.NDArray[np.void]
GRID_DEG = 6.0  # of the banks that are tried first
CLOSE_M = 1.0  # of the target, in altitude and range: solved
HALVINGS_MAX = 8
ITERATIONS_MAX = 40
STARTS_TRIED = 6
ROWS_MIN = 8
APART_DEG = 0.01  # of the finite differences


class Flown(NamedTuple):
    """A profile flown to the target's speed."""

    log: Rows
    """TRUTH of every frame down to the first at or below that speed."""
    miss_m: npt.NDArray[np.float64]
    """Altitude and range above those of the target, at that speed."""


class Nominal(NamedTuple):
    """The solved flight."""

    banks_deg: tuple[float, float]
    """At the entry's and at the target's speed."""
    profile: Rows
    flown: Flown


class Problem:
    """Flights of one mission along bank profiles."""

    def __init__(self, mission: Mission, choice: NominalFlight) -> None:
        self.track = np.zeros(1, GROUND_TRACK.dtype)
        if mission.target is None:
            raise DesignError(
                f"{mission.path.name}: a law that tracks drag or range needs a table [target]"
            )
        fill_ground_track(self.track[0], mission)
        self.mission, self.choice, self.target = mission, choice, mission.target
        self.truth = truth_of(mission)
        self.world = world_of(mission).copy()
        self.world["dt_s"] = 1.0 / choice.rate_hz
        self.world["aerodynamics"]["side_lift_ratio"] = 0.0
        # What the mission lays on the world is not for the computer to know.
        self.world["aerodynamics"]["lift_ratio"] = self.world["aerodynamics"]["drag_ratio"] = 1.0
        self.world["air"]["is_disturbed"] = self.world["air"]["has_wind"] = 0
        end = self.world["end"]
        end["speed_mps"], end["alt_m"], end["at_target"] = self.target.speed_mps, -math.inf, 0
        self.log = np.zeros(math.ceil(mission.end.time_max_s * choice.rate_hz) + 2, TRUTH)
        entry_mps = float(self.truth["v_rel_mps"][0])
        if not self.target.speed_mps < entry_mps:
            raise DesignError(
                f"{mission.path.name}: target.speed_mps is {self.target.speed_mps:g}, "
                f"allowed below the entry speed {entry_mps:g}"
            )
        self.profile = np.zeros(1, BANK_PROFILE.dtype)
        self.profile["v_fast_mps"], self.profile["v_slow_mps"] = entry_mps, self.target.speed_mps
        self.refusals: set[str] = set()

    def fly(self, banks_deg: Any) -> Flown | None:
        """The flight with these banks at entry and target speed; None if it never gets there."""
        self.profile["bank_fast_rad"], self.profile["bank_slow_rad"] = np.radians(banks_deg)
        n, outcome = fly_profile(self.world, self.profile, self.truth.copy(), self.log)
        if outcome != END_CONDITION or n < 2:
            self.refusals.add(OUTCOMES[outcome])
            return None
        before, last = self.log[n - 2], self.log[n - 1]
        share = (before["v_rel_mps"] - self.target.speed_mps) / (
            before["v_rel_mps"] - last["v_rel_mps"]
        )
        radius_m = float(self.world["planet"]["radius_m"][0])
        ends = [
            (float(f["alt_m"]), range_flown(self.track[0], radius_m,
                                            float(f["lon_rad"]), float(f["lat_rad"])))
            for f in (before, last)
        ]  # fmt: skip
        at = np.array(ends[0]) + share * (np.array(ends[1]) - np.array(ends[0]))
        miss = at - np.array([self.target.altitude_km * 1e3, self.track["target_m"][0]])
        return Flown(self.log[:n], miss)

    def starts(self) -> list[tuple[float, float, float]]:
        """Banks over a coarse grid, nearest miss first."""
        low, high = self.choice.bank_low_deg, self.choice.bank_high_deg
        banks = np.linspace(low, high, max(round((high - low) / GRID_DEG), 2) + 1)
        found = []
        for fast in banks:
            for slow in (fast, 0.5 * (fast + low), 0.5 * (fast + high)):
                if (flown := self.fly((fast, slow))) is not None:
                    found.append((float(np.linalg.norm(flown.miss_m)), float(fast), float(slow)))
        return sorted(found)

    def newton(self, banks_deg: npt.NDArray[np.float64]) -> tuple[float, Any]:
        """Damped Newton from one start: distance from the target and the banks reached."""
        here = self.fly(banks_deg)
        if here is None:
            return math.inf, banks_deg
        miss = here.miss_m
        for _ in range(ITERATIONS_MAX):
            distance = float(np.linalg.norm(miss))
            if distance < 1e-6:
                break
            columns = [self.fly(banks_deg + APART_DEG * np.eye(2)[i]) for i in range(2)]
            if columns[0] is None or columns[1] is None:
                break
            slopes = np.column_stack([(c.miss_m - miss) / APART_DEG for c in columns if c])
            try:
                step = -np.linalg.solve(slopes, miss)
            except np.linalg.LinAlgError:
                break
            better = self._shortened(banks_deg, step, distance)
            if better is None:
                break
            banks_deg, miss = better
        return float(np.linalg.norm(miss)), banks_deg

    def _shortened(self, banks_deg: Any, step: Any, distance: float) -> tuple[Any, Any] | None:
        """The step, halved until it comes nearer to the target."""
        for halving in range(HALVINGS_MAX):
            tried = banks_deg + step / 2.0**halving
            if tried.min() < self.choice.bank_low_deg or tried.max() > self.choice.bank_high_deg:
                continue
            flown = self.fly(tried)
            if flown is not None and np.linalg.norm(flown.miss_m) < distance:
                return tried, flown.miss_m
        return None


def solve(mission: Mission, choice: NominalFlight) -> Nominal:
    """The nominal flight; raises DesignError where no bank linear in speed ends at the target."""
    problem = Problem(mission, choice)
    best, banks_deg = math.inf, np.zeros(2)
    for _, fast, slow in problem.starts()[:STARTS_TRIED]:
        distance, reached = problem.newton(np.array([fast, slow]))
        if distance < best:
            best, banks_deg = distance, reached
        if best < CLOSE_M:
            break
    flown = problem.fly(banks_deg) if math.isfinite(best) else None
    wanted = (
        f"{problem.target.altitude_km:g} km, {problem.target.speed_mps:g} m/s, "
        f"{problem.track['target_m'][0] / 1e3:z.2f} km downrange"
    )
    if flown is None:
        raise DesignError(
            f"{mission.path.name}: no bank between {choice.bank_low_deg:g} and "
            f"{choice.bank_high_deg:g} deg comes down to {problem.target.speed_mps:g} m/s "
            f"({', '.join(sorted(problem.refusals))})"
        )
    if not best < CLOSE_M:
        over_km = flown.miss_m / 1e3
        raise DesignError(
            f"{mission.path.name}: no bank linear in speed, {choice.bank_low_deg:g} to "
            f"{choice.bank_high_deg:g} deg, ends at {wanted}; the nearest, {banks_deg[0]:z.1f} to "
            f"{banks_deg[1]:z.1f} deg, is {over_km[0]:+z.2f} km in altitude and "
            f"{over_km[1]:+z.2f} km in range off"
        )
    return Nominal(
        (float(banks_deg[0]), float(banks_deg[1])),
        problem.profile.copy(),
        Flown(flown.log.copy(), flown.miss_m),
    )


KEPT_MAX = 8
_SOLVED: dict[str, Nominal] = {}


def solved(mission: Mission, choice: NominalFlight) -> Nominal:
    """As `solve`; the last few are kept, since the laws of a design share theirs."""
    problem = Problem(mission, choice)
    told = repr((problem.target, choice, mission.end.time_max_s)).encode()
    digest = hashlib.sha256(told + problem.world.tobytes() + problem.truth.tobytes())
    key = digest.hexdigest()
    if key not in _SOLVED:
        while len(_SOLVED) >= KEPT_MAX:
            _SOLVED.pop(next(iter(_SOLVED)))
        _SOLVED[key] = solve(mission, choice)
    return _SOLVED[key]


class Row(NamedTuple):
    """One row of the reference."""

    grid: float
    drag_mps2: float
    slope: float
    bend: float
    range_m: float


INDEXES = {"energy": BY_ENERGY, "speed": BY_SPEED, "time": BY_TIME}


class Reference:
    """Makes the rows of a reference: closed-form derivatives of drag over its index."""

    def __init__(
        self, body: Record, track: Record, nominal: Nominal, choice: NominalFlight
    ) -> None:
        self.body, self.track, self.nominal, self.choice = (
            body,
            track,
            nominal,
            choice,
        )
        self.planet = body["onboard"]["planet"]
        self.dynamics = np.zeros(1, DYNAMICS.dtype)[0]

    def index_of(self, frame: Record, drag_rate: float, cos_bank: float) -> Sequence[float]:
        """The index at a frame of the flight, its rate and second derivative."""
        moves = self.dynamics
        v, drag = float(frame["v_rel_mps"]), float(frame["drag_mps2"])
        if self.choice.index == "time":
            return float(frame["t_s"]), 1.0, 0.0
        if self.choice.index == "speed":
            accel = float(moves["speed_accel_mps3"] + moves["speed_lift_mps3"] * cos_bank)
            return v, float(moves["speed_rate_mps2"]), accel
        energy = jacobi_energy(self.planet, float(frame["alt_m"]), float(frame["lat_rad"]), v)
        return energy, -v * drag, -(float(moves["speed_rate_mps2"]) * drag + v * drag_rate)

    def row(self, frame: Record) -> Row:
        """The row of a frame of the nominal flight."""
        moves = self.dynamics
        drag, lift = float(frame["drag_mps2"]), float(frame["lift_mps2"])
        drag_dynamics(
            self.planet, self.body["atmosphere"], fix_of(frame)[0], drag, lift, self.dynamics
        )
        cos_bank = math.cos(nominal_bank(self.nominal.profile[0], float(frame["v_rel_mps"])))
        drag_rate = drag * float(moves["log_rate_1ps"])
        drag_accel = float(moves["free_mps4"]) + float(moves["authority_mps4"]) * cos_bank
        at, rate, accel = self.index_of(frame, drag_rate, cos_bank)
        slope = drag_rate / rate
        radius_m = float(self.planet["radius_m"])
        flown_m = range_flown(
            self.track, radius_m, float(frame["lon_rad"]), float(frame["lat_rad"])
        )
        return Row(at, drag, slope, (drag_accel - slope * accel) / rate**2, flown_m)

    def rows(self) -> list[Row]:
        """All rows, the index ascending, evenly spaced in time."""
        log, choice = self.nominal.flown.log, self.choice
        felt = log["drag_mps2"] >= choice.drag_first_mps2
        if choice.index == "speed":
            felt &= np.arange(len(log)) > int(np.argmax(log["v_rel_mps"]))  # falling from there on
        frames = np.flatnonzero(felt)
        if frames.size < ROWS_MIN:
            raise DesignError(
                f"nominal_flight.drag_first_mps2 is {choice.drag_first_mps2:g}, allowed below the "
                f"largest drag of the nominal flight, {log['drag_mps2'].max():z.3g}"
            )
        chosen = np.linspace(frames[0], frames[-1], ROWS).round().astype(int)
        rows = sorted(self.row(log[i]) for i in np.unique(chosen))
        backward = choice.index != "time"
        if backward != (rows[0].range_m > rows[-1].range_m) or any(
            a.grid == b.grid for a, b in itertools.pairwise(rows)
        ):
            raise DesignError(f"the {choice.index} of the nominal flight does not fall throughout")
        return rows
