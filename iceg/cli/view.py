"""The page of a run in the browser, with buttons that correct the run."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro


@dataclass(frozen=True, kw_only=True)
class View:
    """Open a run in the browser and correct it there, solved at once and saved."""

    directory: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="DIR", help="Folder of a run.")]
    port: Annotated[int, tyro.conf.arg(help="To listen on, on this machine only; 0 for any that is free.")] = 0
    browser: Annotated[
        tyro.conf.FlagCreatePairsOff[bool],
        tyro.conf.arg(help="Only serve the page, and open no browser.", help_behavior_hint=""),
    ] = True

    def __call__(self) -> None:
        """Serve until Ctrl-C."""
        from iceg.cli.options import UsageError
        from iceg.cli.run_log import tell_stale_files
        from iceg.results import check_directory
        from iceg.show.progress import compile_note, prepare_kernels

        if not 0 <= self.port < 2**16:
            raise UsageError(f"found --port {self.port}, expected 0 to 65535")
        check_directory(self.directory, overwrite=True)
        with compile_note():
            prepare_kernels()
            from iceg.view.server import ViewServer
            from iceg.view.session import CORRECTIONS, Session

            session = Session(self.directory)
            if session.is_corrected:
                print(f"solved anew with the corrections in {self.directory / CORRECTIONS}")
        with ViewServer(session, self.port) as server:
            try:
                print(f"{self.directory} is at {server.address}", flush=True)
                print("Ctrl-C ends it", flush=True)
                if self.browser:
                    _open(server.address)
                server.serve_forever(poll_interval=0.2)
            except KeyboardInterrupt:
                session.wait()
        saved = self.directory / CORRECTIONS
        print(f"\nThe corrections are in {saved}" if saved.exists() else "\nNothing was corrected")
        tell_stale_files(self.directory)


def _open(address: str) -> None:
    import webbrowser

    webbrowser.open(address)
