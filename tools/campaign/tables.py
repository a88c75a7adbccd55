"""How a campaign is shown on a terminal: what its flights spread over, and what they show."""

from collections import Counter
from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow.compute as pc
from rich.table import Table

from sim_harness.flight.outcomes import LIMIT_EXCEEDED, TOGETHER
from tools.campaign.columns import numbers
from tools.show import ROWS

if TYPE_CHECKING:
    from tools.campaign.engine import Campaign

QUANTILES = (0.0, 0.05, 0.5, 0.95, 1.0)
HEADS = ("least", "5 %", "median", "95 %", "most")


def shown(value: float) -> str:
    """A number to the digits that matter in a table of many."""
    return f"{value:z,.2f}" if abs(value) < 100.0 else f"{value:z,.0f}"


def distribution_table(flown: "Campaign") -> Table:
    """Order statistics of what `fly` shows of one flight."""
    identity = flown.manifest["identity"]
    title = f"{flown.manifest['title']}: law {identity['law']}, {identity['dispersions']}"
    table = Table(title=title)
    table.add_column("", no_wrap=True)
    for head in HEADS:
        table.add_column(head, justify="right", no_wrap=True)
    table.add_column("unit")
    for label, key, unit in ROWS:
        if key not in flown.results.column_names:
            continue
        values = numbers(flown.results, key)
        values = values[np.isfinite(values)]
        if len(values):
            cells = np.quantile(values, QUANTILES, method="inverted_cdf")
            table.add_row(label, *(shown(value) for value in cells), unit)
    return table


def limits_of(flown: "Campaign", name: str) -> str:
    """After the class of flights that exceeded a limit: how many exceeded which."""
    if name != LIMIT_EXCEEDED or "limits_exceeded" not in flown.results.column_names:
        return ""
    rows = flown.results.filter(pc.equal(flown.results["outcome_class"], name))
    found = [
        limit for text in rows["limits_exceeded"].to_pylist() for limit in text.split(TOGETHER)
    ]
    return f" ({', '.join(f'{n:,} {limit}' for limit, n in Counter(found).items())})"


def requirement_table(requirements: list[dict[str, Any]]) -> Table:
    """What is required, what the flights show, and how many it would take."""
    table = Table(title="requirements, by order statistics")
    table.add_column("requirement")
    table.add_column("failures", justify="right")
    table.add_column("shown", justify="right", no_wrap=True)
    table.add_column("required", justify="right", no_wrap=True)
    table.add_column("worst run", justify="right")
    table.add_column("verdict")
    for told in requirements:
        verdict = told["verdict"]
        if verdict == "undecided":
            verdict += f", {told['flights_needed']:,} flights needed"
        table.add_row(
            told["title"],
            f"{told['failures']:,} of {told['flights']:,}",
            f"{told['shown_probability']:z.5f}",
            f"{told['probability']:z.5f}",
            str(told["worst_run"]),
            f"{verdict} (at {told['confidence']:z.0%})",
        )
    return table
