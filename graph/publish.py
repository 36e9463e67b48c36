"""Several files of a folder replaced in one step: a reader sees all of the old ones or all of the new ones.

While that goes on, each of the names is a symbolic link through one further link, `.iceg-publishing/current`:

    trajectory.tum -> .iceg-publishing/current/trajectory.tum        current -> old, then -> new

First `current` leads to the old files, which hard links keep there; then each name becomes such a link, which changes
nothing for a reader; then `current` is replaced by a link to the new files. This rename is the one step in which all
names change. At last the new files take the place of the links, which again changes nothing, and `.iceg-publishing` is
removed: plain files are left. A name that only the old or only the new files have is a link that leads nowhere at the
other time, which is as good as no file.

- Whatever kills the process, at any system call, any program that opens the names finds the whole old result or the
  whole new one. The same holds for a power cut: what a step builds upon is on the disk (fsync) before it is taken.
- The next publication into the folder ends a broken one first: it makes files of the links, old or new as `current`
  says, and removes the rest. Reading needs nothing of that.
- Nothing but the names published is touched. The folder itself stays, so it may be the current one, a mount point or
  the end of a link, and its parent need not be writable.
- A lock on the folder (flock, which ends with its process) lets one publication at a time go on; others wait. Some
  network file systems have no such locks: two publications at a time are not kept apart there.
- Where there are no symbolic links (FAT), the files are renamed one by one. A process killed in between leaves a
  mixture there; `iceg.results` recognises one by the digests in `summary.json`.

A reader that opens one file before the step and another after it has one of each: `iceg.results.whole_results` tells.
"""

import errno
import os
import shutil
from collections.abc import Collection, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from graph.atomic import sync_folder
from graph.deferred_signals import signals_deferred
from graph.locks import locked

WORKSHOP = ".iceg-publishing"
"""The folder inside the one that is published into, while that goes on or after it was killed."""
_OLD, _NEW, _CURRENT, _NEXT, _LINK = "old", "new", "current", "next", "link"
_OURS = frozenset((_OLD, _NEW, _CURRENT, _NEXT, _LINK))


@contextmanager
def publishing(directory: Path, *, replaces: Collection[str] = ()) -> Iterator[Path]:
    """A folder for new files, which take the place of those in `directory` in one step when the block ends well.

    Args:
        directory: where they go; made when missing, and then removed when the block fails.
        replaces: names of files of the same result, which go where the block has not written them.

    Yields:
        The folder to write files into.

    Raises:
        OSError: the files cannot be written, or something that is no file is in their place.
    """
    with _only_writer(directory):
        _settle(directory)
        staging = directory / WORKSHOP / _NEW
        try:
            with signals_deferred():
                staging.mkdir(parents=True)
            yield staging
            with signals_deferred():
                _publish(directory, replaces)
        except BaseException:
            with signals_deferred():
                _settle(directory)
            raise


def settle(directory: Path) -> None:
    """End a publication into a folder that was killed: what it left is removed, the files are all old or all new.

    Raises:
        OSError: the folder cannot be written to, or holds something under our name that is not ours.
    """
    if os.path.lexists(directory / WORKSHOP):
        with _only_writer(directory):
            _settle(directory)


def check_replaceable(directory: Path, names: Collection[str]) -> None:
    """Make sure that what is in a folder under some names is files, or links to files.

    Raises:
        FileExistsError: something else is.
    """
    for name in names:
        path = directory / name
        if path.exists() and not path.is_file():
            raise FileExistsError(errno.EEXIST, "is in the place of a file of the results, and no file", str(path))


@contextmanager
def _only_writer(directory: Path) -> Iterator[None]:
    """Hold the folder's lock; the folder is made when missing, and removed again if it stays empty."""
    is_new = False

    def make() -> None:
        nonlocal is_new
        is_new = not directory.exists()
        directory.mkdir(parents=True, exist_ok=True)

    def open_it() -> int:
        make()
        return os.open(directory, os.O_RDONLY)

    try:
        if os.name == "posix":
            with locked(directory, open_it):
                yield
        else:  # folders cannot be opened, nor locked
            make()
            yield
    except BaseException:
        if is_new:
            with suppress(OSError):  # it is not empty
                directory.rmdir()
        raise


def _publish(directory: Path, replaces: Collection[str]) -> None:
    workshop = directory / WORKSHOP
    old, new = workshop / _OLD, workshop / _NEW
    written = sorted(path.name for path in new.iterdir())
    names = [*written, *(name for name in replaces if name not in written and os.path.lexists(directory / name))]
    check_replaceable(directory, names)
    for name in written:
        _sync_file(new / name)
    old.mkdir()
    for name in names:
        _keep(directory / name, old / name)
    try:
        (workshop / _CURRENT).symlink_to(_OLD)
    except OSError:
        _replace_one_by_one(new, directory, names)
    else:
        for folder in (new, old, workshop):
            sync_folder(folder)
        _replace_at_once(directory, names)
    _settle(directory)


def _replace_at_once(directory: Path, names: Collection[str]) -> None:
    workshop = directory / WORKSHOP
    link = workshop / _LINK
    for name in names:
        link.symlink_to(f"{WORKSHOP}/{_CURRENT}/{name}")
        link.replace(directory / name)
    sync_folder(directory)
    following = workshop / _NEXT
    following.symlink_to(_NEW)
    following.replace(workshop / _CURRENT)  # the one step
    sync_folder(workshop)


def _replace_one_by_one(new: Path, directory: Path, names: Collection[str]) -> None:
    for name in names:
        _put(new / name, directory / name)
    sync_folder(directory)


def _settle(directory: Path) -> None:
    """Make files of the links and remove the workshop; whatever kills this, it can be done again."""
    workshop = directory / WORKSHOP
    if not os.path.lexists(workshop):
        return
    _check_is_ours(workshop)
    current = workshop / _CURRENT
    if current.is_symlink():
        source = workshop / current.readlink()
        for path in list(directory.iterdir()):
            if path.is_symlink() and path.readlink() == Path(WORKSHOP, _CURRENT, path.name):
                _put(source / path.name, path)
        sync_folder(directory)
    shutil.rmtree(workshop)


def _check_is_ours(workshop: Path) -> None:
    if workshop.is_symlink() or not workshop.is_dir() or not _OURS.issuperset(os.listdir(workshop)):  # noqa: PTH208
        raise FileExistsError(errno.EEXIST, "has the name of iceg's temporary folder, and is none", str(workshop))


def _put(source: Path, target: Path) -> None:
    """Move a file to its place; where there is none, nothing is to be there."""
    if os.path.lexists(source):
        source.replace(target)
    else:
        target.unlink(missing_ok=True)


def _keep(path: Path, kept: Path) -> None:
    """A second name for a file, if there is one; a copy, on disk, where the file system has no second names."""
    if not path.exists():
        return
    if not path.is_symlink():
        try:
            kept.hardlink_to(path)
        except OSError:
            pass
        else:
            return
    shutil.copy2(path, kept)
    _sync_file(kept)


def _sync_file(path: Path) -> None:
    with path.open("rb") as file:
        os.fsync(file.fileno())
