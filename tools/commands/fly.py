"""`aeroshell fly`: one flight, recorded and summarised."""

import json
import shlex
import shutil
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from flight_sw.runtime.streams import say, tell

if TYPE_CHECKING:
    from sim_harness.flight.flight import FlightPlan, FlightRun
    from tools.overrides import Prepared
    from tools.review.viewer import Live

RUNS = Path("runs")
SEED_MAX = 2**63 - 1
SUMMARY_NAME = "summary.json"

ExternalComputer = Annotated[
    bool,
    typer.Option("--external-computer", help="a flight computer with this load is on the bus"),
]
OtherSources = Annotated[
    bool,
    typer.Option("--other-sources", help="warn of a flight computer of other sources, fly with it"),
]
ShowLive = Annotated[bool, typer.Option("--live", help="show the flight in a Rerun viewer")]
InViewer = Annotated[
    str | None, typer.Option(metavar="URL", help="--live, in a viewer that is open already")
]
TelemetryRate = Annotated[
    float, typer.Option(help="of decoded messages and truth in flight.mcap, Hz")
]
BusAddress = Annotated[
    str, typer.Option(help="memory, unix (two processes), unix:PATH of a hub, socketcan:INTERFACE")
]


MissionName = Annotated[
    str | None, typer.Argument(help="a shipped mission, or the path of a mission TOML")
]
FromCampaign = Annotated[
    Path | None, typer.Option("--from", help="folder of a campaign: fly one run of it again")
]
LoadFile = Annotated[Path | None, typer.Option(help="load image to fly instead of the gains'")]
OutFolder = Annotated[Path | None, typer.Option(help="folder of its files [default: below runs/]")]
Settings = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="KEY=VALUE", help="override a mission or design key"),
]
NamedCase = Annotated[
    str | None, typer.Option("--case", help="a case of the mission file; --set changes it further")
]
Pace = Annotated[str, typer.Option(help="lockstep, realtime, or a factor such as 10x or 0.5x")]
Synchronisation = Annotated[
    str, typer.Option(help="against the clock the computer waits for a frame or for the clock")
]
RunOfIt = Annotated[int | None, typer.Option("--run", help="which run of it, from 1")]


class Folder:
    """The folder of a flight's files: the one named, or the next free one below runs/."""

    def __init__(self, out: Path | None, mission: str, law: str, force: bool) -> None:
        from flight_sw.errors import FlightError
        from flight_sw.runtime.program import shown
        from sim_harness.telemetry.records import RECORDING_NAME

        if out is None:
            names = (f"{mission}-{law}-{number:03d}" for number in range(1, 1_000_000))
            out = next(RUNS / name for name in names if not (RUNS / name).exists())
        self.path = out
        try:
            self._is_new = not out.exists()
            held = [name for name in (SUMMARY_NAME, RECORDING_NAME) if (out / name).exists()]
            if held and not force:
                raise FlightError(f"--out {out}: holds {held[0]} already, --force replaces it")
            out.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise FlightError(f"--out {shown(out)}: cannot be made ({error.strerror})") from error

    def discard(self) -> None:
        """Remove a folder made for a flight that never began."""
        if self._is_new:
            shutil.rmtree(self.path, ignore_errors=True)


def pace_factor(text: str) -> float:
    """Mission seconds per second of the clock; 0 for lockstep."""
    from flight_sw.errors import FlightError
    from flight_sw.timing import PACE_HIGH, PACE_LOW

    if text in ("lockstep", "realtime"):
        return 1.0 if text == "realtime" else 0.0
    try:
        factor = float(text.removesuffix("x")) if text.endswith("x") else 0.0
    except ValueError:
        factor = 0.0
    if not PACE_LOW <= factor <= PACE_HIGH:
        raise FlightError(
            f"--pace {text}: allowed are lockstep, realtime, or {PACE_LOW:g}x to {PACE_HIGH:g}x"
        )
    return factor


def check_bus(bus: str, factor: float, synchronisation: str, *, external_computer: bool) -> None:
    """Refuse what does not go together."""
    from flight_sw.errors import FlightError

    if bus not in ("memory", "unix") and not bus.startswith(("unix:", "socketcan:")):
        raise FlightError(f"--bus {bus}: allowed are memory, unix, unix:PATH, socketcan:INTERFACE")
    if factor > 0.0 and bus == "memory":
        raise FlightError("--pace: the memory bus flies in lockstep only")
    if synchronisation not in ("frame", "clock"):
        raise FlightError(f"--synchronisation {synchronisation}: allowed are frame, clock")
    if external_computer and bus in ("memory", "unix"):
        raise FlightError("--external-computer: needs --bus unix:PATH or socketcan:INTERFACE")


def checked_rate(rate_hz: float) -> float:
    """The rate of telemetry in a recording, refused before anything is flown."""
    from flight_sw.errors import RecordingError
    from sim_harness.telemetry.writer import RATE_MAX_HZ

    if not 0.0 < rate_hz <= RATE_MAX_HZ:
        raise RecordingError(
            f"--telemetry-rate {rate_hz:g}: allowed are above 0 to {RATE_MAX_HZ:g} Hz"
        )
    return rate_hz


def _manifest(run: "FlightRun") -> dict[str, str]:
    import uuid
    from importlib.metadata import version
    from platform import python_version

    from flight_sw.runtime.identity import name_of
    from sim_harness.flight.summary import pace_text
    from sim_harness.mission.mission import differences
    from sim_harness.replay.script import HARNESS_KEY
    from sim_harness.telemetry.reader import RECORDING_KEY

    plan = run.plan
    return {
        "project": "aeroshell",
        "version": version("aeroshell"),
        **{name: version(name) for name in ("numba", "numpy")},
        "python": python_version(),
        RECORDING_KEY: uuid.uuid4().hex,
        "period_s": repr(plan.mission.dt_s),
        "pace": pace_text(plan.pace),
        "synchronisation": plan.synchronisation,
        "mission": plan.mission.name,
        **({"case": plan.case} if plan.case else {}),
        "law": run.image.law,
        "bus": plan.bus,
        "seed": str(plan.seed),
        "load_crc32": f"0x{run.image.crc32:08x}",
        HARNESS_KEY: name_of(run.number),
        "overrides": json.dumps(differences(plan.mission)),
        "command_line": shlex.join([Path(sys.argv[0]).name, *sys.argv[1:]]),
    }


def _attachments(run: "FlightRun") -> dict[str, tuple[str, bytes]]:
    from flight_sw import icd

    mission = run.plan.mission.path
    tables = {}
    if csv := getattr(run.plan.mission.atmosphere, "csv", None):
        tables[csv] = ("text/csv", (mission.parent / csv).read_bytes())
    return {
        icd.DBC_PATH.name: ("text/plain", icd.DBC_PATH.read_bytes()),
        mission.name: ("application/toml", mission.read_bytes()),
        f"{run.image.law}.load": ("application/octet-stream", run.plan.load_image),
        **tables,
    }


def fly_and_record(run: "FlightRun", folder: Path | None) -> str:
    """Fly a run to its end; returns why it ended early, or an empty text."""
    from contextlib import ExitStack

    from flight_sw.errors import AeroshellError
    from sim_harness.flight.bus_flight import fly_bus
    from sim_harness.flight.flight import fly_memory
    from sim_harness.telemetry.reader import RECORDING_KEY
    from sim_harness.telemetry.records import RECORDING_NAME
    from tools.recording import FlightRecorder

    with ExitStack() as resources:
        if folder is not None:
            path, manifest = folder / RECORDING_NAME, _manifest(run)
            recorder = FlightRecorder(path, manifest, _attachments(run), run.plan.truth_rate_hz)
            recorder.journal = run.keep_journal(path, manifest[RECORDING_KEY])
            resources.callback(lambda: recorder.close(run))
            run.listeners.append(recorder)
        try:
            if run.plan.bus == "memory":
                fly_memory(run)
                return ""
            return fly_bus(run)
        except KeyboardInterrupt:
            run.ended_by = "interrupted"
            raise
        except AeroshellError:
            run.ended_by = "refused"
            raise


def fly(
    mission: MissionName = None,
    *,
    campaign: FromCampaign = None,
    run: RunOfIt = None,
    case: NamedCase = None,
    law: Annotated[str | None, typer.Option(help="guidance law [default: the mission's]")] = None,
    bus: BusAddress = "unix",
    pace: Pace = "lockstep",
    synchronisation: Synchronisation = "frame",
    settings: Settings = None,
    load: LoadFile = None,
    seed: Annotated[
        int, typer.Option(min=0, max=SEED_MAX, help="of noise, drop-outs, profiles of the air")
    ] = 0,
    out: OutFolder = None,
    telemetry_rate: TelemetryRate = 10.0,
    record: Annotated[bool, typer.Option("--record/--no-record", help="write flight.mcap")] = True,
    as_json: Annotated[bool, typer.Option("--json", help="print only the summary's JSON")] = False,
    force: Annotated[bool, typer.Option("--force", help="replace files in --out")] = False,
    live: ShowLive = False,
    viewer: InViewer = None,
    external_computer: ExternalComputer = False,
    other_sources: OtherSources = False,
) -> None:
    """Fly a mission: the world and the flight computer as two processes on a bus, in lockstep."""
    from flight_sw.errors import FlightError
    from sim_harness.flight.flight import FlightPlan
    from tools.review.viewer import Live

    own = {"MISSION": mission, "--case": case, "--law": law, "--set": settings, "--load": load,
           "--seed": seed}  # fmt: skip
    prepared, seed, then = _what_to_fly(own, campaign, run)
    factor = pace_factor(pace)
    check_bus(bus, factor, synchronisation, external_computer=external_computer)
    rate_hz = checked_rate(telemetry_rate)
    name = "-".join(filter(None, (prepared.mission.name, prepared.case)))
    folder = Folder(out, name, prepared.law, force)
    plan = FlightPlan(
        mission=prepared.mission,
        law=prepared.law,
        load_image=prepared.load_image,
        load_path=_load_path(prepared, folder),
        bus=bus,
        seed=seed,
        truth_rate_hz=rate_hz,
        recorded=record or live or viewer is not None,
        case=prepared.case,
        own_computer=not external_computer,
        other_sources=other_sources,
        pace=factor,
        synchronisation=synchronisation,
    )
    summary, unwritten = _fly(plan, folder, as_json, Live(live, viewer), record)
    if not as_json:
        _show(summary, prepared, folder.path)
    if campaign is not None and run is not None:
        _compare(campaign, run, then, summary)
    if unwritten:
        raise FlightError(unwritten)


def _what_to_fly(
    own: dict[str, Any], campaign: Path | None, run: int | None
) -> tuple["Prepared", int, dict[str, Any] | None]:
    """What was asked for with the options of one's own, or a run of a campaign and its result."""
    from flight_sw.errors import FlightError
    from tools.campaign.refly import refly
    from tools.overrides import prepare

    if campaign is None and own["MISSION"] is None:
        raise typer.BadParameter("name a mission, or a campaign's folder with --from")
    if (campaign is None) != (run is None):
        raise typer.BadParameter("--from and --run go together")
    if campaign is None or run is None:
        settings = own["--set"] or []
        asked = (own["MISSION"], own["--law"], settings, own["--load"], own["--case"])
        return prepare(*asked), own["--seed"], None
    if given := [name for name, value in own.items() if value]:
        raise FlightError(f"--from {campaign}: takes no {given[0]}, the campaign says what flew")
    return refly(campaign, run)


def _compare(campaign: Path, run: int, then: dict[str, Any] | None, now: dict[str, Any]) -> None:
    """Say whether a run flown again had the commands that it had in its campaign."""
    from tools.campaign.refly import check_same

    if then is None or not then.get("command_sha256"):
        say(f"run {run} of {campaign} has no commands there to compare with")
        return
    check_same(campaign, run, then, now)
    say(f"run {run} of {campaign}: the same commands, bit by bit")


def _load_path(prepared: "Prepared", folder: Folder) -> Path:
    """The image's file; one made for this flight is stored with it."""
    from flight_sw.errors import FlightError
    from tools.gains.image import image_path

    if not prepared.remade:
        return prepared.load_path
    path = image_path(folder.path, prepared.law)
    try:
        _write(path, prepared.load_image)
    except FlightError:
        folder.discard()
        raise
    return path


def _write(path: Path, content: bytes) -> None:
    from flight_sw.errors import FlightError
    from tools.gains.image import write_atomically

    try:
        write_atomically(path, content)
    except OSError as error:
        raise FlightError(f"{path}: cannot be written, {error.strerror}") from error


def _fly(
    plan: "FlightPlan", folder: "Folder", as_json: bool, live: "Live", record: bool
) -> tuple[dict[str, Any], str]:
    """Fly, write the summary, and raise for a flight that was not flown to its end; returns the
    summary, and why it could not be written."""
    from flight_sw.errors import FlightError
    from sim_harness.flight.flight import FlightRun
    from sim_harness.flight.summary import summary_of
    from sim_harness.world.records import PHYSICAL_ENDS
    from tools.recording import FolderWatch
    from tools.show import ProgressLine

    run, view, unwritten = None, None, ""
    try:
        with ProgressLine(plan.mission, quiet=as_json) as line:
            run = FlightRun(plan, [line, FolderWatch(folder.path)])
            view = live.view_of(run, _manifest(run))
            run.listeners += [view] if view else []
            failure = fly_and_record(run, folder.path if record else None)
    finally:
        if view is not None:
            view.close()
        if run is None or run.harness["truth"]["minor_frames"][0] == 0:
            folder.discard()
        else:
            summary = summary_of(run)
            text = json.dumps(summary, indent=1)
            try:
                _write(folder.path / SUMMARY_NAME, (text + "\n").encode())
            except FlightError as error:  # the flight was flown all the same
                unwritten = str(error)
    if as_json and run.harness["truth"]["minor_frames"][0] > 0:
        tell(text)
    if failure:
        raise FlightError(failure)
    if run.outcome not in PHYSICAL_ENDS:
        raise FlightError(f"the flight ended with outcome '{summary['outcome']}'")
    return summary, "; ".join(filter(None, (run.unrecorded, unwritten)))


def _show(summary: dict[str, Any], prepared: "Prepared", folder: Path) -> None:
    from tools.console import show
    from tools.show import footnote, result_table

    show(result_table(summary, prepared.mission, prepared.comparable))
    tell(footnote(summary, f"{folder}/"))
