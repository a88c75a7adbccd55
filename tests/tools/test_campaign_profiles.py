"""A profile holds what a flight's truth was when it was first as slow as each knot."""

import math

import numpy as np
import pyarrow.parquet as pq
import pytest

from sim_harness.world.records import TRUTH
from tools.campaign.folder import PROFILES
from tools.campaign.profiles import FIELDS, Spool, at_speeds, read_profiles

SPEEDS = np.array([1000.0, 2000.0, 3000.0, 4000.0])
DRAG = FIELDS.index("drag_mps2")


def truth(v_rel_mps, drag_mps2):
    rows = np.zeros(len(v_rel_mps), TRUTH)
    rows["v_rel_mps"], rows["drag_mps2"] = v_rel_mps, drag_mps2
    return rows


def test_knots_lie_on_the_straight_line_between_the_rows_and_are_open_beyond_them():
    found = at_speeds(truth([3500.0, 2500.0, 1500.0], [1.0, 3.0, 9.0]), SPEEDS)
    assert found[DRAG].tolist()[1:3] == [6.0, 2.0]
    assert np.isnan(found[:, [0, 3]]).all()


def test_the_first_time_at_a_speed_counts_when_a_vehicle_gains_speed_again():
    found = at_speeds(truth([3100.0, 2900.0, 3200.0, 2900.0, 1900.0], [1, 2, 50, 60, 70]), SPEEDS)
    assert found[DRAG][2] == 1.5
    assert found[DRAG][1] == pytest.approx(2.0 + 68.0 * 0.9, rel=1e-6)  # from the first 2,900 m/s


def test_a_heading_that_passes_south_is_no_turn():
    rows = truth([3500.0, 2500.0], [0.0, 0.0])
    rows["heading_rad"] = [math.radians(179.0), math.radians(-179.0)]
    found = at_speeds(rows, SPEEDS)[FIELDS.index("heading_rad")][2]
    assert math.degrees(found) == pytest.approx(180.0)


def test_no_row_is_no_profile():
    assert np.isnan(at_speeds(truth([], []), SPEEDS)).all()


def test_profiles_come_in_order_of_runs_whenever_they_were_kept(tmp_path):
    rows = {run: at_speeds(truth([4000.0, 900.0], [run, run]), SPEEDS) for run in (3, 1)}
    first = Spool(tmp_path, SPEEDS)
    first.add(3, rows[3].tobytes())
    first.close()
    again = Spool(tmp_path, SPEEDS)
    again.add(1, rows[1].tobytes())
    again.add(2, None)
    again.finish(3)
    again.close()
    found = read_profiles(tmp_path, 3)
    assert found.runs.tolist() == [1, 2, 3]
    assert found.speed_mps.tolist() == SPEEDS.tolist()
    assert found.fields["drag_mps2"][:, 0].tolist()[::2] == [1.0, 3.0]
    assert np.isnan(found.fields["drag_mps2"][1]).all()
    assert pq.read_table(tmp_path / PROFILES).column_names == ["run", *FIELDS]
