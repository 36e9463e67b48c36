"""The warnings of a run as places on its map."""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from iceg.run_result.slam_result import SlamResult


def warnings_payload(result: "SlamResult") -> list[dict[str, Any]]:
    """Kind, sentence and scan of each; no scan where it is about the whole run."""
    found: list[dict[str, Any]] = [
        {"kind": "log", "sentence": sentence, "scan": None} for sentence in result.log.warnings
    ]
    found += [
        {"kind": warning.kind, "sentence": warning.sentence, "scan": warning.scan} for warning in result.run_warnings
    ]
    told = {warning["scan"] for warning in found}
    found += [
        {"kind": "lost", "sentence": f"Nothing matched what was known before scan {scan}.", "scan": int(scan)}
        for scan in result.summary["lost_at_scans"]
        if scan not in told
    ]
    return found
