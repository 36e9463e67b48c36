"""Settings, flags and experiments."""

from collections.abc import Iterator
from pathlib import Path

from tests.fuzz.cases.case import LONG, Case, text_file
from tests.fuzz.seeds import experiment, flaser


def settings() -> Iterator[Case]:
    """TOML files for `iceg config --config` and flags."""

    def toml(name: str, text: str | bytes) -> Case:
        return Case(name=f"settings {name}", words=("config", "--config", "x.toml"), make=text_file("x.toml", text))

    yield toml("integer of 400 digits", f"seed = {'9' * 400}\n")
    yield toml("integer of 5,000 digits", f"seed = {LONG}\n")
    yield toml("float of an integer of 400 digits", f"[grid]\nresolution = {'9' * 400}\n")
    yield toml("nested 5,000 deep", "a = " + "[" * 5000 + "]" * 5000)
    yield toml("tables nested 5,000 deep", "[" + ".".join(["a"] * 5000) + "]\n")
    yield toml("NUL", b"[grid]\nmode = '\0'\n")
    yield toml("Latin-1", "# ü\n".encode("latin-1"))
    yield toml("not TOML", "==\n" * 10)
    yield toml("a list of 400 digits", f"[loops]\nsupport_offsets = [{'9' * 400}]\n")
    for key in (
        "grid.resolution",
        "grid.max_range",
        "ice.local_map.cell",
        "ice.hypotheses.field_sigma",
        "log.range_max",
    ):
        for value in ("1e-300", "1e308", "-1.0", "nan", "inf", "0.0", "1e-9"):
            yield toml(f"{key} = {value}", f"{key} = {value}\n")
    for words in (
        ("--grid.max-range", "1e308"),
        ("--grid.resolution", "1e-300"),
        ("--grid.resolution", "1e-9", "--grid.max-cells", "1000000000000000"),
        ("--seed", "9" * 400),
        ("--seed", LONG),
        ("--config", "/dev/zero"),
        ("--config", "~nosuchuser/x.toml"),
        ("--config", "n" * 300),
        ("--config", "."),
    ):
        yield Case(
            name=f"flags {' '.join(words)[:50]}",
            words=("run", "x.clf", "-o", "out", *words),
            make=text_file("x.clf", "\n".join(flaser(k) for k in range(8)) + "\n"),
        )


def experiments() -> Iterator[Case]:
    """Experiments for `iceg bench`: all of them wrong, so that nothing is run."""

    def bench(name: str, text: str) -> Case:
        def make(folder: Path) -> None:
            (folder / "x.clf").write_text("\n".join(flaser(k) for k in range(3)) + "\n")
            (folder / "x.toml").write_text(text)

        return Case(name=f"experiment {name}", words=("bench", "x.toml", "-o", "out"), make=make)

    values = ", ".join(str(0.01 + 0.001 * k) for k in range(59))
    keys = ("grid.resolution", "grid.max_range", "loops.radius", "finish.tolerance", "ice.segments.gap")
    yield bench("59^5 runs", experiment("[sweep]\n" + "".join(f'"{key}" = [{values}]\n' for key in keys)))
    yield bench("~nosuchuser", experiment(log="~nosuchuser/x"))
    yield bench("NUL in a path", experiment(log="x\\u0000y"))
    yield bench("a name too long", experiment(log="n" * 5000))
    yield bench("/dev/zero", experiment(log="/dev/zero"))
    yield bench("seed of 400 digits", experiment(f"seeds = [{'9' * 400}]\n", before=True))
    yield bench("limit of 400 digits", experiment(f"time_limit_s = {'9' * 400}\n", before=True))
    yield bench("limit 1e-320", experiment("time_limit_s = nan\n", before=True))
    yield bench("sweep nested deep", experiment("[sweep]\na" + ".a" * 3000 + " = [1]\n"))
    yield bench("list nested deep", "methods = " + "[" * 5000)
    yield bench("settings nested deep", experiment(method="{method = 'ice', settings = {" + "a={" * 900 + "}" * 902))
