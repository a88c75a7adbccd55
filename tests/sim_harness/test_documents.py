"""TOML, JSON and CSV are read in one place: bounded, and refused in one sentence."""

import os
from pathlib import Path

import pytest

from flight_sw.errors import AeroshellError, DesignError, MissionError
from flight_sw.model.atmosphere import density
from sim_harness.mission import documents
from sim_harness.mission.documents import (
    DEPTH_MAX,
    DocumentError,
    json_of,
    quoted,
    read_csv,
    short,
    toml_of,
)
from sim_harness.mission.mission import SHIPPED, find
from sim_harness.world.assembly import world_of
from sim_harness.world.missions import load_mission
from tools.cli import main
from tools.gains.design import read_tree

CASES = Path(__file__).parent / "cases"
SENTENCE_MAX = 400  # characters, with a value of 200

HOSTILE = {
    "deep list": b"zz = " + b"[" * 600 + b"]" * 600,
    "deep table": b"zz = " + b"{a=" * 600 + b"1" + b"}" * 600,
    "dotted key": b"a" + b".a" * 100_000 + b" = 1",
    "quoted parts": b'"a"' + b' . "a"' * 100_000 + b" = 1",
    "header": b"[a" + b".a" * 100_000 + b"]",
    "long integer": b"[vehicle]\nmass_kg = " + b"9" * 5000,
    "long hexadecimal": b"[vehicle]\nmass_kg = 0x" + b"f" * 5000,
    "long fraction": b"[vehicle]\nmass_kg = 1." + b"1" * 5000,
    "no UTF-8": b'name = "\xff"',
    "UTF-16": "name = 'x'".encode("utf-16"),
    "no TOML": b"name",
    "open strings": b'a = "\\"' * 100_000,
    "too large": b"# " + b"x" * 1_000_001,
    "control characters": b'name = "\\u001b[2J\\n\\u0007"',
    "long name": b'name = "' + b"X" * 100_000 + b'"',
    "long key": b"k" * 100_000 + b" = 1",
    "a date for a number": b"[entry]\naltitude_km = 1979-05-27T07:32:00Z",
    "no tables": b"planet = 1\nvehicle = []\nentry = 1979-05-27\nwaypoints = 5\ndispersions = [1]",
    "infinity": b"[vehicle]\nmass_kg = inf",
}


def one_sentence(error: AeroshellError) -> str:
    text = str(error)
    for line in text.split("\n"):
        assert line.isprintable()
    assert len(text.split("\n", maxsplit=1)[0]) < SENTENCE_MAX
    return text


@pytest.mark.parametrize("raw", HOSTILE.values(), ids=HOSTILE)
def test_a_hostile_mission_is_refused_in_words_that_name_it(raw: bytes, tmp_path: Path) -> None:
    path = tmp_path / "hostile.toml"
    path.write_bytes(raw)
    with pytest.raises(MissionError) as refused:
        load_mission(path)
    assert one_sentence(refused.value).startswith("hostile.toml: ")


@pytest.mark.parametrize("name", ["nested.toml", "big-integer.toml"])
def test_the_kept_cases_are_refused_as_mission_and_as_design(
    name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    for command in ("fly", "gains"):
        assert main([command, str(CASES / name)]) == 1
        told = capsys.readouterr().err
        assert told.count("\n") == 1
        assert name in told
        assert len(told) < SENTENCE_MAX


def test_a_document_as_deep_as_allowed_is_read_and_one_deeper_is_not() -> None:
    depth = DEPTH_MAX - 1  # the document itself is a table
    assert toml_of(b"a = " + b"[" * depth + b"]" * depth)
    with pytest.raises(DocumentError, match="deep"):
        toml_of(b"a = " + b"[" * (depth + 2) + b"]" * (depth + 2))
    assert json_of(b"[" * DEPTH_MAX + b"]" * DEPTH_MAX)
    for deep in (DEPTH_MAX + 2, 100_000):
        with pytest.raises(DocumentError, match="deep"):
            json_of(b"[" * deep + b"]" * deep)


@pytest.mark.parametrize("raw", [b"1" * 5000, b"{", b"\xff", b"[1,]", b"", b" " * 3_000_001])
def test_what_is_no_json_is_refused(raw: bytes) -> None:
    with pytest.raises(DocumentError):
        json_of(raw)


def test_dots_and_brackets_in_texts_and_comments_are_no_depth() -> None:
    text = "# " + "[{." * 50 + "\n"
    text += 'a = "' + "[{." * 50 + "a.b" * 50 + '"\n'
    text += "b = '''" + "[\n" * 50 + "'''\n"
    text += 'c = """' + '[ "quoted" \\" \n' * 50 + '"""\n'
    text += "d = [" + "1.5, " * 500 + "]\n"
    tree = toml_of(text.encode())
    assert tree["a"].count("[") == 50
    assert len(tree["d"]) == 500


def test_every_shipped_document_is_read_as_the_library_reads_it() -> None:
    import tomllib

    for path in (*SHIPPED.glob("*.toml"), *SHIPPED.parents[1].glob("gains/*/design.toml")):
        assert toml_of(path.read_bytes()) == tomllib.loads(path.read_text())


def test_what_is_no_plain_file_is_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "design.toml")
    with pytest.raises(DesignError, match="is not a file"):
        read_tree(tmp_path / "design.toml")
    with pytest.raises(DesignError, match="cannot be read"):
        read_tree(tmp_path / ("x" * 300))
    with pytest.raises(MissionError, match="does not exist"):
        find("x" * 300 + ".toml")


def test_what_is_repeated_is_cut_and_holds_no_control_character() -> None:
    assert short("x" * 201) == "x" * 197 + "..."
    assert short("x" * 200) == "x" * 200
    assert quoted('a"\n\x1b\x9b\u202e\ud800') == '"a\\"\\n\\u001b\\u009b\\u202e\\ud800"'


@pytest.mark.parametrize(
    "setting",
    ["mass_kg=" + "9" * 100_000, "x" * 100_000 + "=1", "mass_kg=" + "x" * 100_000,
     "mass_kg=\x1b[2J", "mass_kg=1e999", "planet=1", "x=1", "=" * 1000],
)  # fmt: skip
def test_a_hostile_setting_is_one_short_sentence(
    setting: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["fly", "hyperion-1", "--set", setting]) == 1
    told = capsys.readouterr().err
    assert told.count("\n") == 1
    assert told[:-1].isprintable()
    assert len(told) < SENTENCE_MAX


def test_a_design_whose_laws_are_no_list_is_refused(own_mission: Path) -> None:
    design = own_mission.parent / "design.toml"
    for laws in ("5", '"lqy"', "[5]", "{a = 1}"):
        text = design.read_text()
        start = text.index("laws = ")
        design.write_text(text[:start] + f"laws = {laws}" + text[text.index("\n", start) :])
        assert main(["fly", str(own_mission)]) == 1


# --- CSV ---------------------------------------------------------------------------------------

ROWS = ["0,1.225,288", "20,0.0889,217", "40,0.004,250", "60,0.00031,247", "130,8e-09,470"]
TABLE = "altitude_km,density_kgpm3,temperature_k\n" + "\n".join(ROWS) + "\n"
AS_WRITTEN = {
    "byte-order mark": ("\ufeff" + TABLE).encode(),
    "CRLF": TABLE.replace("\n", "\r\n").encode(),
    "CR": TABLE.replace("\n", "\r").encode(),
    "blank lines at the end": (TABLE + "\r\n\r\n").encode(),
    "commas alone at the end": (TABLE + ",,\n , ,\n").encode(),
    "no line end": TABLE.rstrip("\n").encode(),
    "quoted": TABLE.replace("0.0889", '"0.0889"').replace("altitude_km", '"altitude_km"').encode(),
    "blanks": TABLE.replace(",", " , ").encode(),
}


@pytest.fixture
def own_mission(tmp_path: Path) -> Path:
    """A mission of one's own with its design beside it, and its air in air.csv."""
    text = (SHIPPED / "hyperion-1.toml").read_text()
    start = text.index("[atmosphere]")
    end = text.index("\n[", start)
    air = (
        '[atmosphere]\nmodel = "table"\ncsv = "air.csv"\n'
        "gas_constant_jpkgk = 287.053\nheat_capacity_ratio = 1.4\n"
    )
    text = text[:start] + air + text[end:]
    text = text.replace("\nlaw = ", '\ngains = "."\nlaw = ')
    mission = tmp_path / "own.toml"
    mission.write_text(text)
    design = (SHIPPED.parents[1] / "gains" / "hyperion-1" / "design.toml").read_text()
    start = design.index("mission = ")
    design = design[:start] + 'mission = "own.toml"' + design[design.index("\n", start) :]
    (tmp_path / "design.toml").write_text(design)
    (tmp_path / "air.csv").write_text(TABLE)
    return mission


@pytest.mark.parametrize("raw", AS_WRITTEN.values(), ids=AS_WRITTEN)
def test_a_table_as_spreadsheets_write_it_is_read(raw: bytes, own_mission: Path) -> None:
    plain = world_of(load_mission(own_mission))
    (own_mission.parent / "air.csv").write_bytes(raw)
    assert world_of(load_mission(own_mission)).tobytes() == plain.tobytes()


def test_the_kept_table_is_read(own_mission: Path) -> None:
    (own_mission.parent / "air.csv").write_bytes((CASES / "atmosphere-bom.csv").read_bytes())
    air = world_of(load_mission(own_mission))[0]["atmosphere"]
    assert int(air["n"]) == 7
    assert density(air, 20e3) == pytest.approx(0.0889, rel=1e-9)


@pytest.mark.parametrize(
    ("raw", "words"),
    [
        (TABLE.replace(",", ";").encode(), "separated by semicolons, allowed columns altitude_km"),
        (TABLE.replace("0.0889", '"0,0889"').encode(), 'is "0,0889", allowed a number'),
        (TABLE.replace("217", "217,5").encode(), "line 3 has 4 values, allowed 3"),
        (TABLE.replace("20,", "\n20,").encode(), "line 3 has 0 values, allowed 3"),
        (TABLE.replace("temperature_k", "density_kgpm3").encode(), "a column twice"),
        (b"", "header is"),
        (b"\xff\xfe" + TABLE.encode("utf-16-le"), "air.csv: is not UTF-8 text at byte 0"),
        (TABLE.encode() + b'"' + b"x" * 200_000, "air.csv: line"),
        (b"x" * 1_000_001, "air.csv: has more than 1,000,000 bytes"),
        (TABLE.replace("288", "9" * 5000).encode(), "temperature_k"),
        (TABLE.replace("288", "\x1b" * 500).encode(), "allowed a number"),
    ],
)  # fmt: skip
def test_a_table_that_is_none_is_refused_in_one_sentence(
    raw: bytes, words: str, own_mission: Path
) -> None:
    (own_mission.parent / "air.csv").write_bytes(raw)
    with pytest.raises(MissionError) as refused:
        load_mission(own_mission)
    assert words in one_sentence(refused.value)


def test_a_table_that_is_no_file_is_refused(tmp_path: Path) -> None:
    for name in ("air\0.csv", "x" * 300, "."):
        with pytest.raises(MissionError):
            read_csv(tmp_path / name)


# --- words -------------------------------------------------------------------------------------


def test_the_hint_of_a_missing_load_names_a_command_that_makes_it(
    own_mission: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["fly", str(own_mission), "--law", "nominal"]) == 1
    told = capsys.readouterr().err
    words = told.split("`")[1].split()
    assert words[:2] == ["aeroshell", "gains"]
    assert Path(words[2]) == own_mission.parent / "design.toml"
    assert main([*words[1:], "--law", "nominal"] if "--law" in words else words[1:]) == 0
    assert (own_mission.parent / "nominal.load").is_file()


def test_a_limit_that_is_infinite_is_called_so(
    own_mission: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    setting = "limits.heat_flux_max_kwpm2=inf"
    assert main(["fly", str(own_mission), "--law", "nominal", "--set", setting]) == 1
    assert "needs limits.heat_flux_max_kwpm2, which is infinite" in capsys.readouterr().err


def test_the_bounds_are_above_what_a_document_of_the_project_takes() -> None:
    largest = max(path.stat().st_size for path in SHIPPED.glob("*.toml"))
    assert documents.TOML_BYTES_MAX > 20 * largest
