"""[BETTS10]'s maximum crossrange beside what the flight computer's motion finds.

The problem has a planet that does not turn and no J2. Its controls are free functions; here they
are straight lines between knots, which can only be worse: more knots and shorter steps show by how
much.
"""

from tools.reproduce.crossrange import Found, Search
from tools.reproduce.judged import Part, Progress, Reproduction, Row, at_most, close, told

LATITUDE_DEG, DURATION_S = 34.1412, 2008.59  # without a limit of heat flux, [BETTS10]
LATITUDE_BAR_DEG, DURATION_BAR_S = 0.02, 2.0
SPEED_BAR_MPS, PATH_BAR_DEG = 0.01, 1e-3
LEGS = (1, 2, 3)
QUICK_LEGS = (1, 2)
STEP_S, SHORTER_S = 4.0, 2.0


def _named(search: Search) -> str:
    return f"{search.n_bank} knots of bank, {search.n_alpha} of angle of attack"


def crossrange_part(search: Search, found: Found) -> Part:
    """The finest search beside the published numbers."""
    return Part(
        f"[BETTS10] maximum crossrange without a limit of heat flux: {_named(search)}",
        "Straight lines between knots where the source's controls are free.",
        [
            close("final latitude", found.latitude_deg, LATITUDE_DEG, "deg", LATITUDE_BAR_DEG),
            close("duration", found.t_s, DURATION_S, "s", DURATION_BAR_S),
            at_most(
                "|speed - 762 m/s| at the end", abs(found.speed_error_mps), SPEED_BAR_MPS, "m/s"
            ),
            at_most(
                "|path angle + 5 deg| at the end", abs(found.path_error_deg), PATH_BAR_DEG, "deg"
            ),
            told("iterations", float(found.iterations)),
        ],
    )


def refinement_part(searches: list[Search], found: list[Found], shorter: Found) -> Part:
    """What more knots and shorter steps change; two searches alone are too coarse to be judged."""
    rows: list[Row] = []
    for search, one in zip(searches, found, strict=True):
        rows.append(
            told(f"{_named(search)}: final latitude", one.latitude_deg, "deg", f"{LATITUDE_DEG}")
        )
        rows.append(told("  duration", one.t_s, "s", f"{DURATION_S:,}"))
    others = {f"steps of {SHORTER_S:g} s for {STEP_S:g} s": shorter}
    if len(found) >= len(LEGS):
        others["more knots, the last two"] = found[-1]
    for name, other in others.items():
        latitude_deg = abs(other.latitude_deg - found[-2].latitude_deg)
        t_s = abs(other.t_s - found[-2].t_s)
        rows.append(at_most(f"{name}: |change of latitude|", latitude_deg, LATITUDE_BAR_DEG, "deg"))
        rows.append(at_most("  |change of duration|", t_s, DURATION_BAR_S, "s"))
    return Part("Refinement", "The search is made anew each time, from the same guess.", rows)


def reproduce(*, quick: bool, progress: Progress) -> Reproduction:
    """Both parts; `quick` leaves out the finest knots."""
    searches = [Search(legs, STEP_S) for legs in (QUICK_LEGS if quick else LEGS)]
    found = []
    for search in searches:
        progress(_named(search))
        found.append(search.best())
    progress(f"{_named(searches[-2])}, steps of {SHORTER_S:g} s")
    shorter = Search(len(searches[-2].legs), SHORTER_S).best()
    parts = [crossrange_part(searches[-1], found[-1]), refinement_part(searches, found, shorter)]
    return Reproduction("[BETTS10]", parts, quick)
