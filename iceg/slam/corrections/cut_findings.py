"""What a run has found, for fewer scans: as if the others had been left out, but for what was learned from them."""

from iceg.slam.corrections.cut import KeptScans
from iceg.slam.corrections.errors import CorrectionsError
from iceg.slam.findings import Findings


def cut_findings(findings: Findings, kept: KeptScans, where: str) -> Findings:
    """The findings of a run for some of its scans.

    Args:
        findings: of the run.
        kept: the scans that are left.
        where: file and line that ask for it, for messages.

    Raises:
        CorrectionsError: scans are asked for that the run did not take part in.
    """
    raise CorrectionsError(
        f"{where}: other scans are cut than the run left out, expected the same: run the log again with these "
        "corrections"
    )
