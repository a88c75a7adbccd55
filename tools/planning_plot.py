"""A plan as a picture: convergence, bank and angle of attack, altitude, ground track, heat flux."""

from pathlib import Path
from typing import Any

import numpy as np

from flight_sw.errors import FlightError
from tools.gains.planned.offline import iterations_of
from tools.planning import Told

DPI, WIDTH_IN, HEIGHT_IN = 110, 11.0, 10.0
E_FLOOR = 1e-6  # an axis of decades has no zero
BLUE, RED, GREY, GREEN = "#3b6ea8", "#b03030", "#777777", "#3a8a5c"


def _axis(axes: Any, title: str, x: str, y: str) -> None:
    axes.set_title(title, loc="left", fontsize=10)
    axes.set_xlabel(x, fontsize=9)
    axes.set_ylabel(y, fontsize=9)
    axes.grid(visible=True, alpha=0.3)


def _convergence(axes: Any, told: Told) -> None:
    rows = iterations_of(told.planned.job[0])
    numbers = [row["iteration"] for row in rows]
    for key, label, colour in (("target_error", "e_t", BLUE), ("excess", "e_c", RED)):
        values = [max(row[key], E_FLOOR) for row in rows]
        axes.semilogy(numbers, values, "o-", color=colour, label=label)
    axes.set_xticks(numbers)
    axes.legend(frameon=False)
    _axis(axes, f"convergence: {told.ending}", "iteration", "e_t; e_c in (W/cm2)2 s")


def _controls(axes: Any, told: Told) -> None:
    index = told.columns["index"]
    axes.plot(index, np.degrees(told.columns["bank_rad"]), color=BLUE, label="bank")
    axes.plot(index, np.degrees(told.columns["alpha_rad"]), color=GREEN, label="angle of attack")
    profile = told.planned.plan["profile"][0]
    n = int(profile["n_bank"])
    knots, banks = profile["bank_index"][:n], np.degrees(profile["bank_rad"][:n])
    axes.plot(knots, banks, "o", color=BLUE, markersize=4)
    axes.legend(frameon=False)
    _axis(axes, "controls", "index of the plan", "deg")


def _altitude(axes: Any, told: Told) -> None:
    axes.plot(told.columns["v_rel_mps"] / 1e3, told.columns["alt_m"] / 1e3, color=BLUE)
    axes.invert_xaxis()
    _axis(axes, "altitude over speed", "km/s", "km")


def _track(axes: Any, told: Told) -> None:
    target = told.mission.target
    lon, lat = (np.degrees(told.columns[name]) for name in ("lon_rad", "lat_rad"))
    axes.plot(lon, lat, color=BLUE, label="planned")
    axes.plot(lon[0], lat[0], "o", color=GREY, label="entry")
    if target is not None:
        east = lon[-1] + np.remainder(target.longitude_deg - lon[-1] + 180.0, 360.0) - 180.0
        axes.plot(east, target.latitude_deg, "x", color=RED, markersize=9, label="target")
    axes.legend(frameon=False)
    _axis(axes, "ground track", "longitude, deg", "latitude, deg")


def _heat(axes: Any, told: Told) -> None:
    axes.plot(told.columns["index"], told.columns["heat_flux_wpm2"] / 1e3, color=BLUE)
    axes.axhline(told.mission.limits.heat_flux_max_kwpm2, color=RED, linewidth=1.2, label="limit")
    axes.legend(frameon=False)
    _axis(axes, "heat flux", "index of the plan", "kW/m2")


def _path_angle(axes: Any, told: Told) -> None:
    axes.plot(told.columns["index"], np.degrees(told.columns["flight_path_angle_rad"]), color=BLUE)
    _axis(axes, "flight-path angle", "index of the plan", "deg")


def plot(told: Told, path: Path) -> None:
    """Write the picture; its form is that of the file's ending."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(WIDTH_IN, HEIGHT_IN), layout="constrained")
    FigureCanvasAgg(figure)
    panels = (_convergence, _controls, _altitude, _track, _heat, _path_angle)
    for draw, axes in zip(panels, figure.subplots(3, 2).ravel(), strict=True):
        draw(axes, told)
    figure.suptitle(f"{told.mission.titled(told.case)}: what the computer plans", fontsize=11)
    try:
        figure.savefig(path, dpi=DPI)
    except (OSError, ValueError) as error:
        raise FlightError(f"--plot {path}: cannot be written ({error})") from error
