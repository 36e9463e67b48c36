"""What several test files share."""

import os
import signal
from pathlib import Path

import pytest
from hypothesis import settings

# Compiling a kernel inside an example is no slowness of the example; and CI draws the same examples every time.
settings.register_profile("here", deadline=None)
settings.register_profile("ci", deadline=None, derandomize=True)

REPOSITORY = Path(__file__).parent.parent
IN_CI = os.environ.get("CI", "").lower() in {"true", "1"}

settings.load_profile("ci" if IN_CI else "here")

if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:  # as in a shell's background, and the commands tested inherit it
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(scope="session")
def data_dir() -> Path:
    """The folder of public real logs: `ICEG_DATA`, or `../shared/data` seen from the repository."""
    folder = Path(os.environ.get("ICEG_DATA", REPOSITORY.parent / "shared" / "data"))
    if folder.is_dir():
        return folder
    reason = f"no folder of real logs at {folder} (set ICEG_DATA)"
    if IN_CI:
        pytest.fail(reason)
    pytest.skip(reason)
