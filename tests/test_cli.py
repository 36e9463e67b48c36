"""The command line: what it takes, prints and returns."""

import json
import os
import shlex
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import iceg
from frontends.scan import Log
from graph.se2 import compose
from iceg import cli, results
from iceg.cli import main
from iceg.cli.judge import Eval
from iceg.cli.parsing import parse
from iceg.cli.run import Run
from iceg.cli.tools import PrintConfig
from iceg.config import Config, format_config, parse_config
from iceg.demo import demo_log_path, demo_truth_path
from iceg.maps.feature_map import FeatureMap
from iceg.slam.progress import Progress, ProgressCallback
from iceg.tum import format_tum

Array = NDArray[np.float64]
CompletedRun = SimpleNamespace


def iceg_process(*words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, "-m", "iceg", *words], capture_output=True, text=True, check=False)


def write_trajectory(path: Path, poses: Array) -> Path:
    path.write_text(format_tum(np.arange(len(poses)) / 5, poses))
    return path


def walk(n: int, seed: int = 0) -> Array:
    rng = np.random.default_rng(seed)
    poses = np.zeros((n, 3))
    for k in range(1, n):
        poses[k] = compose(poses[k - 1], rng.normal([0.2, 0, 0], [0.05, 0.01, 0.3]))
    return poses


def test_help_names_the_commands_and_loads_nothing_heavy() -> None:
    code = (
        "import sys, iceg.cli\n"
        "try: iceg.cli.main(['--help'])\n"
        "except SystemExit as done: assert not done.code\n"
        "sys.exit(', '.join(m for m in ('gtsam', 'numba', 'matplotlib', 'scipy') if m in sys.modules))"
    )
    words, env = [sys.executable, "-c", code], os.environ | {"PYTHONIOENCODING": "utf-8"}
    done = subprocess.run(words, capture_output=True, encoding="utf-8", check=False, env=env)
    assert done.stderr.strip() == ""
    for command in ("run", "demo", "info", "eval", "plot", "config"):
        assert f"\n  {command} " in done.stdout


def test_version_tells_of_iceg_and_what_it_rests_on(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--version"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == f"iceg {version('iceg')}"
    for name in ("gtsam", "numba", "numpy", "scipy"):
        assert f"{name} {version(name)}" in lines
    assert f"extra dxf: ezdxf {version('ezdxf')}" in lines
    assert not [line for line in lines if line.startswith("extra dev")]


def test_an_extra_that_is_not_installed_is_named_with_what_it_lacks(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = [
        "numpy>=2",
        "ezdxf<2,>=1.3; extra == 'dxf'",
        "no-such-package; extra == 'more'",
        "ruff>=0.8; extra == 'dev'",
    ]
    monkeypatch.setattr("iceg.cli.versions.requires", lambda _: asked)
    assert main(["--version"]) == 0
    extras = [line for line in capsys.readouterr().out.splitlines() if line.startswith("extra")]
    assert extras == [f"extra dxf: ezdxf {version('ezdxf')}", "extra more: not installed, lacks no-such-package"]


@pytest.mark.parametrize(("given", "expected"), [({}, "1"), ({"OPENBLAS_NUM_THREADS": "3"}, "3")])
def test_matrices_are_multiplied_by_one_thread_unless_the_user_wants_more(given: dict[str, str], expected: str) -> None:
    code = (
        "import os, sys\n"
        "from iceg.cli import main\n"
        "assert 'numpy' not in sys.modules, 'too late to tell NumPy'\n"
        "main(['--version'])\n"
        "sys.exit(os.environ['OPENBLAS_NUM_THREADS'])"
    )
    others = {name: value for name, value in os.environ.items() if not name.endswith("_NUM_THREADS")}
    words = [sys.executable, "-c", code]
    done = subprocess.run(words, capture_output=True, text=True, check=False, env=others | given)
    assert done.stderr.strip() == expected


@pytest.mark.parametrize("words", [["fly"], [], ["run"], ["run", "a.clf", "-o", "out", "--grid.resolutoin", "1"]])
def test_what_cannot_be_parsed_is_a_usage_error(words: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as done:
        main(words)
    assert done.value.code == 2
    assert capsys.readouterr().out == ""


def test_a_misspelt_flag_gets_a_suggestion() -> None:
    done = iceg_process("run", "a.clf", "-o", "out", "--grid.resolutoin", "1")
    assert done.returncode == 2
    assert "--grid.resolution" in done.stderr


def test_flags_override_the_file_which_overrides_the_defaults(tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    file.write_text("seed = 5\n[grid]\nresolution = 0.2\nmode = 'binary'\n")
    command = parse(["run", "a.clf", "-o", "out", "--config", str(file), "--grid.resolution", "0.1"])
    assert isinstance(command, Run)
    assert (command.log, command.output) == (Path("a.clf"), Path("out"))
    assert command.settings.seed == 5
    assert command.settings.grid.mode == "binary"
    assert command.settings.grid.resolution == 0.1
    assert command.settings.grid.max_range == Config().grid.max_range
    again = parse(["run", "--grid.resolution=0.1", f"--config={file}", "a.clf", "-o", "out"])
    assert isinstance(again, Run)
    assert again.settings == command.settings
    plain = parse(["run", "a.clf", "-o", "out"])
    assert isinstance(plain, Run)
    assert plain.settings == Config()


def test_a_run_without_flags_for_settings_is_parsed_as_one_with_them(tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    file.write_text("seed = 5\n")
    words = ["run", "a.clf", "-o", "out", "--config", str(file), "--closures=by-hand.csv", "--skip-bad-lines"]
    command = parse(words)
    assert command == parse([*words, "--seed", "5"])
    assert isinstance(command, Run)
    assert (command.closures, command.skip_bad_lines, command.overwrite) == (Path("by-hand.csv"), True, False)
    assert parse([*words, "--overwrite"]) == parse(["run", "--overwrite", "--seed=5", *words[1:]])


def test_parsing_a_run_loads_only_what_it_needs() -> None:
    code = (
        "import sys, iceg.cli.parsing\n"
        "iceg.cli.parsing.parse(['run', 'a.clf', '-o', 'out'])\n"
        "sys.exit(', '.join(m for m in ('gtsam', 'numba', 'typeguard', 'asyncio', 'unittest') if m in sys.modules))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.stderr.strip() == ""


def test_config_prints_a_file_that_reads_back(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["config"]) == 0
    text = capsys.readouterr().out
    assert text == format_config(Config())
    assert parse_config(text) == Config()
    file = tmp_path / "mine.toml"
    file.write_text("[grid]\nresolution = 0.2\n")
    command = parse(["config", "--config", str(file), "--seed", "3"])
    assert isinstance(command, PrintConfig)
    assert (command.settings.seed, command.settings.grid.resolution) == (3, 0.2)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[grid]\nresolutoin = 1\n", "did you mean 'grid.resolution'?"),
        ("[grid]\nresolution = -1\n", "grid.resolution: "),
    ],
)
def test_bad_settings_in_a_file_are_a_usage_error(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], text: str, message: str
) -> None:
    file = tmp_path / "mine.toml"
    file.write_text(text)
    assert main(["run", "a.clf", "-o", str(tmp_path / "out"), "--config", str(file)]) == 2
    error = capsys.readouterr().err
    assert error.startswith(f"iceg: {file}: ")
    assert message in error
    assert error.count("\n") == 1


def test_a_flag_out_of_range_is_a_usage_error(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["run", "a.clf", "-o", str(tmp_path / "out"), "--grid.resolution", "-1"]) == 2
    assert "resolution is -1.0" in capsys.readouterr().err


def test_eval_prints_the_published_figures(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    poses = walk(30)
    trajectory = write_trajectory(tmp_path / "t.tum", poses)
    rng = np.random.default_rng(1)
    rows = [(i, j, *rng.normal(0, 1, 3), 1 if k % 4 else 0) for k, (i, j) in enumerate(rng.integers(0, 30, (20, 2)))]
    file = tmp_path / "a.relations.csv"
    file.write_text(
        "scan_i,scan_j,x_m,y_m,theta_rad,certain\n" + "".join(",".join(map(str, row)) + "\n" for row in rows)
    )
    assert main(["eval", str(trajectory), "--relations", str(file), "--json"]) == 0
    figures = json.loads(capsys.readouterr().out)

    distances, angles = [], []
    for i, j, x, y, theta, certain in rows:
        if certain:
            dx, dy = poses[j, :2] - poses[i, :2]
            c, s = np.cos(poses[i, 2]), np.sin(poses[i, 2])
            distances.append(np.hypot(c * dx + s * dy - x, c * dy - s * dx - y))
            turn = poses[j, 2] - poses[i, 2] - theta
            angles.append(abs(np.degrees(np.arctan2(np.sin(turn), np.cos(turn)))))
    expected = {
        "n": len(distances),
        "trans_mean": np.mean(distances),
        "trans_std": np.std(distances, ddof=1),
        "trans_median": np.median(distances),
        "trans_p95": np.percentile(distances, 95),
        "trans_max": np.max(distances),
        "rot_mean_deg": np.mean(angles),
        "rot_std_deg": np.std(angles, ddof=1),
        "rot_median_deg": np.median(angles),
        "rot_max_deg": np.max(angles),
    }
    for name, value in expected.items():
        assert figures[name] == pytest.approx(float(value), abs=0.51e-5), name
        assert figures[name] == round(figures[name], 5)
    assert figures["dropped"] == 5
    assert main(["eval", str(trajectory), "--relations", str(file)]) == 0
    table = capsys.readouterr().out
    assert f"{figures['trans_mean']:.5f}" in table
    assert "translation, mean [m]" in table


def test_eval_against_a_reference_and_the_truth(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    poses = walk(40)
    noise = np.random.default_rng(2).normal(0, 0.1, (40, 3))
    trajectory = write_trajectory(tmp_path / "t.tum", compose([1, 2, 3], poses + noise))
    truth, reference = tmp_path / "truth.csv", tmp_path / "reference.csv"
    truth.write_text("t_s,x_m,y_m,theta_rad\n" + "".join(f"0,{x:.9f},{y:.9f},{h:.9f}\n" for x, y, h in poses))
    reference.write_text(
        "scan,x_m,y_m,theta_rad\n" + "".join(f"{k},{x:.9f},{y:.9f},{h:.9f}\n" for k, (x, y, h) in enumerate(poses))
    )
    assert main(["eval", str(trajectory), "--truth", str(truth), "--json"]) == 0
    by_truth = json.loads(capsys.readouterr().out)
    assert main(["eval", str(trajectory), "--reference", str(reference), "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == by_truth | {"truth_format": "CSV by scan"}
    assert list(by_truth) == [
        "n", "ate_rmse", "ate_max", "x_mean_abs", "y_mean_abs", "x_var", "y_var", "rot_rmse_deg",
        "rpe_1m_trans_rmse", "rpe_1m_rot_rmse_deg", "rpe_1s_trans_rmse", "rpe_1s_rot_rmse_deg",
        "truth_format", "paired_by", "verdict",
    ]  # fmt: skip
    assert by_truth["n"] == 40
    assert by_truth["ate_rmse"] == pytest.approx(0.14, abs=0.03)


def test_eval_of_a_run_folder_judges_its_covariances(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    truth = walk(400)
    rng = np.random.default_rng(3)
    errors = rng.normal(0, [0.02, 0.03, 0.01], (400, 3))
    errors[0] = 0
    estimated = compose(truth, errors)
    write_trajectory(tmp_path / "trajectory.tum", estimated)
    covariance = np.diag([4e-4, 9e-4, 1e-4])
    result: Any = SimpleNamespace(
        key_scans=np.arange(0, 400, 2), key_poses=estimated[::2], covariances=np.broadcast_to(covariance, (200, 3, 3))
    )
    results._write_covariances(result, tmp_path)
    file = tmp_path / "truth.csv"
    file.write_text("t_s,x_m,y_m,theta_rad\n" + "".join(f"0,{x:.12f},{y:.12f},{h:.12f}\n" for x, y, h in truth))
    assert main(["eval", str(tmp_path), "--truth", str(file), "--json"]) == 0
    figures = json.loads(capsys.readouterr().out)
    assert figures["nees_n"] == 199
    assert figures["nees_low"] < figures["nees_mean"] < figures["nees_high"]


@pytest.mark.parametrize(
    ("words", "code", "message"),
    [
        (["eval", "TRAJECTORY"], 2, "expected exactly one"),
        (["eval", "TRAJECTORY", "--reference", "a.csv", "--truth", "b.csv"], 2, "found 2 of"),
        (["eval", "TRAJECTORY", "--relations", "a.relations"], 2, "--log"),
        (["eval", "TRAJECTORY", "--truth", "b.csv", "--log", "a.clf"], 2, "--log is only needed"),
        (["eval", "TRAJECTORY", "--truth", "missing.csv"], 1, "missing.csv: cannot be read"),
        (["eval", "missing.tum", "--truth", "TRUTH"], 1, "missing.tum: cannot be read"),
        (["eval", "TRAJECTORY", "--truth", "TRUTH"], 1, "holds 1 poses, the trajectory 3"),
        (
            ["eval", "TRAJECTORY", "--reference", "ONE"],
            1,
            "one.csv: found 1 pose to compare, an alignment needs at least",
        ),
        (["info", "missing.clf"], 1, "missing.clf"),
        (["run", "missing.clf", "-o", "OUT"], 1, "missing.clf"),
        (["plot", "missing-folder"], 1, "missing-folder"),
        (["run", "missing.clf", "-o", "BELOW_A_FILE"], 1, "truth.csv is a file, expected a folder"),
        (["bench", "--parts", "recall", "-o", "BELOW_A_FILE"], 1, "truth.csv is a file, expected a folder"),
        (["ablation", "-o", "BELOW_A_FILE"], 1, "truth.csv is a file, expected a folder"),
        (["nees", "-o", "BELOW_A_FILE"], 1, "truth.csv is a file, expected a folder"),
        (["simulate", "room", "-o", "OUT", "--seed", "-1"], 2, "found --seed -1, expected 0 or more"),
    ],
)
def test_errors_are_one_clear_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], words: list[str], code: int, message: str
) -> None:
    truth = tmp_path / "truth.csv"
    truth.write_text("t_s,x_m,y_m,theta_rad\n0,0,0,0\n")
    (tmp_path / "one.csv").write_text("scan,x_m,y_m,theta_rad\n0,0,0,0\n")
    places = {
        "TRAJECTORY": str(write_trajectory(tmp_path / "t.tum", walk(3))),
        "TRUTH": str(truth),
        "ONE": str(tmp_path / "one.csv"),
        "OUT": str(tmp_path / "out"),
        "BELOW_A_FILE": str(truth / "out"),
    }
    assert main([places.get(word, word) for word in words]) == code
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.startswith("iceg: ")
    assert message in captured.err
    assert captured.err.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_eval_takes_relations_by_stamp(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from frontends.logs import read_log

    log = read_log(demo_log_path())
    trajectory = write_trajectory(tmp_path / "t.tum", log.odometry)
    first, second = log.stamps[0], log.stamps[10]
    file = tmp_path / "a.relations"
    file.write_text(f"{first:.6f} {second:.6f} 0 0 0 0 0 0\n{first:.6f} {second + 1e6:.6f} 0 0 0 0 0 0\n")
    assert main(["eval", str(trajectory), "--relations", str(file), "--log", str(demo_log_path()), "--json"]) == 0
    figures = json.loads(capsys.readouterr().out)
    assert (figures["n"], figures["dropped"], figures["trans_std"]) == (1, 1, None)
    distance = float(np.hypot(*(log.odometry[10] - log.odometry[0])[:2]))
    assert figures["trans_mean"] == pytest.approx(distance, abs=1e-5)


def test_info_describes_a_log(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["info", str(demo_log_path())]) == 0
    assert "181" in capsys.readouterr().out


Pipeline = Callable[[Log, Config, ProgressCallback], Any]


@pytest.fixture
def pipeline(monkeypatch: pytest.MonkeyPatch) -> Callable[[Pipeline], None]:
    """Put another pipeline, and writers of its results, in place of the real ones."""

    def install(run: Pipeline) -> None:
        module = ModuleType("iceg.slam.pipeline")
        module.run = run  # type: ignore[attr-defined]
        monkeypatch.setitem(sys.modules, "iceg.slam.pipeline", module)
        kept = {name: results._WRITERS[name] for name in ("trajectory", "covariances", "config")}
        monkeypatch.setattr(results, "_WRITERS", kept)

    return install


def by_odometry(
    log: Log, config: Config, progress: ProgressCallback, *, closures: object = (), corrections: object = None
) -> Any:
    del closures, corrections
    for scan in range(len(log)):
        progress(Progress(scans=scan + 1, tried=scan, accepted=scan // 2))
    return SimpleNamespace(
        log=log,
        config=config,
        trajectory=log.odometry,
        key_scans=np.arange(len(log)),
        key_poses=log.odometry,
        covariances=np.broadcast_to(1e-4 * np.eye(3), (len(log), 3, 3)),
        landmarks=FeatureMap().record(),
        closures=[],
        warnings=(),
        summary={"scans_carried_by_odometry": 0, "lost_at_scans": [], "breaks": [], "warnings": [], "finish": []},
    )


def test_run_writes_its_folder_and_refuses_to_overwrite_it(
    tmp_path: Path, pipeline: Callable[[Pipeline], None], capsys: pytest.CaptureFixture[str]
) -> None:
    pipeline(by_odometry)
    out = tmp_path / "out"
    words = ["run", str(demo_log_path()), "-o", str(out), "--grid.resolution", "0.25"]
    assert main(words) == 0
    captured = capsys.readouterr()
    assert str(out) in captured.out
    assert "100%" in captured.err
    assert "x real time, 50 % matched" in captured.err
    assert parse_config((out / "config.toml").read_text(encoding="utf-8")).grid.resolution == 0.25
    assert main(words) == 1
    assert "not empty" in capsys.readouterr().err
    assert main([*words, "--overwrite"]) == 0


def test_ctrl_c_while_libraries_are_loaded_is_no_import_error(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def loading(_words: list[str]) -> int:
        raise ImportError("initialization failed") from KeyboardInterrupt()

    monkeypatch.setattr(cli, "_main", loading)
    assert main(["run"]) == 130
    assert capsys.readouterr().err == "\niceg: interrupted\n"


def test_an_interrupted_run_says_what_was_kept(
    tmp_path: Path, pipeline: Callable[[Pipeline], None], capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupted(*_: object, **__: object) -> Any:
        raise KeyboardInterrupt

    out = tmp_path / "out"
    words = ["run", str(demo_log_path()), "-o", str(out), "--overwrite"]
    pipeline(interrupted)
    assert main(words) == 130
    assert f"interrupted, nothing was written to {out}" in capsys.readouterr().err
    assert not out.exists()
    pipeline_module = sys.modules["iceg.slam.pipeline"]
    pipeline_module.run = by_odometry  # type: ignore[attr-defined]
    assert main(words) == 0
    before = {path.name: path.read_bytes() for path in out.iterdir()}
    pipeline_module.run = interrupted  # type: ignore[attr-defined]
    assert main(words) == 130
    assert "earlier results" in capsys.readouterr().err
    assert {path.name: path.read_bytes() for path in out.iterdir()} == before


_FAKE_RUN = (
    "import sys, time, types\n"
    "def run(*_, **__):\n"
    "    print('running', flush=True)\n"
    "    {what}\n"
    "pipeline = types.ModuleType('iceg.slam.pipeline')\n"
    "pipeline.run = run\n"
    "sys.modules['iceg.slam.pipeline'] = pipeline\n"
    "from iceg.cli import command\n"
    "command()\n"
)
"""A program that is `iceg`, but for what a run does."""


@pytest.mark.skipif(sys.platform == "win32", reason="no signals to send")
@pytest.mark.parametrize(("number", "code"), [("SIGINT", 130), ("SIGTERM", 143), ("SIGHUP", 129)])
def test_a_signal_ends_the_process_with_one_line(tmp_path: Path, number: str, code: int) -> None:
    program = _FAKE_RUN.format(what="time.sleep(600)")
    words = [sys.executable, "-c", program, "run", str(demo_log_path()), "-o", str(tmp_path / "out")]
    with subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "running\n"
        process.send_signal(getattr(signal, number))
        _, error = process.communicate(timeout=300)
    assert process.returncode == code
    assert "Traceback" not in error
    assert error.endswith(f"iceg: interrupted, nothing was written to {tmp_path / 'out'}\n")
    assert not (tmp_path / "out").exists()


@pytest.mark.skipif(sys.platform == "win32", reason="no signals to send")
@pytest.mark.parametrize("delay_s", [0.0, 0.03, 0.1])
def test_ctrl_c_while_libraries_are_loaded_is_one_line(delay_s: float) -> None:
    code = (
        "from iceg.cli import ending\n"
        "ending.install()\n"
        "print('ready', flush=True)\n"
        "import numpy, numba, gtsam, iceg.slam.pipeline, time\n"
        "time.sleep(600)\n"
    )
    with subprocess.Popen([sys.executable, "-c", code], stdout=-1, stderr=-1, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n"
        time.sleep(delay_s)
        process.send_signal(signal.SIGINT)
        _, error = process.communicate(timeout=300)
    assert (process.returncode, error) == (130, "\niceg: interrupted\n")


@pytest.mark.skipif(sys.platform == "win32", reason="no signals to ignore")
def test_a_signal_that_the_parent_ignores_stays_ignored() -> None:
    code = "import signal\nfrom iceg.cli import ending\nending.install()\nsignal.raise_signal(signal.SIGHUP)"
    words = ["nohup", sys.executable, "-c", code]
    assert subprocess.run(words, capture_output=True, check=False).returncode == 0


def test_what_nobody_foresaw_is_called_a_bug(
    tmp_path: Path, pipeline: Callable[[Pipeline], None], capsys: pytest.CaptureFixture[str]
) -> None:
    def broken(*_: object, **__: object) -> Any:
        raise ZeroDivisionError("division by zero")

    pipeline(broken)
    words = ["run", str(demo_log_path()), "-o", str(tmp_path / "out")]
    assert main(words) == 70
    told = capsys.readouterr().err.splitlines()[-1]
    assert told.startswith("iceg: this is a bug of iceg: ZeroDivisionError: division by zero (iceg/cli/run_log.py:")
    assert "please report it" in told
    assert "--debug" in told
    assert main(["run", "--debug", *words[1:]]) == 70
    assert "Traceback" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_debug_hides_no_error_of_the_user(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["info", str(tmp_path / "none.clf"), "--debug"]) == 1
    captured = capsys.readouterr().err
    assert captured.startswith(f"iceg: {tmp_path / 'none.clf'}")
    assert captured.count("\n") == 1


def test_too_little_memory_is_said(
    tmp_path: Path, pipeline: Callable[[Pipeline], None], capsys: pytest.CaptureFixture[str]
) -> None:
    def greedy(*_: object, **__: object) -> Any:
        raise MemoryError("Unable to allocate 93. GiB")

    pipeline(greedy)
    assert main(["run", str(demo_log_path()), "-o", str(tmp_path / "out")]) == 1
    assert "iceg: this takes more memory than there is (Unable to allocate 93. GiB)\n" in capsys.readouterr().err


@pytest.mark.skipif(os.name != "posix", reason="names of files are bytes on POSIX only")
@pytest.mark.parametrize("name", [b"b\xfcro.clf.gz", "büro.clf.gz".encode()])
@pytest.mark.parametrize("settings", [{}, {"LC_ALL": "POSIX", "PYTHONUTF8": "0"}])
def test_a_log_with_any_name_can_be_run(tmp_path: Path, name: bytes, settings: dict[str, str]) -> None:
    log = os.fsencode(tmp_path) + b"/" + name
    with open(log, "wb") as file:  # noqa: PTH123 a path of bytes
        file.write(demo_log_path().read_bytes())
    words: list[str | bytes] = [sys.executable, "-m", "iceg", "info", log]
    done = subprocess.run(words, capture_output=True, check=False, env=os.environ | settings)
    assert (done.returncode, done.stderr) == (0, b"")
    assert b"ro.clf.gz" in done.stdout


def test_demo_compares_with_the_truth(
    tmp_path: Path, pipeline: Callable[[Pipeline], None], capsys: pytest.CaptureFixture[str]
) -> None:
    pipeline(by_odometry)
    assert main(["demo", "-o", str(tmp_path / "out")]) == 0
    out = capsys.readouterr().out
    assert demo_truth_path().name in out
    assert "absolute trajectory error" in out
    assert "NEES" in out
    assert f"The map is {tmp_path / 'out' / 'map.png'}" in out


def test_eval_options_are_documented() -> None:
    done = iceg_process("eval", "--help")
    assert done.returncode == 0
    for flag in ("--relations", "--log", "--reference", "--truth", "--json"):
        assert flag in done.stdout
    assert Eval.__doc__


@pytest.mark.parametrize("command", ["ablation", "nees", "bench", "eval"])
def test_help_shows_no_default_where_there_is_none(command: str) -> None:
    shown = iceg_process(command, "--help").stdout
    assert "left out" in shown or "--truth" in shown
    assert "(default: )" not in shown
    assert "(default: None)" not in shown


@pytest.mark.skipif(os.name != "posix", reason="a shell that closes streams")
@pytest.mark.parametrize("closing", [">&-", "2>&- > /dev/null", "<&- > /dev/null"])
def test_closed_streams_are_no_error(closing: str) -> None:
    command = f"{shlex.quote(sys.executable)} -m iceg config {closing}"
    done = subprocess.run(["bash", "-c", command], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.parametrize("word", ["config", "info"])
def test_an_output_that_lacks_some_letters_is_no_error(word: str) -> None:
    words = [sys.executable, "-m", "iceg", word, *([str(demo_log_path())] if word == "info" else [])]
    done = subprocess.run(words, capture_output=True, check=False, env=os.environ | {"PYTHONIOENCODING": "ascii"})
    assert (done.returncode, done.stderr) == (0, b"")
    assert b"?" in done.stdout


def test_a_reader_that_has_seen_enough_is_no_error() -> None:
    command = f"{shlex.quote(sys.executable)} -m iceg config | head -c 1"
    done = subprocess.run(["bash", "-c", command], capture_output=True, text=True, check=False)
    assert done.stderr == ""


def test_public_names_are_all_there() -> None:
    for name in iceg.__all__:
        assert getattr(iceg, name) is not None
    assert set(iceg.__all__) <= set(dir(iceg))
    assert set(iceg._HOMES) | {"__version__"} == set(iceg.__all__)
    with pytest.raises(AttributeError, match="has no attribute 'nothing'"):
        _ = iceg.nothing


def test_importing_iceg_is_light() -> None:
    heavy = "('gtsam', 'numba', 'matplotlib', 'numpy')"
    code = f"import sys, iceg; sys.exit(', '.join(m for m in {heavy} if m in sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.stderr.strip() == ""


@pytest.mark.parametrize("word", ["run", "info"])
def test_the_program_says_all_and_ends_with_its_code(word: str) -> None:
    code = (
        "import sys, iceg.cli\n"
        "iceg.cli.main = lambda: print('told') or print('warned', file=sys.stderr) or 3\n"
        f"sys.argv = ['iceg', '{word}']\n"
        "iceg.cli.command()"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (3, "told\n", "warned\n")
