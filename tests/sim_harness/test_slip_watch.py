"""Warnings of slips: at once, ever more rarely while it slips, promptly again afterwards."""

import itertools

from sim_harness.flight.slip_watch import SILENCE_MAX_S, Slips, SlipWatch

STEP_S = 0.05


def times_told(slips_at, until_s: float, watch: SlipWatch | None = None) -> list[float]:  # type: ignore[no-untyped-def]
    """When a watch that looks 20 times a second speaks."""
    watch = watch or SlipWatch()
    looks = [step * STEP_S for step in range(round(until_s / STEP_S))]
    return [t_s for t_s in looks if watch.look(t_s, slips_at(t_s))]


def test_the_first_slip_is_told_at_once() -> None:
    assert times_told(lambda t_s: Slips(harness=int(t_s >= 3.0)), 10.0) == [3.0]


def test_what_slips_all_the_time_is_told_ever_more_rarely() -> None:
    told = times_told(lambda t_s: Slips(commands=1 + round(t_s / STEP_S)), 600.0)
    gaps = [round(b - a) for a, b in itertools.pairwise(told)]
    assert gaps[:7] == [1, 2, 4, 8, 16, 32, 64]
    assert set(gaps[7:]) == {round(SILENCE_MAX_S)}


def test_after_a_quiet_time_it_speaks_at_once_again() -> None:
    def slips(t_s: float) -> Slips:
        return Slips(computer=round(min(t_s, 100.0) / STEP_S) + int(t_s >= 400.0))

    told = times_told(slips, 500.0)
    assert [t_s for t_s in told if t_s > 200.0] == [400.0]


def test_what_is_told_is_what_is_new() -> None:
    watch = SlipWatch()
    assert "2 frames of the harness, 0 cycles" in watch.look(0.0, Slips(harness=2))
    assert watch.look(0.5, Slips(5, 1, 7)) == ""
    assert "3 frames of the harness, 1 cycles of the flight computer, 7 commands" in watch.look(
        1.0, Slips(5, 1, 7)
    )


def test_a_flight_that_keeps_time_is_never_spoken_of() -> None:
    assert times_told(lambda t_s: Slips(), 100.0) == []
