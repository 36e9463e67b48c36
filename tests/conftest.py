"""What several test files share."""

import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

from iceg.kernels.ahead import compile_ahead

# Compiling a kernel inside an example is no slowness of the example. The same examples every time, kept nowhere: what
# one run finds, all find; `--hypothesis-profile others` draws new ones.
settings.register_profile("others", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.register_profile("same", settings.get_profile("others"), derandomize=True, database=None, max_examples=50)
settings.load_profile("same")

REPOSITORY = Path(__file__).parent.parent
IN_CI = os.environ.get("CI", "").lower() in {"true", "1"}

if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:  # as in a shell's background, and the commands tested inherit it
    signal.signal(signal.SIGINT, signal.default_int_handler)


_MEMORY_DISK, _ROOM = Path("/dev/shm"), 2 << 30


def pytest_configure(config: pytest.Config) -> None:
    """Compile before the workers begin: else each would compile for itself what both need first.

    The tests' folders lie in memory where there is room: some disks take half a minute to rename a thousand files.
    """
    if _MEMORY_DISK.is_dir() and shutil.disk_usage(_MEMORY_DISK).free > _ROOM:
        os.environ.setdefault("PYTEST_DEBUG_TEMPROOT", str(_MEMORY_DISK))
    is_worker = hasattr(config, "workerinput")
    if not is_worker and config.getoption("numprocesses", None) and os.environ.get("NUMBA_DISABLE_JIT") != "1":
        compile_ahead()
        _compile_rivals()


def _compile_rivals() -> None:
    """What the matchers of the literature call, about as much in either of two processes: 3 s where that was done."""
    together = (("icp", "plicp", "idc", "mbicp", "csm"), ("wsm", "qwsm", "ndt"))
    commands = [[sys.executable, "-m", "tests.rival_kernels", *names] for names in together]
    with ExitStack() as running:
        for process in [running.enter_context(subprocess.Popen(command, cwd=REPOSITORY)) for command in commands]:
            assert process.wait() == 0, process.args


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Tests that fork hundreds of times come first: a copy of a process takes five times as long once it has grown."""
    items.sort(key=lambda item: item.path.name != "test_publish.py")


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


@pytest.fixture(scope="session")
def own_jupyter(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Notebooks are run by this Python: what Jupyter has in the user's home is not looked at, nor written to."""
    folder = tmp_path_factory.mktemp("jupyter")
    with pytest.MonkeyPatch.context() as patch:
        patch.delenv("JUPYTER_PATH", raising=False)
        for name in ("JUPYTER_CONFIG_DIR", "JUPYTER_DATA_DIR", "JUPYTER_RUNTIME_DIR", "IPYTHONDIR"):
            patch.setenv(name, str(folder / name.lower()))
        yield
