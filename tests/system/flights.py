"""Loads, pieces of flight and recorded frames that tests of the flight computer share.

A piece is Hyperion-1 started late: at a state near its heat-flux peak, on the heat-flux limit, or
where the load limit takes over, so that a few seconds show what takes minutes from entry.
"""

import functools
import hashlib
from pathlib import Path
from typing import Any, NamedTuple

import cantools
import numpy as np
import numpy.typing as npt

from flight_sw import icd
from flight_sw.computer import new_state
from flight_sw.load_image import LoadImage, activate, image_bytes, parse_image
from flight_sw.reception.requests import ARM
from flight_sw.records.dictionary import FRAME, RX_CAPACITY, TX_CAPACITY
from flight_sw.runtime.histogram import HISTOGRAM
from flight_sw.runtime.identity import ALONE
from sim_harness.flight.flight import FlightPlan, FlightRun, fly_memory, hand_over
from sim_harness.flight.loop import HARNESS, fly_in_memory
from sim_harness.flight.port import FLYING_HERE, put_presence, put_request
from sim_harness.mission.mission import Mission
from sim_harness.telemetry.logs import BUS, TRUTHS, Logs
from sim_harness.telemetry.records import BUS_LOG
from sim_harness.world.missions import load_mission
from sim_harness.world.records import TRUTH
from tools.gains.body import fill_body
from tools.gains.design import Design, design_of, read_tree

ROOT = Path(__file__).resolve().parents[2]
MISSION = "hyperion-1"
DESIGN_PATH = ROOT / "gains" / MISSION / "design.toml"
LAWS = ("nominal", "lqy", "sag", "integrated")
FLOWN = ("lqy", "integrated")
"""Laws for tests that compile a loop each: between them they hold the kernels of all four."""

MARS_LAWS = ("drag-state", "drag-observer", "range-predictor")
PLANNED_LAWS = ("planned-lqr",)
ALL_LAWS = (*LAWS, *MARS_LAWS, *PLANNED_LAWS)

PIECES: dict[str, dict[str, float | str]] = {
    "entry": {},
    "minute": {"end.time_max_s": 60.0},
    "peak": {
        "entry.altitude_km": 68.85,
        "entry.speed_mps": 7500.0,
        "entry.flight_path_angle_deg": -0.225,
        "entry.angle_of_attack_deg": 45.0,
    },
    "tracking": {
        "entry.altitude_km": 58.48,
        "entry.speed_mps": 6033.0,
        "entry.flight_path_angle_deg": -0.4,
        "entry.angle_of_attack_deg": 45.0,
    },
    "hand-over": {
        "entry.altitude_km": 53.6,
        "entry.speed_mps": 5400.0,
        "entry.flight_path_angle_deg": -0.5,
        "entry.angle_of_attack_deg": 45.0,
    },
}
"""Entry states: overrides of the mission."""

DRAG_FELT: dict[str, float | str] = {
    "entry.altitude_km": 70.37,
    "entry.speed_mps": 6767.6,
    "entry.flight_path_angle_deg": -11.48,
    "entry.longitude_deg": 3.975,
}
"""The lander of Mars a second before its drag starts the tracking."""

ON_THE_PLAN = {
    "entry.altitude_km": 74.15277509750426,
    "entry.speed_mps": 7338.986081259216,
    "entry.flight_path_angle_deg": -0.33008001,
    "entry.heading_deg": 101.54632808,
    "entry.latitude_deg": -4.11779748,
    "entry.longitude_deg": 23.13659933,
    "entry.bank_deg": 88.0,
}
"""The winged vehicle on the plan of its load, where errors are fed back."""

FSW = icd.NODES.index("FSW")
NAV_FRAMES = 7  # a navigation set: six messages and the time

Frames = npt.NDArray[np.void]


class Built(NamedTuple):
    """A mission and the load that is designed for it."""

    mission: Mission
    law: str
    raw: bytes
    image: LoadImage
    load: npt.NDArray[np.void]


@functools.cache
def design() -> Design:
    """The shipped design of Hyperion-1."""
    return design_of(read_tree(DESIGN_PATH), DESIGN_PATH.name)


@functools.cache
def built(law: str, piece: str = "entry", heat_flux_max_kwpm2: float = 1700.0) -> Built:
    """Mission and load of one law, started as a piece says."""
    overrides = {**PIECES[piece], "heat_flux_max_kwpm2": heat_flux_max_kwpm2}
    mission = load_mission(MISSION, overrides)
    raw = image_bytes(law, MISSION, fill_body(law, design(), mission).body)
    image = parse_image(raw, law)
    return Built(mission, law, raw, image, activate(image))


@functools.cache
def shipped(law: str, mission: str = "mars-lander", seconds: float = 0.0) -> Built:
    """A mission with its committed load; for so many seconds from `DRAG_FELT`, or from entry."""
    overrides = {**DRAG_FELT, "end.time_max_s": seconds} if seconds else {}
    flown = load_mission(mission, overrides)
    raw = (flown.gains_folder / f"{law}.load").read_bytes()
    image = parse_image(raw, law)
    return Built(flown, law, raw, image, activate(image))


@functools.cache
def _planned(law: str, steps_a_frame: int, iterations_max: int, **overrides: float) -> Built:
    """The winged vehicle's committed load with so much work in a minor frame, and for a job."""
    flown = load_mission("rlv", overrides)
    shipped_image = parse_image((flown.gains_folder / f"{law}.load").read_bytes(), law)
    body = shipped_image.body.copy()
    body["law"]["planner"]["steps_a_frame_count"] = steps_a_frame
    body["law"]["planner"]["iterations_max"] = iterations_max
    raw = image_bytes(law, shipped_image.mission, body)
    image = parse_image(raw, law)
    return Built(flown, law, raw, image, activate(image))


def on_the_plan(law: str, seconds: float) -> Built:
    """The winged vehicle so many seconds from `ON_THE_PLAN`: its job ends in them, and is flown."""
    return _planned(law, 40, 1, **ON_THE_PLAN, **{"end.time_max_s": seconds})


def planning(law: str, seconds: float) -> Built:
    """The same from its entry, in the middle of a job of one step a minor frame."""
    return _planned(law, 1, 20, **{"end.time_max_s": seconds})


def any_built(law: str, seconds: float = 0.0) -> Built:
    """A mission and load of any law: the whole flight, or some seconds with its law at work."""
    if law in MARS_LAWS:
        return shipped(law, seconds=seconds)
    if law in PLANNED_LAWS:
        return on_the_plan(law, seconds) if seconds else shipped(law, "rlv")
    if not seconds:
        return built(law)
    made = built(law, "tracking")
    end = made.mission.end.model_copy(update={"time_max_s": seconds})
    return made._replace(mission=made.mission.model_copy(update={"end": end}))


def run_of(made: Built, path: Path, bus: str = "memory", **plan: Any) -> FlightRun:
    """A flight ready to be flown; its load is written to `path` for a flight computer to read."""
    path.write_bytes(made.raw)
    return FlightRun(FlightPlan(made.mission, made.law, made.raw, path, bus, **plan), [])


def flown(made: Built, path: Path) -> FlightRun:
    """A whole flight in memory, without a recording."""
    run = run_of(made, path, recorded=False)
    fly_memory(run)
    return run


class Computer:
    """A flight computer whose frames are handed over one call at a time."""

    def __init__(self, made: Built, armed: bool = True) -> None:
        self.made = made
        self.state = new_state(made.law)
        self.tx = np.zeros(TX_CAPACITY, FRAME)
        if armed:
            self.feed(request(made, ARM))

    def feed(self, frames: Frames, most: int = RX_CAPACITY) -> Frames:
        """Hand frames over, at most so many a call; everything that was answered."""
        answers = [np.zeros(0, FRAME)]
        for start in range(0, len(frames), most):
            part = np.ascontiguousarray(frames[start : start + most])
            answers.append(self.call(part))
        return np.concatenate(answers)

    def call(self, frames: Frames) -> Frames:
        """One call of the minor frame."""
        n = hand_over(self.made.load, self.state, frames, len(frames), self.tx)
        return self.tx[:n].copy()

    @property
    def counted(self) -> dict[str, int]:
        """Verdicts on frames so far that are not zero."""
        from sim_harness.flight.flight import verdicts

        return {k: n for k, n in verdicts(self.state["rx"]["counted"][0]).items() if n}


class World:
    """The harness's side of a flight in memory, flown in steps with every frame kept."""

    def __init__(self, made: Built, cycles: int) -> None:
        self.made = made
        self.run = FlightRun(
            FlightPlan(made.mission, made.law, made.raw, Path(made.law), "memory", recorded=False),
            [],
        )
        self.harness = self.run.harness
        self.step_time = np.zeros(1, HISTOGRAM)
        self.logs = Logs(
            np.zeros(cycles + TX_CAPACITY, FRAME),
            np.zeros((cycles + 20) * 16, BUS_LOG),
            np.zeros(cycles + 1, TRUTH),
        )
        self.harness["truth_divider"] = 1
        self.rx = np.zeros(RX_CAPACITY, FRAME)
        self.tx = np.zeros(TX_CAPACITY, FRAME)

    def fly(self, computer: Computer, cycles: int) -> int:
        """Fly on by so many cycles with this computer's state; the outcome."""
        return int(
            fly_in_memory(
                self.harness, self.made.load, computer.state, self.step_time, self.rx, self.tx,
                self.logs, cycles,
            )
        )  # fmt: skip

    @property
    def frames(self) -> Frames:
        """Every frame so far, in bus order."""
        return self.logs.bus[: int(self.harness["written"][0, BUS])]["frame"]

    @property
    def truth(self) -> Frames:
        """The truth at the start of every cycle so far."""
        return self.logs.truth[: int(self.harness["written"][0, TRUTHS])]


class Recorded(NamedTuple):
    """What went over the bus of a flight in memory."""

    made: Built
    navigation: Frames  # (cycles, NAV_FRAMES)
    answers: Frames  # all frames of the flight computer in order
    truth: Frames  # at the start of each cycle


def is_from_computer(frames: Frames) -> npt.NDArray[np.bool_]:
    """Which frames carry identifiers that the flight computer sends."""
    ids = [m.can_id for m in icd.LAYOUT if m.sender == "FSW"]
    return np.isin(frames["can_id"], ids)


@functools.cache
def recorded(law: str, piece: str, cycles: int) -> Recorded:
    """The frames of the first cycles of a piece, flown closed loop."""
    made = built(law, piece)
    world = World(made, cycles)
    world.fly(Computer(made), cycles)
    frames = world.frames.copy()
    answers = is_from_computer(frames)
    navigation = frames[~answers].reshape(-1, NAV_FRAMES)
    return Recorded(made, navigation, frames[answers], world.truth.copy())


def request(
    made: Built, code: int, computer: int = ALONE, harness: int = ALONE, counter: int = 0
) -> Frames:
    """One ground request frame, from a harness to a computer."""
    side = np.zeros(1, HARNESS)
    side["codec"] = made.load["codec"]
    port = side["port"]
    port["request_counter"], port["computer"], port["harness"] = counter, computer, harness
    frames = np.zeros(1, FRAME)
    put_request(side["codec"][0], port[0], code, frames)
    return frames


def presence(made: Built, computer: int, harness: int = ALONE, counter: int = 0) -> Frames:
    """One word of a harness that it is here, and of the computer that it flies with."""
    side = np.zeros(1, HARNESS)
    side["codec"] = made.load["codec"]
    port = side["port"]
    port["present_counter"], port["computer"], port["harness"] = counter, computer, harness
    frames = np.zeros(1, FRAME)
    put_presence(side["codec"][0], port[0], FLYING_HERE, frames)
    return frames


def commands(frames: Frames) -> Frames:
    """The command frames among frames."""
    return frames[frames["can_id"] == icd.layout("FSW_COMMAND").can_id]


def sha256(frames: Frames) -> str:
    """Hash over frames, byte for byte."""
    return hashlib.sha256(frames.tobytes()).hexdigest()


def cantools_values(frames: Frames, message: str) -> list[dict[str, Any]]:
    """Frames of one message as cantools decodes them."""
    database = cantools.database.load_file(Path(icd.DBC_PATH))
    can_id = icd.layout(message).can_id
    return [
        database.decode_message(can_id, int(f["data"]).to_bytes(8, "little"), decode_choices=False)
        for f in frames[frames["can_id"] == can_id]
    ]
