"""A folder of results concluded anew: what the run found, corrected by hand, without matching again."""

from pathlib import Path
from types import NoneType
from typing import TYPE_CHECKING

from frontends.checked_arguments import expect
from iceg.corrections.corrections import CORRECTIONS_EXPECTED, Corrections
from iceg.findings_file.codec import read_findings
from iceg.results import FINDINGS, ResultsError, read_summary, whole_results
from iceg.slam.kept_scans import KeptScans

if TYPE_CHECKING:
    from iceg.run_result.slam_result import SlamResult
    from iceg.slam.findings import Findings


def findings_of(directory: Path | str) -> "Findings":
    """What the run found that has written a folder.

    Raises:
        IcegError: the folder is none of a run's, or its file of findings cannot be read.
    """
    directory = Path(directory)
    if not directory.is_dir():
        raise ResultsError(f"{directory}: is no folder, expected one that a run has written")
    if not (directory / FINDINGS).exists():
        raise ResultsError(
            f"{directory}: holds no {FINDINGS}, expected a folder that 'iceg run' of this version has written"
        )
    with whole_results(directory):
        return read_findings(directory / FINDINGS)


def handed_back(corrections: Corrections, directory: Path | str) -> Corrections:
    """The corrections, a `closures.csv` among them being that of a folder, which counts scans as its results do.

    Args:
        corrections: scans counted as recorded, but for the rows of `closures.csv`.
        directory: that the rows are from.

    Raises:
        IcegError: the folder holds no readable summary, or other scans.
    """
    cut = read_summary(directory).get("cut") if corrections.verdicts else None
    return corrections.handed_back_from(KeptScans.from_record(cut)) if isinstance(cut, dict) else corrections


def resolve(directory: Path | str, corrections: Corrections | None = None) -> "SlamResult":
    """Conclude a run anew from its folder, corrected; the folder stays as it is.

    Args:
        directory: that a run has written.
        corrections: all that a person corrects, scans counted as recorded, but those of a `closures.csv` as in the
            folder; those the run was given count no more.

    Returns:
        The same as `run`.

    Raises:
        IcegError: the folder cannot be read, or a correction does not fit the log.
        TypeError: an argument of another type.
    """
    from iceg import pipeline

    expect(directory, (Path, str), "directory", "the path of a folder that a run has written")
    expect(corrections, (Corrections, NoneType), "corrections", CORRECTIONS_EXPECTED)
    findings = findings_of(directory)
    return pipeline.resolve(findings, handed_back(corrections, directory) if corrections else None)
