"""The load: what the ground decided, as a file with a header that is believed only after checks.

A load image is HEADER followed by the bytes of the law's body record. The computer's `load` record
is that body with the codec built from the DBC at boot.
"""

import hashlib
import zlib
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from flight_sw import icd
from flight_sw.can.codec import CODEC, build_codec
from flight_sw.errors import LoadError
from flight_sw.guidance import LAWS, MARKER, law_module
from flight_sw.limits import AXIS_LIMITS
from flight_sw.model.atmosphere import ATMOSPHERE, BUCKETS, KNOTS_MAX
from flight_sw.model.onboard import ONBOARD
from flight_sw.modes import MODE_DESIGN
from flight_sw.reception.plausibility import GATES
from flight_sw.records.fields import Field, RecordSpec
from flight_sw.records.types_ import Record

BYTES_MAX = 4_000_000  # an image has some 100,000
MAGIC = b"AEROLOAD"
VERSION = 1

HEADER = np.dtype(
    [
        ("magic", "S8"),
        ("version", "<u4"),
        ("size", "<u4"),  # bytes of the body
        ("law", "S16"),
        ("mission", "S32"),
        ("layout", "S32"),  # first half of the layout hash, hexadecimal
        ("crc32", "<u4"),  # over the header with this field zero, then the body
        ("spare", "<u4"),
    ]
)

TELEMETRY_MESSAGES = 8
DIVIDER_MAX = 10_000  # minor frames per guidance step
BUCKET_TOLERANCE = 1e-6  # of the whole height, for round-off of a bucket's edge
TELEMETRY_PREFIX = "TM_"
HEALTH_SLOT = icd.slot("RX_HEALTH_A")

WIRING = np.dtype(
    [
        ("n_messages", "u4"),
        ("slot", "u4", (TELEMETRY_MESSAGES,)),  # messages that carry the law's telemetry
        ("value_index", "i4", (16,)),  # of each telemetry number, -1: on no message
        ("telemetry_divider", "u4"),  # minor frames from one telemetry to the next
        ("health_divider", "u4"),  # and from one report of the receiver's counters
    ],
    align=True,
)
"""How telemetry reaches the bus: names and cycle times are looked up in the DBC at boot."""


def _buckets_lead_to_knots(atmosphere: Record) -> str:
    """No bucket may lead past the interval that holds its lower edge."""
    n, alts_m = int(atmosphere["n"]), atmosphere["alt_m"]
    buckets = atmosphere["bucket"]
    per_m = float(atmosphere["buckets_pm"])
    span_m = float(alts_m[n - 1] - alts_m[0])
    if not per_m * span_m <= BUCKETS * (1.0 + BUCKET_TOLERANCE):
        return f"buckets_pm is {per_m:g}, allowed to {BUCKETS / span_m:g}"
    for i, interval in enumerate(buckets):
        if interval > n - 2:
            return f"bucket[{i}] is {interval}, allowed 0 to {n - 2}"
        edge_m = float(alts_m[0]) + i / per_m
        if alts_m[interval] > edge_m + BUCKET_TOLERANCE * span_m:
            return f"bucket[{i}] is {interval}, whose knot lies above the bucket"
    return ""


ATMOSPHERE_TABLE = RecordSpec.of(
    "atmosphere",
    ATMOSPHERE,
    Field("n", 2, KNOTS_MAX, kind="i8"),
    Field("buckets_pm", 1e-9, 1e3),
    Field("alt_m", -5e4, 1e8, shape=(KNOTS_MAX,), rows="n"),
    Field("ln_rho", shape=(KNOTS_MAX, 4)),
    Field("sound_speed_sq_m2ps2", 0.0, 2e9, shape=(KNOTS_MAX,)),
    Field("bucket", 0, KNOTS_MAX - 2, kind="i4", shape=(BUCKETS,)),
    rules=(_buckets_lead_to_knots,),
)
"""Ranges for the shared atmosphere record: no index in it may leave the knots in use."""


class LoadImage(NamedTuple):
    """A checked image: whose it is, its body, and the CRC that names it."""

    law: str
    mission: str
    crc32: int
    body: npt.NDArray[np.void]


def _whole_guidance_step(body: Record) -> str:
    step_s, expected_s = float(body["guidance_dt_s"]), body["dt_s"] * body["guidance_divider"]
    if abs(step_s - expected_s) <= 1e-9 * expected_s:
        return ""
    return f"guidance_dt_s is {step_s:g}, allowed dt_s times guidance_divider, {expected_s:g}"


def body_spec(law: str) -> RecordSpec:
    """Fields of the body of a law's load image."""
    return RecordSpec(
        f"{law}.load",
        Field(MARKER + law, 1, 1, "names the law in the record's type", kind="u4"),
        Field("dt_s", 1e-3, 1.0, "minor frame"),
        Field("guidance_divider", 1, DIVIDER_MAX, "minor frames per guidance step", kind="u4"),
        Field("guidance_dt_s", 1e-3, 1e4, "dt_s times the divider"),
        Field("onboard", record=ONBOARD),
        Field("atmosphere", record=ATMOSPHERE_TABLE),
        Field("bank_limits", record=AXIS_LIMITS),
        Field("alpha_limits", record=AXIS_LIMITS),
        Field("modes", record=MODE_DESIGN),
        Field("gates", record=GATES),
        Field("law", record=law_module(law).DESIGN),
        rules=(_whole_guidance_step,),
    )


def load_dtype(law: str) -> np.dtype[np.void]:
    """Record type of the running computer's load: codec and wiring, then the image's body."""
    body = body_spec(law).dtype
    own = [("codec", CODEC), ("wiring", WIRING), ("crc32", np.dtype("u4"))]
    return np.dtype(own + [(name, body[name]) for name in body.names or ()], align=True)


def messages_of(law: str) -> tuple[icd.Message, ...]:
    """The messages that a computer with this law hears or sends: no other family's telemetry."""
    names = set(law_module(law).TELEMETRY)
    return tuple(
        message
        for message in icd.LAYOUT
        if not message.name.startswith(TELEMETRY_PREFIX)
        or {signal.name for signal in message.signals} <= names
    )


def layout_hash(law: str) -> str:
    """Hash of the body's exact layout and of the messages that the law uses.

    Images of another build are refused; what is said in comments makes no difference.
    """

    def described(dtype: np.dtype[np.void]) -> str:
        if dtype.subdtype is not None:
            base, shape = dtype.subdtype
            return f"{described(base)}{shape}"
        if dtype.fields is None:
            return dtype.str
        inner = ",".join(
            f"{n}@{dtype.fields[n][1]}:{described(dtype.fields[n][0])}" for n in dtype.names or ()
        )
        return f"{{{inner}}}{dtype.itemsize}"

    messages = [message.on_the_wire for message in messages_of(law)]
    text = f"{law} {described(body_spec(law).dtype)} {messages}"
    return hashlib.sha256(text.encode()).hexdigest()[:32]


def _without_padding(body: npt.NDArray[np.void]) -> npt.NDArray[np.void]:
    """A copy with zeros between its fields: numpy's own copy leaves there what it found."""
    clean = np.zeros(1, body.dtype)
    clean[:] = body
    return clean


def image_bytes(law: str, mission: str, body: npt.NDArray[np.void]) -> bytes:
    """The file's bytes for a body record (shape (1,)), after checking it as the computer will."""
    body_spec(law).check(body[0], f"{law}.load")
    body = _without_padding(body)
    if len(mission.encode()) > HEADER["mission"].itemsize:
        raise LoadError(
            f"mission name '{mission}' has {len(mission.encode())} bytes, "
            f"a load's has at most {HEADER['mission'].itemsize}"
        )
    header = np.zeros(1, HEADER)
    header[0] = (
        MAGIC,
        VERSION,
        body.nbytes,
        law.encode(),
        mission.encode(),
        layout_hash(law).encode(),
        0,
        0,
    )
    header["crc32"] = zlib.crc32(header.tobytes() + body.tobytes())
    return header.tobytes() + body.tobytes()


def read_image(path: Path) -> LoadImage:
    """Read and check a load image; raises LoadError with what is wrong."""
    try:
        if path.exists() and not (path.is_file() or path.is_dir()):  # a pipe would be waited for
            raise LoadError(f"{path}: is not a file")
        with path.open("rb") as file:
            raw = file.read(BYTES_MAX + 1)
    except OSError as error:
        raise LoadError(f"{path}: cannot be read ({error.strerror})") from error
    if len(raw) > BYTES_MAX:
        raise LoadError(f"{path}: more than {BYTES_MAX:,} bytes: not a load image")
    return parse_image(raw, str(path))


def parse_image(raw: bytes, where: str) -> LoadImage:
    """Check the bytes of a load image: magic, version, CRC, law, layout, size, every value."""
    if len(raw) < HEADER.itemsize or raw[: len(MAGIC)] != MAGIC:
        raise LoadError(
            f"{where}: {len(raw)} bytes that do not begin with {MAGIC.decode()}: not a load image"
        )
    header = np.frombuffer(raw, HEADER, 1).copy()
    version, size = int(header["version"][0]), int(header["size"][0])
    if version != VERSION:
        raise LoadError(f"{where}: format version is {version}, this computer reads {VERSION}")
    if len(raw) != HEADER.itemsize + size:
        raise LoadError(f"{where}: {len(raw)} bytes, its header says {HEADER.itemsize + size}")
    crc32 = int(header["crc32"][0])
    header["crc32"] = 0
    found = zlib.crc32(header.tobytes() + raw[HEADER.itemsize :])
    if found != crc32:
        raise LoadError(f"{where}: crc32 is 0x{found:08x}, its header says 0x{crc32:08x}")
    law = header["law"][0].decode(errors="replace")
    if law not in LAWS:
        raise LoadError(f"{where}: law is {law!r}, this computer has {', '.join(LAWS)}")
    spec = body_spec(law)
    layout = header["layout"][0].decode(errors="replace")
    if layout != layout_hash(law):
        raise LoadError(
            f"{where}: layout is {layout if layout.isalnum() else repr(layout)}, "
            f"this computer's '{law}' load has {layout_hash(law)}"
        )
    if size != spec.dtype.itemsize:
        raise LoadError(f"{where}: body of {size} bytes, law '{law}' has {spec.dtype.itemsize}")
    mission = header["mission"][0].decode(errors="replace")
    if not mission.isprintable():
        raise LoadError(
            f"{where}: mission is {mission!r}, allowed a name without control characters"
        )
    body = np.frombuffer(raw, spec.dtype, 1, HEADER.itemsize).copy()
    spec.check(body[0], f"{where}: {law}")
    return LoadImage(law, mission, crc32, body)


def _cycle_ms(slot: int) -> int:
    return icd.LAYOUT[slot].cycle_ms


def _minor_frames(slot: int, dt_s: float) -> int:
    """Minor frames in a message's cycle time, at least one."""
    return max(round(_cycle_ms(slot) / 1e3 / dt_s), 1)


def _wire(load: npt.NDArray[np.void], law: str) -> None:
    names: tuple[str, ...] = law_module(law).TELEMETRY
    wiring = load["wiring"][0]
    wiring["value_index"] = -1
    slots = []
    for message in messages_of(law):
        if message.name.startswith(TELEMETRY_PREFIX):
            slots.append(icd.slot(message.name))
            for signal in message.signals:
                index = icd.value_index(message.name, signal.name)
                wiring["value_index"][names.index(signal.name)] = index
    wiring["n_messages"] = len(slots)
    dt_s = float(load["dt_s"][0])
    wiring["telemetry_divider"] = _minor_frames(min((*slots, HEALTH_SLOT), key=_cycle_ms), dt_s)
    wiring["health_divider"] = _minor_frames(HEALTH_SLOT, dt_s)
    wiring["slot"][: len(slots)] = slots


def activate(image: LoadImage) -> npt.NDArray[np.void]:
    """The read-only load record, shape (1,), that the minor frame takes."""
    load = np.zeros(1, load_dtype(image.law))
    load["codec"] = build_codec()
    load["crc32"] = image.crc32
    for name in image.body.dtype.names or ():
        load[name] = image.body[name]
    _wire(load, image.law)
    load.setflags(write=False)
    return load
