"""What DP-SLAM leaves behind: the files of a run of ours, as far as a particle filter has them."""

from pathlib import Path

from frontends.dp_slam import DpSlamConfig, DpSlamResult
from frontends.scan import Log
from iceg.maps.grid import OccupancyGrid, write_ros_map
from iceg.results import write_folder
from iceg.settings_file import format_settings
from iceg.tum import format_tum

DP_SLAM_FILES = ("trajectory.tum", "map.pgm", "map.yaml", "map.png", "config.toml", "summary.json")

_HEADING = "Settings of DP-SLAM: SI units, angles in radians. Leave a key out to get its default."


def occupancy_grid(result: DpSlamResult) -> OccupancyGrid:
    """The best particle's map as an occupancy grid: the probability that a cell stops a beam, as log-odds."""
    return OccupancyGrid(log_odds=result.log_odds(), origin=result.origin, resolution=result.resolution)


def write_dp_slam_results(
    result: DpSlamResult, log: Log, config: DpSlamConfig, directory: Path, *, overwrite: bool = False
) -> None:
    """Write trajectory, map, picture, settings and summary, all files or none.

    There is no graph, no covariance, no closure and no landmark to write: a particle filter has none.

    Args:
        result: what the filter found.
        log: in which log.
        config: with which settings.
        directory: made when missing.
        overwrite: whether earlier results in it may be replaced.

    Raises:
        ResultsError: the folder is not empty, or cannot be written to.
    """
    grid = occupancy_grid(result)

    def trajectory(folder: Path) -> None:
        text = format_tum(log.stamps, result.trajectory)
        (folder / "trajectory.tum").write_text(text, encoding="utf-8", newline="\n")

    def ros_map(folder: Path) -> None:
        write_ros_map(grid, folder)

    def picture(folder: Path) -> None:
        from iceg.show.drawn_run import duration
        from iceg.show.map_image import MapLayers
        from iceg.show.map_picture import save_map_png

        layers = MapLayers(grid=grid, trajectory=result.trajectory, name=log.path.name, seconds=duration(log.stamps))
        save_map_png(folder / "map.png", layers)

    def settings(folder: Path) -> None:
        text = format_settings(config, heading=_HEADING)
        (folder / "config.toml").write_text(text, encoding="utf-8", newline="\n")

    writers = {"trajectory": trajectory, "map": ros_map, "picture": picture, "config": settings}
    write_folder(directory, writers, {**result.summary, "warnings": list(log.warnings)}, overwrite=overwrite)
