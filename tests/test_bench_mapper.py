"""What a scan costs a mapper, measured on a short log."""

import iceg
from iceg.evaluation.bench.mapper import mapper_row
from iceg.mapper import Event

N_SCANS = 400


def test_a_row_tells_what_scans_cost_and_how_far_off_they_are() -> None:
    row = mapper_row(iceg.read_log(iceg.demo_log_path()).select(slice(N_SCANS)))
    assert row["scans"] == N_SCANS
    costs = [float(str(row[f"{share} % [ms]"])) for share in (50, 99, 99.9, 100)]
    assert costs == sorted(costs)
    assert costs[0] > 0.0
    assert 0 < int(str(row["key poses"])) < N_SCANS
    assert row[Event.LOST.value] == 0
    for poses in ("off the run's, at once [m]", "in the end [m]"):
        assert 0.0 < float(str(row[poses])) < 0.1
