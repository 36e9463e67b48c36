"""Commands on the folder of a run: conclude it anew, corrected by hand."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from graph.counted import counted
from iceg.cli.options import CorrectionsFile, GivenPath, Overwrite


@dataclass(frozen=True, kw_only=True)
class Resolve:
    """Solve a run again from its folder, corrected by hand, without matching anew."""

    directory: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="DIR", help="Folder of a run.")]
    corrections: CorrectionsFile = None
    output: Annotated[
        GivenPath,
        tyro.conf.arg(
            aliases=["-o"],
            metavar="OTHER",
            help="Folder for the results; unless given, they replace those in DIR.",
            help_behavior_hint="(optional)",
        ),
    ] = None
    overwrite: Overwrite = False

    def __call__(self) -> None:
        """Read, conclude, write."""
        import time

        from iceg.cli.run_log import tell_result_warnings, tell_stale_files, what_was_kept, written_at
        from iceg.corrections.reading import read_all_corrections
        from iceg.results import check_directory, write_results
        from iceg.show.progress import compile_note, prepare_kernels

        target = self.output or self.directory
        replaces = self.overwrite or self.output is None
        check_directory(target, overwrite=replaces)
        before, started = written_at(target), time.perf_counter()
        try:
            with compile_note():
                prepare_kernels()
                from iceg.resolving import resolve
                from iceg.slam.closures.closure import joined_scans

                asked = read_all_corrections([] if self.corrections is None else [self.corrections])
                result = resolve(self.directory, asked)
                write_results(result, target, overwrite=replaces)
        except KeyboardInterrupt:
            raise KeyboardInterrupt(what_was_kept(target, before)) from None
        tell_result_warnings(result)
        closures = f"{len(joined_scans(result.closures))} of {len(result.closures)} loop closures tried hold"
        seconds = time.perf_counter() - started
        print(f"{counted(len(result.key_scans), 'key pose')} in {seconds:.1f} s, nothing matched anew; {closures}")
        print(f"Results are in {target}")
        tell_stale_files(target)
