"""Tells once of each value that navigation had to hold at the end of its signal's range."""

from flight_sw import icd
from flight_sw.records.types_ import Record
from sim_harness.world.navigation import REPORTED_NAMES


def held_values(nav_state: Record) -> dict[str, int]:
    """How often each signal was held at the end of its range; without those that never were."""
    counts = nav_state["saturations"].tolist()
    return {name: count for (_, name), count in zip(REPORTED_NAMES, counts, strict=True) if count}


class NavigationWatch:
    """Remembers what was told."""

    def __init__(self) -> None:
        self._told: set[str] = set()

    def look(self, nav_state: Record) -> list[str]:
        """A sentence for each signal that was held for the first time since the last look."""
        new = [name for name in held_values(nav_state) if name not in self._told]
        self._told.update(new)
        said = []
        for message, name in REPORTED_NAMES:
            if name in new:
                low, high = icd.signal_range(message, name)
                said.append(
                    f"navigation: {name} is beyond what {message} carries, {low:.12g} to "
                    f"{high:.12g}, and is held at its end"
                )
        return said
