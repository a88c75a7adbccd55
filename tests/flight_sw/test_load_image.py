"""Load images: what is refused, and in which words."""

import dataclasses
import re
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from flight_sw import guidance, icd
from flight_sw.errors import LoadError
from flight_sw.load_image import (
    HEADER,
    activate,
    body_spec,
    image_bytes,
    layout_hash,
    load_dtype,
    parse_image,
    read_image,
)
from flight_sw.records.fields import Field, RecordSpec
from tests.flight_sw.guidance.heat_flux.guidance_twin import values_of
from tests.system.flights import ALL_LAWS, MISSION, any_built, built

Path_ = tuple[str, ...]
DRAG = ["TM_DRAG_A", "TM_DRAG_B", "TM_DRAG_C", "TM_DRAG_D"]


def sealed(raw: bytes, **header: Any) -> bytes:
    """The image with header fields replaced and its CRC made right again."""
    found = np.frombuffer(raw, HEADER, 1).copy()
    for name, value in header.items():
        found[name] = value
    body = raw[HEADER.itemsize :]
    found["crc32"] = 0
    found["crc32"] = zlib.crc32(found.tobytes() + body)
    return found.tobytes() + body


def image_with(law: str, change: Callable[[Any], None]) -> bytes:
    """The law's image with its body changed and a right CRC."""
    raw = any_built(law).raw
    body = np.frombuffer(raw, body_spec(law).dtype, 1, HEADER.itemsize).copy()
    change(body[0])
    return sealed(raw[: HEADER.itemsize] + body.tobytes())


def fields_of(spec: RecordSpec, path: Path_ = ()) -> Iterator[tuple[Path_, Field]]:
    """All numbers of a record, at any depth."""
    for field in spec.fields:
        if field.record is not None:
            yield from fields_of(field.record, (*path, field.name))
        else:
            yield (*path, field.name), field


def put(path: Path_, value: float, index: int | None = None) -> Callable[[Any], None]:
    """Puts a value into a field of a body, or into one element of it."""

    def change(body: Any) -> None:
        *parents, leaf = path
        for name in parents:
            body = body[name]
        if index is None:
            body[leaf] = value
        else:
            body[leaf].reshape(-1)[index] = value

    return change


def refusal(raw: bytes) -> str:
    """The sentence with which an image is refused."""
    with pytest.raises(LoadError) as caught:
        parse_image(raw, "x.load")
    return str(caught.value)


def test_the_laws_of_these_tests_are_all_that_there_are() -> None:
    assert sorted(ALL_LAWS) == sorted(guidance.LAWS)


@pytest.mark.parametrize("law", ALL_LAWS)
def test_a_good_image_is_read_back_as_it_was_made(law: str, tmp_path: Path) -> None:
    made = any_built(law)
    path = tmp_path / "good.load"
    path.write_bytes(made.raw)
    image = read_image(path)
    assert (image.law, image.mission) == (law, made.mission.name)
    assert image_bytes(law, made.mission.name, image.body) == made.raw
    zeroed = made.raw[:100].replace(image.crc32.to_bytes(4, "little"), bytes(4))
    assert zlib.crc32(zeroed + made.raw[100:]) == image.crc32


@pytest.mark.parametrize("law", ALL_LAWS)
def test_the_active_load_is_read_only_and_carries_the_body(law: str) -> None:
    image = any_built(law).image
    load = activate(image)
    assert load.dtype == load_dtype(law)
    assert not load.flags.writeable
    carried, own = values_of(load[0]), values_of(image.body[0])
    for name in image.body.dtype.names or ():
        assert carried[name] == own[name]
    assert load["crc32"][0] == image.crc32


@pytest.mark.parametrize(("law", "messages"), [
    ("nominal", ["TM_NOMINAL_A", "TM_NOMINAL_B"]),
    ("lqy", ["TM_LQY", "TM_NOMINAL_A", "TM_NOMINAL_B"]),
    ("drag-state", DRAG),
    ("drag-observer", [*DRAG, "TM_OBSERVED"]),
    ("range-predictor", [*DRAG, "TM_OBSERVED", "TM_PREDICTED"]),
])  # fmt: skip
def test_telemetry_messages_are_found_by_their_names(law: str, messages: list[str]) -> None:
    wiring = activate(any_built(law).image)["wiring"][0]
    slots = wiring["slot"][: wiring["n_messages"]]
    assert sorted(icd.MESSAGES[slot] for slot in slots) == messages
    assert len({int(i) for i in wiring["value_index"] if i >= 0}) == 2 * len(messages)


@pytest.mark.parametrize(
    ("field", "value", "words"),
    [
        ("magic", b"AEROLOAT", "do not begin with AEROLOAD: not a load image"),
        ("version", 2, "format version is 2, this computer reads 1"),
        ("size", 17, r"\d+ bytes, its header says 121"),
        ("law", b"lqz", "law is 'lqz', this computer has nominal, lqy, [a-z, -]+"),
        ("layout", b"0" * 32, "layout is 0{32}, this computer's 'lqy' load has [0-9a-f]{32}"),
    ],
)
def test_a_header_field_that_is_wrong_is_named(field: str, value: Any, words: str) -> None:
    assert re.fullmatch(rf"x\.load: .*{words}", refusal(sealed(built("lqy").raw, **{field: value})))


@pytest.mark.parametrize("letter", ["m", "\u0436"])
def test_a_mission_name_fills_its_field_to_the_last_byte_and_not_one_beyond(letter: str) -> None:
    size = HEADER["mission"].itemsize
    name = letter * (size // len(letter.encode()))
    body = np.frombuffer(built("lqy").raw, body_spec("lqy").dtype, 1, HEADER.itemsize).copy()
    assert parse_image(image_bytes("lqy", name, body), "").mission == name
    words = f"mission name '{name}m' has {size + 1} bytes, a load's has at most {size}"
    with pytest.raises(LoadError, match=words):
        image_bytes("lqy", name + "m", body)


def test_an_image_of_one_law_does_not_pass_for_another() -> None:
    assert "layout is" in refusal(sealed(built("nominal").raw, law=b"lqy"))
    assert layout_hash("nominal") != layout_hash("lqy")


def test_a_body_of_another_size_is_refused_even_if_the_header_agrees() -> None:
    raw = built("lqy").raw[:-8]
    assert "body of" in refusal(sealed(raw, size=len(raw) - HEADER.itemsize))


@pytest.mark.parametrize("law", ALL_LAWS)
def test_every_bit_of_the_header_matters(law: str) -> None:
    raw = any_built(law).raw
    for bit in range(8 * HEADER.itemsize):
        wrong = bytearray(raw)
        wrong[bit // 8] ^= 1 << (bit % 8)
        assert refusal(bytes(wrong)).startswith("x.load: ")


def test_every_flipped_bit_of_the_body_is_seen_by_the_crc() -> None:
    raw = built("lqy").raw
    rng = np.random.default_rng(20260307)
    for bit in rng.choice(np.arange(8 * HEADER.itemsize, 8 * len(raw)), 400, replace=False):
        wrong = bytearray(raw)
        wrong[bit // 8] ^= 1 << (bit % 8)
        assert re.search("crc32 is 0x[0-9a-f]{8}, its header says 0x[0-9a-f]{8}", refusal(wrong))


def test_a_truncated_image_is_refused_at_every_length() -> None:
    raw = built("nominal").raw
    rng = np.random.default_rng(20260308)
    for length in [*range(HEADER.itemsize + 2), *rng.integers(0, len(raw), 200), len(raw) - 1]:
        text = refusal(raw[:length])
        assert f"{length} bytes" in text
        assert ("not a load image" in text) == (length < HEADER.itemsize)


def test_bytes_after_the_end_are_refused() -> None:
    raw = built("nominal").raw
    assert f"{len(raw) + 1} bytes, its header says {len(raw)}" in refusal(raw + b"\0")


@pytest.mark.parametrize("name", ["missing.load", "."])
def test_a_file_that_cannot_be_read_is_named(name: str, tmp_path: Path) -> None:
    with pytest.raises(LoadError, match=r": cannot be read \("):
        read_image(tmp_path / name)


def bad_values(field: Field) -> list[float]:
    """Values that the field's range excludes, as far as its kind holds them."""
    if field.kind == "f8":
        span = max(abs(field.low), abs(field.high))
        return [np.nan, np.inf, -np.inf, field.low - 1e-3 * span, field.high + 1e-3 * span]
    limits = np.iinfo(field.kind)
    return [v for v in (field.low - 1, field.high + 1) if limits.min <= v <= limits.max]


@pytest.mark.parametrize("law", ALL_LAWS)
def test_every_field_is_refused_out_of_its_range_and_named(law: str) -> None:
    spec = body_spec(law)
    seen = 0
    for path, field in fields_of(spec):
        size = int(np.prod(field.shape)) if field.shape else 1
        for value in bad_values(field):
            for index in {0, size - 1} if field.shape else {None}:
                text = refusal(image_with(law, put(path, value, index)))
                assert text.startswith(f"x.load: {law}.{'.'.join(path)}"), (
                    path,
                    value,
                    index,
                    text,
                )
                assert re.search(" is [^,]+, (allowed|must exceed) ", text)
                seen += 1
    assert seen > 250


@pytest.mark.parametrize(("law", "path"), [
    ("lqy", ("law", "inner_loop", "energy_jpkg")),
    ("nominal", ("atmosphere", "alt_m")),
    ("nominal", ("onboard", "vehicle", "aero", "alpha_rad")),
])  # fmt: skip
def test_a_grid_that_does_not_ascend_is_refused(law: str, path: Path_) -> None:
    def level(body: Any) -> None:
        for name in path:
            body = body[name]
        body[1] = body[0]

    text = refusal(image_with(law, level))
    assert re.search(rf"{re.escape('.'.join(path))}\[1\] is .*, must exceed \[0\]", text)


@pytest.mark.parametrize(
    ("path", "index", "value", "words"),
    [
        (("atmosphere", "bucket"), 700, 400, r"bucket\[700\] is 400, allowed 0 to \d+"),
        (("atmosphere", "bucket"), 3, 100, r"bucket\[3\] is 100, whose knot lies above"),
        (("atmosphere", "buckets_pm"), None, 0.5, "buckets_pm is 0.5, allowed to"),
        (("atmosphere", "n"), None, 50, r"bucket\[\d+\] is \d+, allowed 0 to 48"),
        (("alpha_limits", "low_rad"), None, 1.5, "low_rad is 1.5, allowed to 1.0472"),
        (("alpha_limits", "high_rad"), None, -1.0, "low_rad is 0, allowed to -1"),
        (("guidance_dt_s",), None, 0.04, "guidance_dt_s is 0.04, allowed dt_s times .* 0.02"),
    ],
)
def test_numbers_that_contradict_each_other_are_refused(
    path: Path_, index: int | None, value: float, words: str
) -> None:
    text = refusal(image_with("nominal", put(path, value, index)))
    assert re.search(rf"nominal\.{'.*' if len(path) > 1 else ''}{words}", text), text


def atmosphere_of(body: Any) -> tuple[Any, float]:
    """A body's atmosphere, and the height of its knots."""
    air = body["atmosphere"]
    return air, float(air["alt_m"][air["n"] - 1] - air["alt_m"][0])


@pytest.mark.parametrize(("beyond", "words"), [(0.5e-6, ""), (2e-6, "buckets_pm is .*, allowed")])
def test_buckets_span_the_whole_height_up_to_round_off(beyond: float, words: str) -> None:
    """The last bucket may not begin above the last knot: a share of 1e-6 is round-off."""

    def stretch(body: Any) -> None:
        air, span_m = atmosphere_of(body)
        air["buckets_pm"] = len(air["bucket"]) / span_m * (1.0 + beyond)
        air["bucket"] = 0  # leads every bucket to the first knot, which is none of this test's

    check(image_with("nominal", stretch), words)


@pytest.mark.parametrize(("above", "words"), [(0.5e-6, ""), (2e-6, "whose knot lies above")])
def test_a_bucket_leads_to_a_knot_at_or_below_it_up_to_round_off(above: float, words: str) -> None:
    def lift(body: Any) -> None:
        air, span_m = atmosphere_of(body)
        air["bucket"] = 0
        knot = 20
        at = int(np.ceil((air["alt_m"][knot] - air["alt_m"][0]) * air["buckets_pm"]))
        air["bucket"][at] = knot
        air["alt_m"][knot] = air["alt_m"][0] + at / air["buckets_pm"] + above * span_m

    check(image_with("nominal", lift), words)


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize(("off", "words"), [(0.5e-9, ""), (2e-9, "guidance_dt_s is 0.02, allowed")])
@pytest.mark.parametrize("divider", [1, 3])
def test_a_guidance_step_is_whole_minor_frames_up_to_round_off(
    divider: int, off: float, words: str, sign: float
) -> None:
    def shift(body: Any) -> None:
        body["guidance_divider"] = divider
        body["guidance_dt_s"] = divider * float(body["dt_s"]) * (1.0 + sign * off)

    words = words.replace("0.02", f"{divider * 0.02:g}")
    check(image_with("nominal", shift), words)


def check(raw: bytes, words: str) -> None:
    """An image is refused with these words, or read if there are none."""
    if words:
        assert re.search(words, refusal(raw))
    else:
        parse_image(raw, "x.load")


def test_a_body_is_checked_before_it_becomes_an_image() -> None:
    body = built("nominal").image.body.copy()
    body["law"]["scale_height_m"] = np.nan
    with pytest.raises(LoadError, match=r"nominal\.load\.law\.scale_height_m is nan, allowed 100"):
        image_bytes("nominal", MISSION, body)


@pytest.mark.parametrize(
    ("message", "law", "is_used"),
    [
        ("NAV_TIME", "nominal", True),
        ("FSW_COMMAND", "nominal", True),
        ("TM_LQY", "lqy", True),
        ("TM_LQY", "nominal", False),
        ("TM_DRAG_A", "lqy", False),
        ("TM_DRAG_A", "drag-state", True),
    ],
)
def test_a_changed_message_refuses_the_loads_of_those_laws_that_use_it(
    monkeypatch: pytest.MonkeyPatch, message: str, law: str, is_used: bool
) -> None:
    before, slot = layout_hash(law), icd.slot(message)

    def told(**changes: Any) -> str:
        changed = dataclasses.replace(icd.LAYOUT[slot], **changes)
        monkeypatch.setattr(icd, "LAYOUT", (*icd.LAYOUT[:slot], changed, *icd.LAYOUT[slot + 1 :]))
        return layout_hash(law)

    signal = icd.LAYOUT[slot].signals[0]
    others = icd.LAYOUT[slot].signals[1:]
    finer = dataclasses.replace(signal, scale=signal.scale / 2.0)
    said_otherwise = dataclasses.replace(signal, comment="in other words")
    assert (told(signals=(finer, *others)) != before) == is_used
    assert told(signals=(said_otherwise, *others), comment="also") == before
