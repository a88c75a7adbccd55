"""What a mission file may say of the air's deviations: factors, random profiles, winds.

The flight computer is never told of them.
"""

from typing import Annotated, Self

from pydantic import model_validator

from sim_harness.mission.quantities import Quantity, Section, Series, refusal

ROWS_MAX = 512


class DensityDeviation(Section):
    """Keys that every model of the atmosphere has: how the true density differs from it."""

    density_factor: Annotated[
        float, Quantity("-", 1e-3, 1e3, "true density over the model's; not told to the computer")
    ] = 1.0
    density_sigma_ground_ratio: Annotated[
        float, Quantity("-", 0.0, 2.0, "random part of ln(density) at altitude 0, one sigma")
    ] = 0.0
    density_sigma_top_ratio: Annotated[
        float, Quantity("-", 0.0, 2.0, "and at density_sigma_top_km; linear between, held above")
    ] = 0.0
    density_sigma_top_km: Annotated[float, Quantity("km", 1.0, 1e4, "see above")] = 100.0
    density_correlation_km: Annotated[
        float, Quantity("km", 1e-3, 1e4, "altitude over which its correlation falls to 1/e")
    ] = 10.0


class AerodynamicDeviation(Section):
    """Keys that every model of the aerodynamics has: how the true forces differ from it."""

    lift_factor: Annotated[
        float, Quantity("-", 0.0, 100.0, "true lift over the model's; not told to the computer")
    ] = 1.0
    drag_factor: Annotated[float, Quantity("-", 0.0, 100.0, "likewise of drag")] = 1.0


class Wind(Section):
    """Motion of the air over the rotating planet, against altitude: a constant, a table and a
    random part, added up. The flight computer is not told."""

    east_mps: Annotated[float, Quantity("m/s", -1000.0, 1000.0, "towards the east, all over")] = 0.0
    north_mps: Annotated[float, Quantity("m/s", -1000.0, 1000.0, "towards the north")] = 0.0
    table_altitude_km: Annotated[
        tuple[float, ...] | None,
        Series("km", -50.0, 1e5, "altitude of each row of the table", ROWS_MAX, 2, ascending=True),
    ] = None
    east_table_mps: Annotated[
        tuple[float, ...] | None,
        Series("m/s", -1000.0, 1000.0, "wind of each row, held outside", ROWS_MAX, 2),
    ] = None
    north_table_mps: Annotated[
        tuple[float, ...] | None,
        Series("m/s", -1000.0, 1000.0, "likewise to the north", ROWS_MAX, 2),
    ] = None
    sigma_ground_mps: Annotated[
        float, Quantity("m/s", 0.0, 500.0, "random part of each at altitude 0, one sigma")
    ] = 0.0
    sigma_top_mps: Annotated[
        float, Quantity("m/s", 0.0, 500.0, "and at sigma_top_km; linear between, held above")
    ] = 0.0
    sigma_top_km: Annotated[float, Quantity("km", 1.0, 1e4, "see above")] = 100.0
    correlation_km: Annotated[
        float, Quantity("km", 1e-3, 1e4, "altitude over which its correlation falls to 1/e")
    ] = 10.0

    @model_validator(mode="after")
    def has_a_whole_table(self) -> Self:
        """Altitudes with at least one column of their length, or none of it."""
        columns = [c for c in (self.east_table_mps, self.north_table_mps) if c is not None]
        rows = [self.table_altitude_km] if self.table_altitude_km is not None else []
        if bool(columns) != bool(rows):
            raise refusal(
                "has part of a table, allowed table_altitude_km with east_table_mps, "
                "north_table_mps or both"
            )
        lengths = {len(column) for column in (*columns, *rows)}
        if len(lengths) > 1:
            raise refusal(f"has lists of {sorted(lengths)} values, allowed lists of one length")
        return self
