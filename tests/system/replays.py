"""Recordings to replay: flown, or put together frame by frame with ticks where wanted."""

from pathlib import Path
from typing import Any

import numpy as np

from flight_sw import icd
from flight_sw.can.e2e import protect
from flight_sw.reception.requests import ARM
from flight_sw.records.dictionary import FRAME, TICK_ID
from sim_harness.replay.replayer import Replay, Replayer
from sim_harness.telemetry.reader import open_recording
from sim_harness.telemetry.recorder import Recorder
from sim_harness.telemetry.records import BUS_LOG
from tests.system.flights import Built, Computer, Frames, recorded, request, run_of
from tools.commands.fly import fly_and_record

DT_S = 0.02


def fly(made: Built, folder: Path, bus: str = "memory", **plan: Any) -> Path:
    """A recorded flight."""
    assert fly_and_record(run_of(made, folder / "a.load", bus, **plan), folder) == ""
    return folder / "flight.mcap"


def replay(path: Path) -> Replay:
    """How a recording's replay goes."""
    return Replayer(open_recording(path)).run()


def record(made: Built, rows: np.ndarray, path: Path, bus: str = "unix", **more: str) -> Path:
    """A recording of these rows and of the load that flew, as from a flight against the clock."""
    manifest = {"bus": bus, "pace": "realtime", "load_crc32": f"0x{made.image.crc32:08x}", **more}
    attached = {
        icd.DBC_PATH.name: ("text/plain", icd.DBC_PATH.read_bytes()),
        f"{made.law}.load": ("application/octet-stream", made.raw),
    }
    with Recorder(path, manifest, attached) as recorder:
        recorder.write_bus(rows)
        recorder.close("put together")
    return path


class Bench:
    """A bus put together by hand: what the computer is given, and what the harness logs."""

    def __init__(self, law: str, cycles: int, piece: str = "tracking") -> None:
        source = recorded(law, piece, cycles)
        self.made, self._navigation = source.made, source.navigation
        self.computer = Computer(self.made, armed=False)
        self._logged: list[tuple[float, Frames]] = []
        self._cycle = 0
        self.see(request(self.made, ARM))

    def begin_anew(self) -> None:
        """A computer that was asked for nothing yet, and an empty log."""
        self.computer = Computer(self.made, armed=False)
        self._logged.clear()

    def overtaken_cycle(self, frames: Frames, later: Frames) -> None:
        """Frames that close a cycle; before its answer others are logged that are heard later."""
        answers = self.computer.feed(frames)
        self.log(np.concatenate([frames, later, answers]))
        self.log(self.computer.feed(later))
        self._cycle += 1

    def see(self, frames: Frames) -> None:
        """Frames on the bus that the computer hears."""
        self.log(frames)
        self.log(self.computer.feed(frames))

    def log(self, frames: Frames) -> None:
        """Frames in the log alone."""
        self._logged.append((self._cycle * DT_S, frames))

    def cycle(self) -> None:
        """A navigation set, answered."""
        self.see(self.navigation())
        self._cycle += 1

    def navigation(self) -> Frames:
        """The cycle's navigation set."""
        return self._navigation[self._cycle]

    def tick(self) -> Frames:
        """What the computer answers when its clock closes a cycle."""
        frames = np.zeros(1, FRAME)
        frames["can_id"] = TICK_ID
        return self.computer.feed(frames)

    def late_cycle(self, ticks: int, before: int = 0) -> None:
        """A set that comes after so many ticks, the last in front of its frame `before`.

        The harness was late itself: its log has the whole set in front of all answers.
        """
        answers = [self.tick() for _ in range(ticks - 1)]
        frames = self.navigation()
        answers.append(self.computer.feed(frames[:before]))
        answers += [self.tick(), self.computer.feed(frames[before:])]
        self.log(np.concatenate([frames, *answers]))
        self._cycle += 1

    @property
    def rows(self) -> np.ndarray:
        """The log."""
        rows = np.zeros(sum(len(frames) for _, frames in self._logged), BUS_LOG)
        rows["t_s"] = np.repeat([t_s for t_s, _ in self._logged],
                                [len(frames) for _, frames in self._logged])  # fmt: skip
        rows["frame"] = np.concatenate([frames for _, frames in self._logged])
        return rows


def resealed(made: Built, frame: Any, flip: int) -> np.uint64:
    """A frame's word with some bits flipped and its checksum made right again."""
    slot = next(icd.slot(m.name) for m in icd.LAYOUT if m.can_id == frame["can_id"])
    counter = int(frame["data"]) >> 8 & 0xF
    return protect(made.load["codec"][0], slot, np.uint64(int(frame["data"]) ^ flip), counter)
