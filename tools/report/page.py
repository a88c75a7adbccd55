"""Puts the report together: tables and figures into the template, one file that needs no other."""

from collections.abc import Callable, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined

from tools.report import corridor, figures, tables
from tools.report.figures import Plotted
from tools.report.source import ReportError, Source, read_sources
from tools.report.statistics import Sensitivity, sensitivity
from tools.report.words import Name, key_name, name_of

TEMPLATE = "report.html.j2"
PLOTTED_MAX = 12
REPORT = "report.html"
SMALL_R2 = 0.5
TARGET_PAIRS = (
    ("downrange_error_km", "altitude_error_km"),
    ("downrange_error_km", "crossrange_error_km"),
    ("downrange_error_km", "speed_error_mps"),
)
PAIRS = (("ground_range_km", "heat_load_mjpm2"), ("ground_range_km", "load_factor_max_g"))
PAIRS_MAX = 2

Told = Callable[[str], None]


def _quiet(text: str) -> None:
    """Says nothing."""


def scatter_pairs(varying: Sequence[str]) -> tuple[list[tuple[Name, Name]], bool]:
    """What is plotted against what, and whether it is about a target."""
    for pairs, with_target in ((TARGET_PAIRS, True), (PAIRS, False)):
        found = [(name_of(x), name_of(y)) for x, y in pairs if x in varying and y in varying][
            :PAIRS_MAX
        ]
        if found:
            return found, with_target
    return [], False


def _regressions(
    sources: Sequence[Source], names: Sequence[Name]
) -> list[tuple[Name, list[Sensitivity | None]]]:
    varied = [source.varied() for source in sources]
    found = [
        (name, [sensitivity(s.values(name.key), v) for s, v in zip(sources, varied, strict=True)])
        for name in names
    ]
    return [(name, of_sources) for name, of_sources in found if any(of_sources)]


def _sensitivity_rows(
    sources: Sequence[Source], found: Sequence[tuple[Name, list[Sensitivity | None]]]
) -> list[dict[str, Any]]:
    """The regressions as numbers: the keys that matter most, and what they explain."""
    rows = []
    for name, of_sources in found:
        lines = []
        for source, one in zip(sources, of_sources, strict=True):
            if one is None:
                continue
            ordered = sorted(
                zip(one.keys, one.coefficients, strict=True), key=lambda kc: -abs(kc[1])
            )
            leading = ", ".join(f"{key_name(k).title} {c:+z.2f}" for k, c in ordered[:4])
            lines.append((source.label, leading, f"{one.r2:z.2f}", f"{one.r2_linear:z.2f}",
                          one.r2 < SMALL_R2))  # fmt: skip
        rows.append({"title": name.title, "lines": lines})
    return rows


def _figures(
    sources: Sequence[Source], names: Sequence[Name], varying: Sequence[str], tell: Told
) -> tuple[dict[str, Any], list[str]]:
    """All figures by their places in the template, and notes on them."""
    required = sources[0].requirements()
    plotted = [
        Plotted(name, tuple(r for r in required if r.metric == name.key))
        for name in names[:PLOTTED_MAX]
    ]
    pairs, with_target = scatter_pairs(varying)
    tell("drawing the corridor")
    mission, note = corridor.mission_of_source(sources[0])
    found: dict[str, Any] = {"corridor": corridor.draw(sources, mission)}
    tell("drawing distributions")
    found["distributions"] = figures.distributions(sources, plotted) if plotted else None
    found["differences"] = None
    if len(sources) > 1 and plotted:
        found["differences"] = figures.differences(sources, plotted)
    found["scatter"] = figures.scatter(sources, pairs, with_target) if pairs else None
    tell("drawing sensitivities")
    regressions = _regressions(sources, [what.name for what in plotted])
    found["sensitivities"] = figures.sensitivities(sources, regressions) if regressions else None
    found["sensitivity_rows"] = _sensitivity_rows(sources, regressions)
    found["with_target"] = with_target
    return found, [note] if note and found["corridor"] else []


def context(sources: Sequence[Source], command: str, tell: Told = _quiet) -> dict[str, Any]:
    """All that the template shows."""
    varying = tables.varying_metrics(sources)
    names = tables.main_metrics(sources, varying)
    drawn, notes = _figures(sources, names, varying, tell)
    notes = [f"{s.label}: {n}" if len(sources) > 1 else n for s in sources for n in s.notes] + notes
    several = len(sources) > 1
    return {
        **drawn,
        "title": str(sources[0].manifest.get("title") or sources[0].identity["mission"]),
        "labels": [source.label for source in sources],
        "several": several,
        "notes": notes,
        "verdicts": [(source.label, *tables.verdict_text(source)) for source in sources],
        "head": tables.head_rows(sources),
        "commands": tables.commands(sources),
        "command": command,
        "version": version("aeroshell"),
        "dispersions": tables.dispersion_rows(sources[0]),
        "fixed": tables.fixed_rows(sources),
        "requirements": [(source.label, tables.requirement_rows(source)) for source in sources],
        "classes": tables.class_rows(sources),
        "spreads": [(source.label, tables.spread_rows(source, varying)) for source in sources],
        "constants": tables.constants(sources, varying),
        "worst": [
            (
                source.label,
                tables.worst_by_requirement(source),
                tables.extremes(source, names),
                tables.not_flown(source),
            )
            for source in sources
        ],
        "comparison": tables.comparison_rows(sources, names) if several else [],
        "paired": tables.paired_rows(sources, names) if several else [],
    }


def html(sources: Sequence[Source], command: str, tell: Told = _quiet) -> str:
    """The whole report."""
    environment = Environment(
        loader=PackageLoader("tools", "report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template(TEMPLATE).render(context(sources, command, tell))


def write_report(folders: Sequence[Path], out: Path, command: str, tell: Told = _quiet) -> None:
    """Read the campaigns, draw them, and put the file in its place, whole or not at all."""
    tell("reading the campaigns")
    text = html(read_sources(folders), command, tell)
    part = out.with_name(out.name + ".new")
    try:
        part.write_text(text, encoding="utf-8")
        part.replace(out)
    except OSError as error:
        raise ReportError(f"--out {out}: cannot be written ({error.strerror})") from error
