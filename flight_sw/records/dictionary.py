"""The data dictionary: the records that cross module boundaries, each field named with its unit.

A record is a C struct (aligned numpy dtype). Kernels take records by reference and read them as
`nav["alt_m"]`, which costs a load, allocates nothing and also runs uncompiled. Records that belong
to one module (limiter, codec, a law's design) are defined in that module.
"""

import numpy as np

FRAME = np.dtype(
    [
        ("can_id", "<u4"),  # identifier and the flag bits of struct can_frame
        ("dlc", "u1"),
        ("pad", "u1"),
        ("res0", "u1"),
        ("len8_dlc", "u1"),
        ("data", "<u8"),  # the eight data bytes as one little-endian word
    ]
)
"""struct can_frame of the Linux kernel, byte for byte."""

CAN_ID_MASK = 0x7FF  # classical 11-bit identifier
CAN_FLAGS_MASK = 0xE0000000  # extended, remote and error flags: never set in our frames
TICK_ID = 0xFFFFFFFF
"""Not a bus frame: the executive tells `minor_frame` that a cycle passed without a time message.
A frame with this identifier that arrives from the bus is dropped by the executive."""

RX_CAPACITY = 64  # frames handed to one call of minor_frame
TX_CAPACITY = 128  # frames one call can produce

NAV = np.dtype(
    [
        ("t_s", "f8"),  # mission time, zero at the entry state
        ("lon_rad", "f8"),
        ("lat_rad", "f8"),  # geocentric
        ("alt_m", "f8"),  # above the sphere of the planet's reference radius
        ("v_rel_mps", "f8"),  # relative to the rotating planet
        ("flight_path_angle_rad", "f8"),  # of v_rel, positive up
        ("heading_rad", "f8"),  # of v_rel, from north, positive to the east
        ("drag_mps2", "f8"),  # sensed
        ("lift_mps2", "f8"),  # sensed, magnitude
        ("bank_rad", "f8"),  # flown
        ("alpha_rad", "f8"),  # flown
        ("heat_flux_wpm2", "f8"),  # sensed at the stagnation point
    ],
    align=True,
)
"""One navigation fix, as received on the bus."""

GUIDANCE = np.dtype(
    [
        ("bank_cmd_rad", "f8"),  # wanted, before the command limits
        ("alpha_cmd_rad", "f8"),
        ("phase", "u4"),  # the law's own phase, see its module
        ("tracking", "u4"),  # 1 while a tracker acts on the heat flux or its like
        ("status", "u4"),  # status.*
        ("telemetry", "f8", (16,)),  # meaning: the law module's TELEMETRY
    ],
    align=True,
)
"""What a guidance law hands back each step."""
