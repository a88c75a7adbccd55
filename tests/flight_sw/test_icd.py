"""The DBC is what the architecture says, and a broken one is refused with a sentence."""

from pathlib import Path

import cantools
import pytest

from flight_sw import icd
from flight_sw.errors import IcdError
from tests.flight_sw.bus_twin import dbc_text
from tools.icd import ICD_PATH, document

AGREED = {  # identifier: name, sender, cycle in ms
    0x010: ("FSW_COMMAND", "FSW", 20),
    0x020: ("NAV_POSITION", "HARNESS", 20),
    0x021: ("NAV_VERTICAL", "HARNESS", 20),
    0x022: ("NAV_DIRECTION", "HARNESS", 20),
    0x023: ("NAV_AERO", "HARNESS", 20),
    0x024: ("NAV_ATTITUDE", "HARNESS", 20),
    0x025: ("NAV_HEATING", "HARNESS", 20),
    0x02F: ("NAV_TIME", "HARNESS", 20),
    0x030: ("FSW_STATUS", "FSW", 20),
    0x040: ("FSW_BOOT", "FSW", 100),
    0x041: ("GROUND_REQUEST", "HARNESS", 0),
    0x042: ("FSW_LOAD", "FSW", 100),
    0x043: ("HARNESS_PRESENT", "HARNESS", 1000),
    0x050: ("TM_NOMINAL_A", "FSW", 100),
    0x051: ("TM_NOMINAL_B", "FSW", 100),
    0x052: ("TM_LQY", "FSW", 100),
    0x053: ("TM_SAG", "FSW", 100),
    0x054: ("TM_HEAT_FLUX", "FSW", 100),
    0x055: ("TM_MODEL", "FSW", 100),
    0x060: ("RX_HEALTH_A", "FSW", 1000),
    0x061: ("RX_HEALTH_B", "FSW", 1000),
    0x062: ("RX_HEALTH_C", "FSW", 1000),
}
SUFFIX_OF_UNIT = {
    "rad": "_rad", "m": "_m", "m/s": "_mps", "m/s^2": "_mps2", "m/s^3": "_mps3",
    "J/kg": "_jpkg", "W/m^2": "_wpm2", "W/(m^2 s)": "_wpm2ps", "s": "_s", "us": "_us",
    "rad s": "_rads",
}  # fmt: skip
UNITS = set(SUFFIX_OF_UNIT.values())


def test_messages_are_those_agreed() -> None:
    found = {m.can_id: (m.name, m.sender, m.cycle_ms) for m in icd.LAYOUT}
    assert {key: found[key] for key in AGREED} == AGREED


def test_slots_rise_with_the_identifier() -> None:
    identifiers = [message.can_id for message in icd.LAYOUT]
    assert identifiers == sorted(identifiers)
    assert [icd.slot(name) for name in icd.MESSAGES] == list(range(icd.N_MESSAGES))


def test_value_indexes_number_all_signals_through() -> None:
    indexes = [icd.value_index(m, s) for m in icd.MESSAGES for s in icd.signal_names(m)]
    assert indexes == list(range(icd.N_VALUES))


def test_cantools_loads_it_strictly_with_standard_attributes() -> None:
    database = cantools.database.load_file(icd.DBC_PATH, strict=True)
    assert len(database.messages) == icd.N_MESSAGES
    assert {node.name for node in database.nodes} == set(icd.NODES)
    request = database.get_message_by_name("GROUND_REQUEST")
    assert request.send_type == "event"
    assert database.get_message_by_name("NAV_TIME").cycle_time == 20


@pytest.mark.parametrize("message", icd.LAYOUT, ids=icd.MESSAGES)
def test_signals_say_their_unit_in_name_and_in_the_file(message: icd.Message) -> None:
    for signal in message.signals:
        if signal.unit:
            assert signal.name.endswith(SUFFIX_OF_UNIT[signal.unit]), signal.name
        else:
            assert not signal.name.endswith(tuple(UNITS)), signal.name
        assert signal.comment


@pytest.mark.parametrize("message", icd.LAYOUT, ids=icd.MESSAGES)
def test_ranges_fit_into_the_bits(message: icd.Message) -> None:
    for signal in message.signals:
        low = -(1 << signal.bits - 1) if signal.signed else 0
        high = low + (1 << signal.bits) - 1
        assert low <= round((signal.low - signal.offset) / signal.scale), signal.name
        assert round((signal.high - signal.offset) / signal.scale) <= high, signal.name


def test_no_two_messages_share_a_data_id_at_one_counter() -> None:
    for counter in range(icd.COUNTER_VALUES):
        ids = [message.data_ids[counter] for message in icd.LAYOUT]
        assert len(set(ids)) == len(ids), f"counter {counter}"


def test_an_unknown_message_is_refused_with_those_that_exist() -> None:
    with pytest.raises(IcdError, match=r"no message NAV_SPEED, it has FSW_COMMAND, NAV_POSITION"):
        icd.slot("NAV_SPEED")


def test_an_unknown_signal_is_refused_with_those_that_exist() -> None:
    with pytest.raises(IcdError, match="NAV_POSITION: no signal alt_m, it has lon_rad, lat_rad"):
        icd.value_index("NAV_POSITION", "alt_m")


@pytest.mark.parametrize(
    ("line", "instead", "sentence"),
    [
        ("NAV_TIME: 8 HARNESS", "NAV_TIME: 7 HARNESS", "NAV_TIME: allowed are 8 data bytes"),
        ("BO_ 47 NAV_TIME", "BO_ 2147483695 NAV_TIME", "and an 11-bit identifier"),
        ("NAV_TIME: 8 HARNESS", "NAV_TIME: 8 Vector__XXX", r"NAV_TIME: sent by \[\], allowed"),
        ("t_s : 12|40@1+", "t_s : 23|40@0+", "NAV_TIME.t_s: allowed are little-endian integers"),
        ("[0|1000000]", "[0|0]", "NAV_TIME.t_s: has no range"),
        ('E2EDataIds" BO_ 47 "', 'E2EDataIds" BO_ 47 "00', "allowed are 16 bytes in hexadecimal"),
        ('E2EDataIds" BO_ 47 "a', 'E2EDataIds" BO_ 47 "x', "allowed are 16 bytes in hexadecimal"),
        ('BA_ "GenMsgCycleTime" BO_ 47 20;', "", "NAV_TIME: neither has a cycle time nor"),
    ],
)
def test_a_dbc_that_the_codec_cannot_serve_is_refused(
    line: str, instead: str, sentence: str, tmp_path: Path
) -> None:
    text = dbc_text()
    ids = icd.layout("NAV_TIME").data_ids
    text = text.replace(bytes(ids).hex(), "a" + bytes(ids).hex()[1:])
    assert line in text
    changed = tmp_path / "changed.dbc"
    text = text.replace(line, instead)
    if "2147483695" in instead:
        text = text.replace(" 47 ", " 2147483695 ")
    changed.write_text(text)
    with pytest.raises(IcdError, match=sentence):
        icd.load_messages(changed)


def test_a_message_without_its_protection_is_refused(tmp_path: Path) -> None:
    changed = tmp_path / "changed.dbc"
    changed.write_text(dbc_text().replace("e2e_counter : 8|4@1+", "e2e_count : 8|4@1+", 1))
    with pytest.raises(IcdError, match="FSW_COMMAND: must carry e2e_crc at bits 0 to 7"):
        icd.load_messages(changed)


def test_the_document_is_what_the_dbc_says() -> None:
    assert ICD_PATH.read_text(encoding="utf-8") == document(), "run python -m tools.icd"
