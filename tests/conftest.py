"""What several test files share."""

import os
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).parent.parent


@pytest.fixture(scope="session")
def data_dir() -> Path:
    """The folder of public real logs: `ICEG_DATA`, or `../shared/data` seen from the repository."""
    folder = Path(os.environ.get("ICEG_DATA", REPOSITORY.parent / "shared" / "data"))
    if folder.is_dir():
        return folder
    reason = f"no folder of real logs at {folder} (set ICEG_DATA)"
    if os.environ.get("CI", "").lower() in {"true", "1"}:
        pytest.fail(reason)
    pytest.skip(reason)
