"""What is damaged and who reads it: missions, designs, dispersions, load images, campaigns."""

import functools
import json
import random
import tempfile
import tomllib
import zlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from flight_sw.load_image import HEADER, body_spec, parse_image
from flight_sw.records.fields import RecordSpec
from sim_harness.flight.flight import ARM, FlightPlan, FlightRun, hand_over, memory_loop
from sim_harness.mission.dispersions import draw, fixed
from sim_harness.mission.documents import json_of
from sim_harness.mission.mission import GAINS, SHIPPED, Mission
from sim_harness.world.assembly import truth_of
from sim_harness.world.missions import load_mission
from tests.fuzz.children import Kind
from tests.fuzz.mutate import mutated
from tests.fuzz.trees import by_structure_or_bytes, toml_bytes
from tests.tools.made_campaigns import make
from tools.campaign.folder import read_manifest
from tools.campaign.job import job_of
from tools.campaign.plan import check_extremes, present_values, with_full_names
from tools.campaign.refly import refly
from tools.gains.image import checked_design, mission_path
from tools.report import tables
from tools.report.source import read_source

SETTINGS = {"altitude_km": 55.0, "speed_mps": 6500.0}  # of Hyperion-1: its law flies at once
CYCLES = 100


def _trees(*paths: Path) -> list[bytes]:
    """Files, and the same with tables and lists written in one line."""
    found = [path.read_bytes() for path in paths]
    return found + [toml_bytes(tomllib.loads(raw.decode())) for raw in found]


def _toml(raw: bytes) -> Any:
    return tomllib.loads(raw.decode())


TOML_MUTATE = by_structure_or_bytes(_toml, toml_bytes)


def _read_mission(data: bytes, folder: Path) -> None:
    path = folder / "mission.toml"
    path.write_bytes(data)
    truth_of(load_mission(path))


def _read_design(data: bytes, folder: Path) -> None:
    path = folder / "design.toml"
    path.write_bytes(data)
    design = checked_design(path)
    load_mission(mission_path(design, path))


SET = {
    "sampling": "latin-hypercube",
    "vehicle.mass_kg": {"model": "uniform", "low": -10.0, "high": 10.0},
    "entry.flight_path_angle_deg": {"model": "normal", "sigma": 0.1, "cut_sigmas": 2.0},
    "planet.rotation_radps": {"model": "fixed", "value": 0.0},
    "correlations": [
        {"keys": ["vehicle.mass_kg", "entry.flight_path_angle_deg"], "coefficient": 0.5}
    ],
}


@functools.cache
def _job() -> Any:
    return job_of("hyperion-1", "nominal", [], None)[0]


def _read_dispersions(data: bytes, folder: Path) -> None:
    path = folder / "mission.toml"
    path.write_bytes(data)
    for name, found in load_mission(path).dispersions.items():
        whole = with_full_names(found, _job(), f"dispersions.{name}")
        present = present_values(_job(), whole.keys)
        check_extremes(_job(), whole, present, name)
        fixed(whole)
        draw(whole, present, 5, 1, name)


def _mission_with_sets() -> list[bytes]:
    tree = tomllib.loads((SHIPPED / "hyperion-1.toml").read_text())
    rest = {k: v for k, v in tree.items() if k not in ("dispersions", "requirements")}
    whole = toml_bytes(rest)
    return [whole + toml_bytes({"dispersions": {"a": SET}})]


def _mutate_set(data: bytes, rng: random.Random, others: Sequence[bytes]) -> bytes:
    mission, mark, sets = data.partition(b'"dispersions" = ')
    return mission + TOML_MUTATE(mark + sets, rng, [mark + sets])


def _leaves(spec: RecordSpec, body: Any) -> list[tuple[Any, Any]]:
    found = []
    for field in spec.fields:
        if field.record is not None:
            found += _leaves(field.record, body[field.name])
        else:
            found.append((field, body))
    return found


def sealed(raw: bytes) -> bytes:
    """An image with its checksum made right again."""
    header = np.frombuffer(raw, HEADER, 1).copy()
    header["crc32"] = 0
    header["crc32"] = zlib.crc32(header.tobytes() + raw[HEADER.itemsize :])
    return header.tobytes() + raw[HEADER.itemsize :]


def _mutate_load(data: bytes, rng: random.Random, others: Sequence[bytes]) -> bytes:
    """Other values, most within their ranges, or other bytes; mostly with a right checksum."""
    if rng.random() < 0.4:
        raw = mutated(data, rng, others)
        return sealed(raw) if len(raw) >= HEADER.itemsize and rng.random() < 0.7 else raw
    law = parse_image(data, "").law
    body = np.frombuffer(data, body_spec(law).dtype, 1, HEADER.itemsize).copy()
    for field, record in rng.sample(_leaves(body_spec(law), body[0]), rng.randint(1, 6)):
        values = record[field.name]
        ends = (field.low, field.high, 0.0, rng.uniform(field.low, field.high))
        wanted = rng.choice((*ends, *ends, np.nan, np.inf))
        with np.errstate(all="ignore"):
            if np.ndim(values):
                values.reshape(-1)[rng.randrange(values.size)] = (
                    wanted if values.dtype.kind == "f" else 1
                )
            elif np.isfinite(wanted) and abs(wanted) < 2**31:
                record[field.name] = wanted
    return sealed(data[: HEADER.itemsize] + body.tobytes())


@functools.cache
def _missions() -> dict[str, Mission]:
    return {
        "hyperion-1": load_mission("hyperion-1", SETTINGS),
        "mars-lander": load_mission("mars-lander", {"altitude_km": 40.0}),
    }


def _fly_load(data: bytes, folder: Path) -> None:
    image = parse_image(data, "a.load")
    mission = _missions().get(image.mission, _missions()["hyperion-1"])
    plan = FlightPlan(mission, image.law, data, folder / "a.load", "memory", recorded=False)
    run = FlightRun(plan, [])
    chunk, state, _ = memory_loop(run, timed_every=0)
    armed = run.request(ARM)
    hand_over(run.load, state, armed, len(armed), run.tx)
    chunk(CYCLES)


PACKED = b"\n--- file "


def packed(folder: Path) -> bytes:
    """A folder as one piece of bytes."""
    files = sorted(path for path in folder.iterdir() if path.is_file())
    return b"".join(PACKED + p.name.encode() + b"\n" + p.read_bytes() for p in files)


def unpacked(data: bytes) -> dict[str, bytes]:
    """The files of a folder by their names."""
    found = {}
    for piece in data.split(PACKED)[1:]:
        name, _, content = piece.partition(b"\n")
        found[name.decode(errors="replace").replace("/", "_").strip(".\0") or "x"] = content
    return found


JSON_MUTATE = by_structure_or_bytes(json_of, lambda tree: json.dumps(tree).encode())


def _mutate_campaign(data: bytes, rng: random.Random, others: Sequence[bytes]) -> bytes:
    files = unpacked(data)
    name = rng.choice(sorted(files))
    mutate = JSON_MUTATE if name.endswith(".json") else mutated
    if name.endswith(".jsonl") and rng.random() < 0.5:
        lines = files[name].split(b"\n")
        at = rng.randrange(len(lines))
        lines[at] = JSON_MUTATE(lines[at] or b"{}", rng, lines)
        files[name] = b"\n".join(lines)
    else:
        files[name] = mutate(files[name], rng, list(files.values()))
    if rng.random() < 0.05:
        del files[rng.choice(sorted(files))]
    return b"".join(PACKED + n.encode() + b"\n" + content for n, content in files.items())


@functools.cache
def _campaigns() -> list[bytes]:
    """A finished campaign, and one that is still being flown."""
    with tempfile.TemporaryDirectory() as place:
        folder = make(Path(place, "made"), 6)
        (folder / "lqy.load").write_bytes((GAINS / "hyperion-1" / "lqy.load").read_bytes())
        (folder / "mission.toml").write_bytes((SHIPPED / "hyperion-1.toml").read_bytes())
        finished = packed(folder)
        import pyarrow.parquet as pq

        rows = pq.read_table(folder / "results.parquet").to_pylist()[:4]
        (folder / "results.parquet").unlink()
        (folder / "profiles.parquet").unlink()
        (folder / "flights.jsonl").write_text("".join(json.dumps(row) + "\n" for row in rows))
        return [finished, packed(folder)]


def _read_campaign(data: bytes, folder: Path) -> None:
    from flight_sw.errors import AeroshellError

    for name, content in unpacked(data).items():
        (folder / name[:100]).write_bytes(content)
    refusals = []
    for look in (_report, _fly_again):
        try:
            look(folder)
        except AeroshellError as error:
            refusals.append(error)
    if refusals:
        raise refusals[0]


def _report(folder: Path) -> None:
    source = read_source(folder)
    source.counts()
    source.varied()
    source.mission()
    varying = tables.varying_metrics([source])
    names = tables.main_metrics([source], varying)
    tables.head_rows([source])
    tables.commands([source])
    tables.dispersion_rows(source)
    tables.requirement_rows(source)
    tables.class_rows([source])
    tables.spread_rows(source, varying)
    tables.constants([source], varying)
    tables.worst_by_requirement(source)
    tables.extremes(source, names)
    tables.not_flown(source)


def _fly_again(folder: Path) -> None:
    read_manifest(folder)
    refly(folder, 2)


MISSIONS = Kind(lambda: _trees(*sorted(SHIPPED.glob("*.toml"))), _read_mission, TOML_MUTATE)
DESIGNS = Kind(lambda: _trees(*sorted(GAINS.glob("*/design.toml"))), _read_design, TOML_MUTATE)
DISPERSIONS = Kind(_mission_with_sets, _read_dispersions, _mutate_set)
LOADS = Kind(
    lambda: [path.read_bytes() for path in sorted(GAINS.glob("*/*.load"))], _fly_load, _mutate_load
)
CAMPAIGNS = Kind(_campaigns, _read_campaign, _mutate_campaign)
NAMES = ("MISSIONS", "DESIGNS", "DISPERSIONS", "LOADS", "CAMPAIGNS")
