"""`make fuzz`: change sound inputs of every kind for as long as asked, and keep what breaks something."""

import argparse
import hashlib
import os
import random
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from tests.fuzz.mutations import mutate, mutate_lines
from tests.fuzz.sandbox import run_command
from tests.fuzz.targets import TARGETS, Target
from tests.fuzz.trial import attempt

CORPUS = Path(__file__).parents[1] / "fuzz_corpus"
"""Each finding is kept here, replayed by tests/test_fuzz.py."""

_BATCH = 400
"""Inputs that one process tries, so that one that dies takes few with it."""
_WHOLLY = 0.6
"""Share of the logs whose every line is changed."""
_USED = 50
"""Every so many accepted inputs are used, not only read."""
_COMMANDS = 5000
"""Every so many inputs go through the real command line as well."""
_TRIES = 200


@dataclass(slots=True)
class Tally:
    """What has been tried so far."""

    inputs: int = 0
    lines: int = 0
    accepted: int = 0
    commands: int = 0
    findings: Counter[str] = field(default_factory=Counter)


def inputs(seed: int, names: list[str]) -> Iterator[tuple[str, bytes]]:
    """Changed inputs of these kinds, for ever; the same ones for the same seed."""
    rng = random.Random(seed)
    while True:
        name = rng.choice(names)
        content = rng.choice(TARGETS[name].seeds)
        if TARGETS[name].goes_on and rng.random() < _WHOLLY:
            yield name, mutate_lines(content * rng.choice((1, 4, 16)), rng)
        else:
            yield name, mutate(content, rng)


def minimised(target: Target, folder: Path, content: bytes, finding: str) -> bytes:
    """The input without the lines and then the words that the finding does not need."""
    kind = finding.partition(":")[0]

    def shows(smaller: bytes) -> bool:
        return attempt(target, folder, smaller).finding.partition(":")[0] == kind

    tries = 0
    for separator in (b"\n", b" "):
        parts = content.split(separator)
        size = max(1, len(parts) // 2)
        while size >= 1 and tries < _TRIES:
            at = 0
            while at < len(parts) and tries < _TRIES:
                smaller = parts[:at] + parts[at + size :]
                tries += 1
                if smaller and shows(separator.join(smaller)):
                    parts = smaller
                else:
                    at += size
            size //= 2
        content = separator.join(parts)
    return content


def keep(name: str, content: bytes) -> Path:
    """Write a finding into the corpus, under the name of its target."""
    CORPUS.mkdir(exist_ok=True)
    path = CORPUS / f"{name}--{hashlib.sha256(content).hexdigest()[:10]}"
    path.write_bytes(content)
    return path


def _batch(chosen: list[tuple[str, bytes]], folder: Path, use: int) -> None:
    """Try inputs in this process; what it found is in the file `found` of the folder."""
    for target in {name: TARGETS[name] for name, _ in chosen}.values():
        if target.prepare:
            target.prepare(folder)
    accepted = 0
    with (folder / "found").open("w", encoding="utf-8") as found:
        for index, (name, content) in enumerate(chosen):
            (folder / "now").write_text(str(index))
            target = TARGETS[name]
            trial = attempt(target, folder, content, use=accepted % use == 0)
            accepted += trial.accepted
            if trial.finding:
                found.write(f"{index}\t{trial.finding}\n".replace("\r", " "))
                found.flush()
            if target.prepare:
                (folder / target.file).unlink(missing_ok=True)
                _restore(target, folder)
        (folder / "accepted").write_text(str(accepted))


def _restore(target: Target, folder: Path) -> None:
    path = folder / target.file
    if path.parent != folder:
        path.write_bytes(target.seeds[0])


def _in_a_process(chosen: list[tuple[str, bytes]], use: int, tally: Tally) -> list[tuple[int, str]]:
    """Try inputs in a process of their own: what was found, and the one it died of."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        child = os.fork()
        if child == 0:
            try:
                _batch(chosen, folder, use)
            finally:
                os._exit(0)
        _, status, usage = os.wait4(child, 0)
        told = (folder / "found").read_text(encoding="utf-8") if (folder / "found").exists() else ""
        findings = [(int(line.split("\t")[0]), line.split("\t")[1]) for line in told.splitlines() if "\t" in line]
        if os.waitstatus_to_exitcode(status) or not (folder / "accepted").exists():
            now = int((folder / "now").read_text() or 0)
            findings.append((now, f"the process died with {os.waitstatus_to_exitcode(status)}"))
        else:
            tally.accepted += int((folder / "accepted").read_text())
        del usage
        return findings


def _command(name: str, content: bytes) -> str:
    """The same input through the real command line."""
    target = TARGETS[name]
    if not target.words:
        return ""
    with tempfile.TemporaryDirectory() as given:
        folder = Path(given)
        if target.prepare:
            target.prepare(folder)
        target.write(folder, content)
        outcome = run_command(target.words, folder)
    return f"{outcome.finding} through the command line: {outcome.told[-200:]}" if outcome.finding else ""


def fuzz(seed: int, names: list[str], lines: int, seconds: float, use: int = _USED) -> Tally:
    """Try inputs until there were so many lines or it took so long."""
    tally, stream, started = Tally(), inputs(seed, names), time.perf_counter()
    _warm_up(names)
    told = started
    while tally.lines < lines and time.perf_counter() - started < seconds:
        chosen = [next(stream) for _ in range(_BATCH)]
        for index, finding in _in_a_process(chosen, use, tally):
            _tell(tally, *chosen[index], finding)
        if tally.inputs // _COMMANDS != (tally.inputs + len(chosen)) // _COMMANDS:
            for name, content in chosen[:3]:
                tally.commands += 1
                finding = _command(name, content)
                if finding:
                    _tell(tally, name, content, finding)
        tally.inputs += len(chosen)
        tally.lines += sum(content.count(b"\n") + 1 for _, content in chosen)
        if time.perf_counter() - told > 60:
            told = time.perf_counter()
            print(f"{tally.lines} lines, {tally.inputs} inputs, {tally.accepted} accepted", flush=True)
    return tally


def _warm_up(names: list[str]) -> None:
    """Load and compile all that the trials need once, before there are many processes of them."""
    with tempfile.TemporaryDirectory() as folder:
        for target in (TARGETS[name] for name in names):
            if target.prepare:
                target.prepare(Path(folder))
            attempt(target, Path(folder), target.seeds[-1])


def _tell(tally: Tally, name: str, content: bytes, finding: str) -> None:
    """Print a finding the first time, and keep the input."""
    kind = f"{name}: {finding.partition(': ')[0]}"
    tally.findings[kind] += 1
    if tally.findings[kind] > 1:
        return
    print(f"{name}: {finding}", flush=True)
    if "died" not in finding and "took" not in finding and "command line" not in finding:
        with tempfile.TemporaryDirectory() as folder:
            target = TARGETS[name]
            if target.prepare:
                target.prepare(Path(folder))
            content = minimised(target, Path(folder), content, finding)
    print(f"  kept as {keep(name, content)}", flush=True)


def main() -> int:
    """Parse, fuzz, tell."""
    parser = argparse.ArgumentParser(prog="make fuzz", description=__doc__)
    parser.add_argument("--lines", type=float, default=1e12, help="stop after so many lines of changed inputs")
    parser.add_argument("--minutes", type=float, default=None, help="stop after so long (10, unless --lines is given)")
    parser.add_argument("--seed", type=int, default=0, help="of the changes")
    parser.add_argument("--targets", nargs="*", choices=list(TARGETS), default=list(TARGETS), metavar="TARGET")
    parser.add_argument("--use", type=int, default=_USED, help="use, not only read, one in so many accepted inputs")
    given = parser.parse_args()
    minutes = given.minutes if given.minutes is not None else (10.0 if given.lines > 1e11 else 1e9)
    started = time.perf_counter()
    tally = fuzz(given.seed, given.targets, int(given.lines), 60.0 * minutes, given.use)
    print(
        f"{tally.lines} lines of {tally.inputs} inputs in {time.perf_counter() - started:.0f} s: {tally.accepted} "
        f"accepted, {tally.commands} through the command line, {tally.findings.total()} findings of "
        f"{len(tally.findings)} kinds"
    )
    return 1 if tally.findings else 0


if __name__ == "__main__":
    sys.exit(main())
