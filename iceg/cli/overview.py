"""What `iceg --help` says."""

import itertools
import textwrap

from iceg.cli.commands import COMMANDS

_WIDTH = 100
_HEAD = (
    "usage: iceg COMMAND ...\n\n2D laser SLAM for recordings: a ROS bag or a log in, trajectory, graph and maps out."
)
_TAIL = """\
Every command has --help, and --help-all for all of its settings. Angles are in degrees: 20, 20deg, 0.35rad.
  --version      of iceg, what it rests on, and which extras are installed
  --completion   bash, zsh or fish: prints what completes commands and flags in that shell
  --debug        with any command: the traceback of an error of iceg itself

Exit codes: 0 done; 1 something is wrong with a file, its data or the disk; 2 with the arguments or settings;
70 an error of iceg itself, please report it; 128 + n ended by signal n, such as 130 by Ctrl-C."""


def overview() -> str:
    """All commands by what they are about, and what holds for every one."""
    width = max(map(len, COMMANDS)) + 2
    lines = [_HEAD]
    for group, entries in itertools.groupby(COMMANDS.items(), key=lambda item: item[1].group):
        lines.append(f"\n{group}")
        for name, entry in entries:
            first = (entry.kind.__doc__ or "").partition("\n")[0]
            head = f"  {name:<{width}}"
            lines += textwrap.wrap(first, _WIDTH, initial_indent=head, subsequent_indent=" " * len(head))
    return "\n".join([*lines, "", _TAIL])
