"""Reads the folder of a campaign: every file of it checked before it is used.

Whoever made the folder may have damaged it. A file that is not what it should be is told in one
sentence that names it; a line of the journal that is no whole result is a flight not flown. No name
in a file becomes a path, and what lies there under a name of ours must be a plain file.
"""

import math
import stat
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
import pyarrow as pa
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from flight_sw.errors import AeroshellError, FlightError
from flight_sw.guidance import LAWS
from sim_harness.flight.outcomes import CLASSES, NUMERICAL
from sim_harness.mission.dispersion_keys import Requirement
from sim_harness.mission.documents import DocumentError, content_of, json_of, read_json, short
from sim_harness.mission.quantities import plain
from tools.campaign.columns import TEXTS, read_columns

MANIFEST = "campaign.json"
SAMPLES = "samples.parquet"
RESULTS = "results.parquet"
PROFILES = "profiles.parquet"
SPOOL = "profiles.bin"
VERDICT = "verdict.json"
JOURNAL = "flights.jsonl"
LOCK = ".lock"
LOAD = "{law}.load"
MISSION = "mission.toml"
REPORTS = ("report.html", "comparison.html")
FLIGHTS_MAX = 10_000_000
SEED_MAX = (1 << 63) - 1
LOAD_BYTES_MAX = 4_000_000
LINE_BYTES_MAX = 65_536  # of the journal; a flight's result takes 2,000
VALUES_MAX = 1000  # of a result
GROUP_ROWS = 1024
INTEGER_MAX = (1 << 63) - 1


class _Told(BaseModel):
    model_config = ConfigDict(strict=True, extra="allow")


class Identity(_Told):
    """What two campaigns must share to be one, as far as a reader needs it."""

    mission: str
    case: str | None = None
    law: Literal[tuple(LAWS)]  # type: ignore[valid-type]
    load_crc32: str
    dispersions: str
    n: int = Field(ge=1, le=FLIGHTS_MAX)
    seed: int = Field(ge=0, le=SEED_MAX)
    samples_hash: str
    sources_hash: str = ""


class KeptJob(_Told):
    """The job, its load aside."""

    mission_tree: dict[str, Any]
    told_tree: dict[str, Any]
    design_tree: dict[str, Any]
    mission_file: str
    law: Literal[tuple(LAWS)]  # type: ignore[valid-type]
    case: str | None = None
    load_file: str


class Manifest(_Told):
    """campaign.json."""

    identity: Identity
    state: Literal["flying", "flown", "done"]
    title: str = ""
    command: str = ""
    version: str = ""
    requirements: list[dict[str, Any]] = []
    told_to_both: list[str] = []
    job: KeptJob
    verdict: dict[str, Any] | None = None
    flown: dict[str, Any] | None = None


def own_names(law: str) -> tuple[str, ...]:
    """What a campaign's folder holds."""
    names = (
        MANIFEST, SAMPLES, RESULTS, PROFILES, SPOOL, VERDICT, JOURNAL, LOCK, MISSION, *REPORTS,
        LOAD.format(law=law),
    )  # fmt: skip
    return (*names, *(f"{name}.new" for name in names))


def check_plain(folder: Path, law: str = "") -> None:
    """Refuse links and devices under our names: what is written would go elsewhere."""
    for name in own_names(law):
        try:
            mode = (folder / name).lstat().st_mode
        except FileNotFoundError:
            continue
        except OSError as error:
            raise FlightError(f"{folder}: cannot be read ({error.strerror})") from None
        if not stat.S_ISREG(mode):
            raise FlightError(f"{folder / name}: is no plain file")


def decoded(value: Any) -> Any:
    """The inverse of `plan.encoded`."""
    if isinstance(value, dict):
        return {key: decoded(item) for key, item in value.items()}
    if isinstance(value, list):
        return [decoded(item) for item in value]
    return float(value) if value in ("inf", "-inf", "nan") else value


def read_manifest(folder: Path) -> dict[str, Any]:
    """campaign.json of a folder, checked."""
    path = folder / MANIFEST
    if not path.exists():
        raise FlightError(f"{folder}: no campaign there (it holds no {MANIFEST})")
    told = read_json(path, FlightError)
    if not isinstance(told, dict):
        raise FlightError(f"{path}: is {plain(told)}: not a campaign's manifest")
    told["job"] = decoded(told.get("job"))
    try:
        Manifest.model_validate(told)
    except ValidationError as error:
        found = error.errors(include_url=False)[0]
        where = ".".join(short(str(part)) for part in found["loc"])
        what = f"{where} is {plain(found['input'])}"
        if found["type"] == "missing":
            what = f"says no {where}"
        raise FlightError(f"{path}: {what}: not a campaign's manifest") from None
    absent = {k: f.default for k, f in Manifest.model_fields.items() if not f.is_required()}
    told = {**absent, **told}
    _check_consistent(path, told)
    check_plain(folder, told["job"]["law"])
    return told


def _check_consistent(path: Path, told: dict[str, Any]) -> None:
    if told["job"]["law"] != told["identity"]["law"]:
        raise FlightError(f"{path}: job.law is not identity.law: not a campaign's manifest")
    for tree in ("mission_tree", "told_tree"):
        air = told["job"][tree].get("atmosphere")
        if isinstance(air, dict) and "csv" in air:  # its columns stand in the place of its name
            raise FlightError(f"{path}: job.{tree} names a file: not a campaign's manifest")
    for requirement in told.get("requirements", []):
        try:
            requirement_of(requirement)
        except (ValidationError, AeroshellError, ValueError):
            raise FlightError(f"{path}: a requirement cannot be read") from None


def requirement_of(told: dict[str, Any]) -> Requirement:
    """A requirement as the manifest keeps it, bounds that it does not have being null."""
    return Requirement.model_validate({k: v for k, v in told.items() if v is not None})


def read_load(folder: Path, law: str) -> bytes:
    """The load image that the campaign flew."""
    path = folder / LOAD.format(law=law)
    try:
        return content_of(path, LOAD_BYTES_MAX)
    except DocumentError as error:
        raise FlightError(f"{path}: {error}") from None


def _check_runs(path: Path, table: pa.Table, n: int) -> None:
    if not np.array_equal(table["run"].to_numpy(), np.arange(1, n + 1)):
        raise FlightError(f"{path}: cannot be read (its runs are not 1 to {n:,} in their order)")


def read_samples(folder: Path, manifest: dict[str, Any]) -> pa.Table:
    """The samples of a campaign: a row a flight, in the order of runs."""
    path, n = folder / SAMPLES, manifest["identity"]["n"]
    table = read_columns(path, n, ("run", "seed"), told_by=MANIFEST)
    _check_runs(path, table, n)
    for key in manifest["told_to_both"]:
        if key not in table.column_names:
            raise FlightError(f"{path}: has no column {short(key)}, which {MANIFEST} names")
    if (seeds := table["seed"].to_numpy()).min() < 0 or not np.issubdtype(seeds.dtype, np.integer):
        raise FlightError(f"{path}: cannot be read (a seed is no whole number from 0)")
    return table


def has_results(folder: Path) -> bool:
    """Whether all flights are in results.parquet."""
    return (folder / RESULTS).is_file()


def read_results(folder: Path, manifest: dict[str, Any]) -> pa.Table:
    """All flights of a finished campaign, sorted by run."""
    path, n = folder / RESULTS, manifest["identity"]["n"]
    if not has_results(folder):
        raise FlightError(
            f"{folder}: campaign of {n} flights is not finished; "
            f"the command that began it goes on with it"
        )
    table = read_columns(path, n, ("run", "outcome_class"), told_by=MANIFEST)
    _check_runs(path, table, n)
    for name in set(table["outcome_class"].to_pylist()) - set(CLASSES):
        raise FlightError(f"{path}: outcome_class is {plain(name)}, allowed {', '.join(CLASSES)}")
    return table


class Line(NamedTuple):
    """A whole result in the journal."""

    offset: int
    row: dict[str, Any]


def _is_value(key: str, value: Any) -> bool:
    if value is None or key in TEXTS:
        return value is None or isinstance(value, str)
    if isinstance(value, int):
        return -INTEGER_MAX <= value <= INTEGER_MAX
    return isinstance(value, float)


def is_whole(row: Any, n: int) -> bool:
    """Whether a value is the result of a flight of a campaign of `n`."""
    if not isinstance(row, dict) or len(row) > VALUES_MAX:
        return False
    run, kind = row.get("run"), row.get("outcome_class")
    if type(run) is not int or not 1 <= run <= n or kind not in CLASSES:
        return False
    if not isinstance(row.get("outcome"), str):
        return False
    told = isinstance(row.get("command_sha256"), str) or kind == NUMERICAL
    return told and all(_is_value(key, value) for key, value in row.items())


def journal_lines(path: Path, n: int) -> Iterator[Line]:
    """The whole results in a journal; whatever else stands there is a flight not flown."""
    try:
        with path.open("rb") as journal:
            while True:
                offset = journal.tell()
                line = journal.readline(LINE_BYTES_MAX)
                if not line:
                    return
                if not line.endswith(b"\n"):
                    if len(line) < LINE_BYTES_MAX:
                        return  # it was being written
                    while (rest := journal.readline(LINE_BYTES_MAX)) and rest[-1:] != b"\n":
                        pass
                    continue
                try:
                    row = json_of(line)
                except DocumentError:
                    continue
                if is_whole(row, n):
                    yield Line(offset, row)
    except OSError as error:
        raise FlightError(f"{path}: cannot be read ({error.strerror})") from None


def read_journal(folder: Path, n: int) -> pa.Table | None:
    """What a campaign has flown so far, sorted by run; None if no flight has ended."""
    groups: list[pa.Table] = []
    group: list[dict[str, Any]] = []
    place: dict[int, int] = {}
    for number, line in enumerate(journal_lines(folder / JOURNAL, n)):
        place[line.row["run"]] = number  # the last one told counts
        group.append(line.row)
        if len(group) == GROUP_ROWS:
            groups.append(as_table(group))
            group = []
    if group:
        groups.append(as_table(group))
    if not groups:
        return None
    table = pa.concat_tables(groups, promote_options="permissive")
    return table.take([place[run] for run in sorted(place)])


def as_table(rows: list[dict[str, Any]]) -> pa.Table:
    """Rows of results as a table: whole numbers as such where all are, truths too."""
    keys = dict.fromkeys(key for row in rows for key in row)
    return pa.table({key: column([row.get(key) for row in rows], key) for key in keys})


def column(values: list[Any], key: str) -> pa.Array:
    """Values of one key as a column of the one kind that holds them all."""
    kinds = {type(value) for value in values if value is not None}
    if key in TEXTS:
        return pa.array(values, pa.string())
    if kinds == {bool}:
        return pa.array(values, pa.bool_())
    if kinds == {int}:
        return pa.array(values, pa.int64())
    return pa.array([math.nan if v is None else float(v) for v in values], pa.float64())


def row_in(folder: Path, manifest: dict[str, Any], number: int) -> dict[str, Any] | None:
    """One run's result, from a finished campaign or one that has been stopped."""
    if has_results(folder):
        return dict(read_results(folder, manifest).slice(number - 1, 1).to_pylist()[0])
    if not (folder / JOURNAL).is_file():
        return None
    found = None
    for line in journal_lines(folder / JOURNAL, manifest["identity"]["n"]):
        if line.row["run"] == number:
            found = line.row
    return found
