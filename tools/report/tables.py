"""The report's tables as rows of text; the template only places them."""

import shlex
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from sim_harness.flight.outcomes import LIMIT_EXCEEDED, NOMINAL, RATIOS, TOGETHER
from sim_harness.mission.requirements import Verdict, shown_probability
from tools.report.figures import in_pairs
from tools.report.source import Source, numeric_keys
from tools.report.statistics import (
    CONFIDENCE,
    Spread,
    paired,
    says_the_same,
    spread_of,
    varies,
)
from tools.report.words import NONE, Name, column_numbers, key_name, name_of, number, percent
from tools.show import ROWS

WORST = 3  # runs named for each requirement
BY_LIMIT = "by its "  # before the name of a limit, below the class
EXTREMES = ("least", "greatest")
MARKS = {"met": "✓", "not met": "✗", "undecided": "?"}


class Worst(NamedTuple):
    """A run that stands out, and how it is flown again."""

    what: str
    run: int
    value: str
    unit: str
    outcome_class: str
    command: str


def main_metrics(sources: Sequence[Source], varying: Sequence[str]) -> list[Name]:
    """What is plotted: what is required first, then what `fly` shows; only what varies."""
    required = [r.metric for source in sources for r in source.requirements()]
    wanted = dict.fromkeys([*required, *(key for _, key, _ in ROWS)])
    found: list[str] = []
    for key in wanted:
        again = (_says_the_same(sources, key, other) for other in found)
        if key in varying and not any(again):
            found.append(key)
    return [name_of(key) for key in found]


def _says_the_same(sources: Sequence[Source], key: str, other: str) -> bool:
    """Whether a metric only scales another in every campaign, as a peak its ratio to a limit."""
    return all(says_the_same(source.values(key), source.values(other)) for source in sources)


def varying_metrics(sources: Sequence[Source]) -> list[str]:
    """Numbers that differ from flight to flight in any campaign, in the order of the results."""
    keys = dict.fromkeys(key for source in sources for key in numeric_keys(source.results))
    return [key for key in keys if any(varies(source.values(key)) for source in sources)]


def constants(sources: Sequence[Source], varying: Sequence[str]) -> list[tuple[str, str]]:
    """What is the same in every flight of a campaign, and its value in each."""
    keys = dict.fromkeys(key for source in sources for key in numeric_keys(source.results))
    found = []
    for key in keys:
        values = [spread_of(source.values(key)) for source in sources]
        if key in varying or not any(values):
            continue
        told = list(dict.fromkeys(number(v.median) for v in values if v))
        name = name_of(key)
        found.append((name.title, " / ".join(told) + (f" {name.unit}" if name.unit else "")))
    return found


def head_rows(sources: Sequence[Source]) -> list[tuple[str, list[str]]]:
    """What was flown: a row a fact, a cell a campaign."""
    facts = {
        "law": "law", "load CRC-32": "load_crc32", "dispersion set": "dispersions",
        "campaign seed": "seed", "samples": "samples_hash", "sources": "sources_hash",
    }  # fmt: skip
    rows = [
        (title, [str(source.identity.get(key, NONE)) for source in sources])
        for title, key in facts.items()
    ]
    flights = [
        f"{len(s.results):,}" + ("" if len(s.results) == s.n else f" of {s.n:,}") for s in sources
    ]
    rows.insert(2, ("flights", flights))
    if any(source.identity.get("case") for source in sources):
        rows.insert(0, ("case", [str(source.identity.get("case") or NONE) for source in sources]))
    rows.insert(0, ("mission", [str(source.identity["mission"]) for source in sources]))
    rows.append(("version", [str(source.manifest.get("version", NONE)) for source in sources]))
    return rows


def commands(sources: Sequence[Source]) -> list[str]:
    """How each campaign was flown."""
    return [
        f"{source.manifest['command']} --out {shlex.quote(str(source.folder))}"
        for source in sources
        if source.manifest.get("command")
    ]


def dispersion_rows(source: Source) -> list[list[str]]:
    """The dispersed keys as they were drawn."""
    rows = []
    for key, values in source.varied().items():
        spread = spread_of(values)
        if spread:
            cells = [spread.least, spread.median, spread.most, spread.deviation]
            name = key_name(key)
            rows.append([key, *column_numbers(list(cells), 5), name.unit])
    return rows


def fixed_rows(sources: Sequence[Source]) -> list[tuple[str, list[str], str]]:
    """Keys that were set to one value for every flight: a cell a campaign."""
    keys = dict.fromkeys(key for source in sources for key in source.fixed())
    return [
        (key, [source.fixed().get(key, NONE) for source in sources], key_name(key).unit)
        for key in keys
    ]


def requirement_rows(source: Source) -> list[dict[str, str]]:
    """What is required, what the flights show, and how many it would take."""
    return [_requirement_row(verdict) for verdict in source.verdicts()]


def _requirement_row(verdict: Verdict) -> dict[str, str]:
    bounds = [("≥", verdict.quantile_low), ("≤", verdict.quantile_high)]
    shown = ", ".join(f"{sign} {number(v)}" for sign, v in bounds if v is not None)
    name = name_of(verdict.metric)
    needed = ""
    if verdict.verdict != "met":
        needed = f"{verdict.flights_needed:,}"
    return {
        "title": verdict.title,
        "metric": name.label,
        "bound": verdict.bound.replace("<=", "≤").replace(">=", "≥"),
        "required": f"{100.0 * verdict.probability:z.8g} % at {100.0 * verdict.confidence:z.6g} %",
        "failures": f"{verdict.failures:,} of {verdict.flights:,}",
        "shown": percent(verdict.shown_probability),
        "quantile": shown or "too few flights",
        "needed": needed or NONE,
        "worst": str(verdict.worst_run) if verdict.worst_run else NONE,
        "verdict": verdict.verdict,
        "mark": MARKS[verdict.verdict],
        "kind": verdict.verdict.replace(" ", "-"),
    }


def verdict_text(source: Source) -> tuple[str, str]:
    """The campaign in a sentence, and the kind of its colour."""
    verdicts = source.verdicts()
    if not verdicts:
        return "the mission states no requirement", "undecided"
    counted = {kind: sum(v.verdict == kind for v in verdicts) for kind in MARKS}
    if counted["met"] == len(verdicts):
        told, kind = f"all {len(verdicts)} requirements are met", "met"
    else:
        parts = [f"{n} {name}" for name, n in counted.items() if n]
        told = f"{len(verdicts)} requirements: {', '.join(parts)}"
        kind = "not-met" if counted["not met"] else "undecided"
    return told, kind


def class_rows(sources: Sequence[Source]) -> list[tuple[str, str, list[tuple[str, str, str]]]]:
    """Outcome classes: name, kind, and for each campaign count, share and the most it may be."""
    names = dict.fromkeys(name for source in sources for name in source.counts())
    rows = []
    for name in names:
        counts = [source.counts().get(name, 0) for source in sources]
        rows.append((name, "nominal" if name == NOMINAL else "other", _shares(sources, counts)))
        if name == LIMIT_EXCEEDED:
            rows += _limit_rows(sources)
    return rows


def _shares(sources: Sequence[Source], counts: Sequence[int]) -> list[tuple[str, str, str]]:
    """Of each campaign: count, share, and the share that it leaves possible."""
    cells = []
    for source, count in zip(sources, counts, strict=True):
        n = len(source.results)
        most = 1.0 - shown_probability(n, count, CONFIDENCE)
        cells.append((f"{count:,}", percent(count / n), percent(most)))
    return cells


def _limit_rows(sources: Sequence[Source]) -> list[tuple[str, str, list[tuple[str, str, str]]]]:
    """By which limit: a flight that exceeded two counts under each."""
    found = []
    for limit in RATIOS:
        counts = [
            sum(
                name == LIMIT_EXCEEDED and limit in exceeded.split(TOGETHER)
                for name, exceeded in zip(source.classes, source.exceeded(), strict=True)
            )
            for source in sources
        ]
        if any(counts):
            found.append((f"{BY_LIMIT}{limit}", "other", _shares(sources, counts)))
    return found


def class_of(source: Source, place: int) -> str:
    """The class of a run, with the limits that it exceeded."""
    name, exceeded = str(source.classes[place]), source.exceeded()[place]
    return f"{name}: {exceeded}" if name == LIMIT_EXCEEDED and exceeded else name


def spread_rows(source: Source, keys: Sequence[str]) -> list[tuple[str, list[str], str]]:
    """Order statistics of every metric that varies."""
    rows = []
    for key in keys:
        spread = spread_of(source.values(key))
        if spread:
            name = name_of(key)
            rows.append((name.title, [f"{spread.told:,}", *_cells(spread)], name.unit))
    return rows


def _cells(spread: Spread) -> list[str]:
    return column_numbers(list(spread[1:]))


def command_of(source: Source, run: int) -> str:
    """How one run is flown again."""
    return f"aeroshell fly --from {shlex.quote(str(source.folder))} --run {run}"


def _worst(source: Source, what: str, name: Name, place: int) -> Worst:
    run = int(source.runs[place])
    value = number(float(source.values(name.key)[place]), 5)
    return Worst(what, run, value, name.unit, class_of(source, place), command_of(source, run))


def worst_by_requirement(source: Source) -> list[tuple[str, list[Worst]]]:
    """For each requirement the runs that come nearest to failing it, or fail it farthest."""
    from sim_harness.mission.requirements import excess

    found = []
    for requirement in source.requirements():
        values = source.values(requirement.metric)
        beyond = excess(requirement, values)
        if not varies(values) and np.isfinite(values).all():
            continue
        order = np.argsort(-beyond, kind="stable")[:WORST]
        name = name_of(requirement.metric)
        rows = [
            _worst(source, "fails" if beyond[i] > 0.0 else "holds", name, int(i)) for i in order
        ]
        found.append((f"{requirement.title or name.title}: {name.title}", rows))
    return found


def extremes(source: Source, names: Sequence[Name]) -> list[tuple[str, list[Worst]]]:
    """The least and the greatest of each metric."""
    found = []
    required = {requirement.metric for requirement in source.requirements()}
    for name in names:
        values = source.values(name.key)
        if not varies(values) or name.key in required:
            continue
        places = (int(np.nanargmin(values)), int(np.nanargmax(values)))
        rows = [_worst(source, w, name, p) for w, p in zip(EXTREMES, places, strict=True)]
        found.append((name.title, rows))
    return found


def not_flown(source: Source) -> list[Worst]:
    """The first runs whose flight means nothing."""
    from sim_harness.flight.outcomes import NOT_FLOWN

    places = np.flatnonzero(np.isin(source.classes, NOT_FLOWN))[:WORST]
    outcomes = source.results["outcome"].to_pylist() if "outcome" in source.results.column_names \
        else [""] * len(source.results)  # fmt: skip
    return [
        Worst(str(outcomes[i]), int(source.runs[i]), NONE, "", str(source.classes[i]),
              command_of(source, int(source.runs[i])))
        for i in places
    ]  # fmt: skip


def comparison_rows(sources: Sequence[Source], names: Sequence[Name]) -> list[dict[str, Any]]:
    """Percentiles of each metric, a line a law."""
    rows = []
    for name in names:
        spreads = [spread_of(source.values(name.key)) for source in sources]
        lines = [
            (source.label, _cells(spread))
            for source, spread in zip(sources, spreads, strict=True)
            if spread
        ]
        rows.append({"title": name.title, "unit": name.unit, "lines": lines})
    return rows


def paired_rows(sources: Sequence[Source], names: Sequence[Name]) -> list[dict[str, Any]]:
    """Differences flight by flight to the first campaign."""
    first = sources[0]
    rows = []
    for name in names:
        lines = []
        for other in sources[1:]:
            found = paired(*in_pairs(first, other, name.key))
            if found:
                cells = column_numbers([
                    found.low, found.median, found.high, found.median_low, found.median_high
                ])  # fmt: skip
                interval = f"{cells[3]} to {cells[4]}"
                shares = [percent(found.smaller), percent(found.larger)]
                told = f"{other.label} less {first.label}"
                lines.append((told, [f"{found.pairs:,}", *cells[:3], interval, *shares]))
        if lines:
            rows.append({"title": name.title, "unit": name.unit, "lines": lines})
    return rows
