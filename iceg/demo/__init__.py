"""The embedded log: a simulated office, with its truth."""

from importlib import resources
from pathlib import Path


def demo_log_path() -> Path:
    """The embedded log: CARMEN's format, gzip."""
    return _packaged("office.clf.gz")


def demo_truth_path() -> Path:
    """True poses of the embedded log: CSV `t_s,x_m,y_m,theta_rad`, one row per scan."""
    return _packaged("office.truth.csv")


def _packaged(name: str) -> Path:
    return Path(str(resources.files("iceg.demo") / name))
