"""What a recording is made of, as the harness hands it over: bus frames and lines of the log."""

from enum import IntEnum
from typing import NamedTuple

import numpy as np

from flight_sw.records.dictionary import FRAME

RECORDING_NAME = "flight.mcap"  # in the folder of a flight

TIME_MAX_S = 1e9  # of a mission

BUS_LOG = np.dtype([("t_s", "f8"), ("frame", FRAME)])
"""One CAN frame in bus order; the frames of one minor frame share its mission time."""


class LogLevel(IntEnum):
    """Severity of a line of the log, numbered as foxglove.Log numbers it."""

    DEBUG = 1
    INFO = 2
    WARNING = 3
    ERROR = 4
    FATAL = 5


class LogLine(NamedTuple):
    """An event of the flight, in words."""

    t_s: float
    level: LogLevel
    text: str
