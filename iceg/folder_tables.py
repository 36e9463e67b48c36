"""The tables of a run read back from its folder."""

from pathlib import Path

from graph.g2o import read_g2o
from iceg.config import read_config
from iceg.result_tables import RunTables
from iceg.results import ResultsError, whole_results
from iceg.run_folder import read_run_folder


def read_run_tables(directory: Path | str) -> RunTables:
    """Read all that `SlamResult.tables` has from the folder of a run.

    What `features.geojson` has no room for is not in it: `distance_m` of landmarks is NaN, and a lone wall direction
    stands first, on whichever side the wall is.

    Args:
        directory: of the results.

    Raises:
        IcegError: a file is missing or not as expected, named; or the files are not those of one run.
    """
    directory = Path(directory)
    folder = read_run_folder(directory)
    with whole_results(directory):
        graph, front_end = read_g2o(directory / "graph.g2o"), read_config(directory / "config.toml").front_end
    if len(graph.poses) != len(folder.key_scans):
        raise ResultsError(
            f"{directory / 'graph.g2o'}: found {len(graph.poses)} poses, but covariances.csv has "
            f"{len(folder.key_scans)}; expected the files of one run"
        )
    return RunTables(
        stamps=folder.trajectory.stamps,
        trajectory=folder.trajectory.poses,
        key_scans=folder.key_scans,
        key_poses=folder.key_poses,
        covariances=folder.covariances,
        tracking=(front_end.tracking_distance, front_end.tracking_angle),
        closures=folder.closures,
        landmarks=folder.landmarks,
        factors=graph.factors,
    )
