"""Whatever the user gets wrong: exit code 2, nothing on stdout, one line that says what."""

from __future__ import annotations

import os
import shlex
from collections.abc import Callable
from pathlib import Path as FilePath

import pytest
from typer.testing import Result

Steersman = Callable[..., Result]
POLICY = "controller=policy"
WRONG = [
    # words, and what the line must hold
    ("drvie", "no such command 'drvie'; did you mean 'drive'?"),
    ("--versio", "no such option: --versio; did you mean --version?"),
    ("drive --jsn", "no such option: --jsn; did you mean --json?"),
    ("drive --duration 5", "--duration; settings are written key=value, like duration=..."),
    ("drive --out", "option '--out' requires an argument"),
    ("drive -o new", "no such option: -o; did you mean --out or --overwrite?"),
    ("list contoller", "unknown kind of component 'contoller'; did you mean 'controller'?"),
    ("list path circle", "(circle); see 'steersman list --help'"),
    ("show", "missing argument 'KIND'"),
    ("show pth circle", "unknown kind of component 'pth'; did you mean 'path'?"),
    ("show path", "show path: which one? names: circle, clothoid_road"),
    ("show path circel", "unknown path 'circel'; did you mean 'circle'?"),
    ("show vehicle typo.yaml", "typo.yaml: path: unknown field of custom"),
    ("show bench cor", "did you mean 'core'?"),
    # keys and values
    ("drive contoller=pid", "contoller: unknown field; did you mean 'controller'?"),
    ("drive controller=mpcpid", "controller: unknown controller 'mpcpid'; did you mean 'mpc_pid'?"),
    ("drive controller.horizn=3", "controller.horizn: unknown field of mpc_pid"),
    ("drive controller.gains.k_p=a", "controller.gains.k_p: 'a' is not a number; the unit is 1/m"),
    ("drive controller=5", "controller: a controller is a name, or fields among them 'kind'"),
    ("drive path.radius=-3", "path.radius: -3 is not allowed; must be at least 0.1 [m]"),
    ("drive path.radius=50m", "path.radius: '50m' is not a number; the unit is m, write e.g. 50"),
    ("drive path.radius=50km", "path.radius: '50km' is not a number; the unit is m, write the"),
    ("drive path=circle radius=50", "radius: unknown field; did you mean 'path.radius'?"),
    ("drive friction=0.9", "friction: unknown field; did you mean 'vehicle.friction'?"),
    ("drive duration=ten", "duration: 'ten' is not a number; the unit is s"),
    ("drive corridor=0", "corridor: 0 is not allowed; must be greater than 0 [m]"),
    ("drive corridor=true", "corridor: True is not a number; the unit is m"),
    ("drive corridor=nan", "corridor: 'nan' is not allowed; must be finite [m]"),
    ("drive seed=1.5", "seed: 1.5 is not a whole number"),
    (
        "drive seed=0..2",
        "seed: '0..2' is not a whole number; a drive has one seed; 'steersman",
    ),
    (
        "drive seeds=0..2",
        "seeds: unknown field; a drive has one seed; 'steersman bench",
    ),
    ("compare lqr pid seed=0..2", "take --seeds 0..2"),
    ("bench seed=0..2 --out new", "seed: unknown field; write --seeds 0..2"),
    ("train demo seed=0,1 --out new", "a training has one seed; seeds=0,1 trains with each"),
    ("drive seed=-1", "seed: -1 is not allowed; must be at least 0"),
    ("tune pid seed=0..2 --out new", "seed: '0..2' is not a whole number; it has one seed"),
    ("drive =5", "'=5' is not an assignment; write key=value"),
    ("drive duration=5 duration=6", "duration: given twice: duration=5 and duration=6"),
    ("drive path.radius=9 path=circle", "path: path=circle would undo path.radius=9; put path="),
    # a word for another one, or for a file
    ("drive speed=20", "given 20; write speed=constant_speed speed.speed=20"),
    ("drive speed=20km/h", "write speed=constant_speed speed.speed=NUMBER, in m/s"),
    ("drive speed.speed=20", "; write speed=constant_speed speed.speed=20 (or speed=stop_and_go)"),
    ("drive path.file=one.csv", "unknown field of circle; write path=one.csv"),
    ("drive disturbances=dropouts", "'dropouts' is not a list; write [dropouts]"),
    ("drive vehicle=car", "unknown vehicle 'car'; did you mean 'car.yaml'?"),
    ("drive path=one.cvs", "unknown path 'one.cvs'; did you mean 'one.csv'?"),
    (
        "drive path=onne.csv",
        "onne.csv: cannot be read (No such file or directory); did you mean",
    ),
    ("drive traning.yaml", "traning.yaml: no such file; did you mean 'training.yaml'?"),
    ("drive vehicle=car.yml", "car.yml: no such file; did you mean 'car.yaml'?"),
    (
        "tune lqr --out new --car car.yml --road one.csv",
        "car.yml: no such file; did you mean 'car.yaml'?\n",
    ),
    ("drive vehicle.wheelbase=3.4", "unknown field of carla_model3; give l_f and l_r; their sum"),
    ("drive vehicle.axle_loads=1", "give mass, l_f and l_r; the front axle carries the share"),
    ("drive vehicle.max_wheel_angle=38", "must be at most 1.5 [rad]; 38 deg are 0.663 rad"),
    # parts that do not fit together
    ("drive duration=5 laps=1", "laps: give laps or duration, not both"),
    ("drive laps=1 path=straight", "laps: path 'straight' is not closed; give a duration"),
    ("drive start=600 path=straight", "start: 600 is not allowed; the path ends at 500 [m]"),
    ("drive plant.dt=0.033", "plant.dt: 0.033 s is not a whole multiple of"),
    ("drive plant.steering_delay=9", "plant.steering_delay: 9.0 s is too long; at most"),
    # files
    ("drive duration", "'duration' is neither a file nor the name of a component; settings are"),
    ("drive typo.yaml mcp", "'mcp' is neither a file nor the name of a component; did you mean 'm"),
    ("drive csv", "'csv' may be a path or a speed; write path=csv or speed=csv"),
    ("drive one.csv", "'one.csv' may be a path or a speed; write path=one.csv or speed=one.csv"),
    ("drive lqr pid", "'lqr' and 'pid' are both a controller; give one of them"),
    ("drive path=one.xml", "path: unknown path 'one.xml'"),
    ("drive vehicle=no.yaml", "vehicle: no.yaml: no such file"),
    ("drive supervised/lqrr", "unknown controller 'lqrr'; did you mean 'lqr'?"),
    ("drive precison", "did you mean 'precision'?"),
    ("drive folder", "folder: is a folder without config.yaml, policy.onnx or"),
    ("drive list.yaml", "list.yaml: holds a list, expected key: value pairs"),
    ("drive twice.yaml", "twice.yaml: line 2: not valid YAML: 'duration' stands twice"),
    ("drive bad.yaml", "bad.yaml: line 2: not valid YAML"),
    ("drive binary.yaml", "binary.yaml: not valid YAML"),
    ("drive typo.yaml", "path.radius: '50m' is not a number"),
    ("drive path=csv", "path.file: required, but not given"),
    ("drive path=csv", "; write path=NAME.csv"),
    ("compare pid lqr path=csv", "; write path=NAME.csv"),
    ("drive path.file=x.csv", "path.file: unknown field of circle"),
    ("drive path=csv path.file=no.csv", "no.csv: cannot be read (No such file or directory)"),
    ("drive path=csv path.file=one.csv", "one.csv: holds 1 points, a path needs at least 2"),
    ("drive path=csv path.file=folder", "folder: is a folder"),
    ("drive speed=csv speed.file=one.csv", "one.csv, line 1: needs the columns time and speed"),
    ("drive speed=csv speed.file=no.csv", "no.csv: cannot be read"),
    ("drive vehicle=file vehicle.file=no.yaml", "vehicle: no.yaml: no such file"),
    ("drive vehicle=file vehicle.file=car.yaml", "car.yaml: mas: unknown field of bmw_320i; did"),
    # policies
    (f"drive {POLICY} controller.file=no.onnx", "no.onnx: cannot be read (No such file"),
    (f"drive {POLICY} controller.file=folder", "'folder' is neither an ONNX file (*.onnx) nor a"),
    (f"drive {POLICY} controller.file=precison", "did you mean 'precision'?"),
    (f"drive {POLICY} controller.file=alone.onnx", "alone.json: cannot be read (No such file"),
    (f"drive {POLICY} controller.file=broken.onnx", "broken.json: not a policy card: not valid"),
    (f"drive {POLICY} controller.file=array.onnx", "array.json: not a policy card: expected an"),
    (f"drive {POLICY} controller.file=unknown.onnx", "unknown.json: not a policy card: sped: unk"),
    (f"drive {POLICY} controller.file=negative.onnx", "card: spacing: -1.0 is not allowed; must"),
    (f"drive {POLICY} controller.file=newer.onnx", "newer.json: format 9 is not known"),
    (f"drive {POLICY} controller.file=other.onnx", "other.onnx: its SHA-256 is"),
    (f"drive {POLICY} controller.file=scales.onnx", "scales.onnx: card: 1 scales for"),
    (f"drive {POLICY} controller.file=encoding.onnx", "encoding.onnx: card: unknown encoding"),
    (f"drive {POLICY} controller.file=nonsense.onnx", "nonsense.onnx: not a network of layers"),
    (f"drive {POLICY} controller.file=period.onnx", "trained for a control period of 0.1 s, but"),
    # the configuration of another command
    ("drive trained/config.yaml", "of 'steersman train'; its policy drives with controller=policy"),
    ("drive training.yaml", "of 'steersman train'; it has no policy yet (policy.onnx)"),
    ("drive imitation.yaml", "of 'steersman imitate'; it has no policy yet"),
    ("drive controller=runs/nosuch", "unknown controller 'runs/nosuch'; no such file or folder"),
    ("drive tuning.yaml", "is the configuration of 'steersman tune'; what it found is tuned.yaml"),
    ("drive search.yaml", "'steersman falsify search.yaml' takes it"),
    ("tune suite.yaml --out new", "'steersman bench suite.yaml' takes it"),
    ("falsify training.yaml --out new", "is the configuration of 'steersman train'"),
    (
        "drive controller=tuned",
        "unknown controller 'tuned'; write one of tuned/bearing_pid,",
    ),
    ("drive controller=tuned/lqrr", "unknown controller 'tuned/lqrr'; did you mean 'tuned/lqr'?"),
    # where to write
    ("drive --out empty", "empty: is a file, expected a folder"),
    ("drive --out empty/x", "empty/x: cannot be made (Not a directory)"),
    ("report folder", "missing option '--out'; write --out report.html; see"),
    ("export lqr", "missing option '--to'; write --to c|fmu|"),
    ("drive --report page.pdf", "'page.pdf' is not allowed; a name that ends in .html or .htm is"),
    ("path export circle --to x.gpx", "--to: 'x.gpx' is not allowed; a name that ends in .xodr"),
    ("report", "missing argument 'DIR...'"),
    ("report no --out page.html", "no: no such folder"),
    ("report folder --out page.html", "folder: nothing to report; expected"),
    ("report folder --out folder", "--out: expected the name of a file, given 'folder'"),
    ("report folder --out empty/page.html", "empty: is a file, expected a folder"),
    # training and tuning
    ("train", "missing option '--out'; write --out runs/train; see"),
    ("search demo agent.gama=0.1..1 --out new", "agent.gama: unknown field of ddpg; did you"),
    ("search demo lr=1..2 --out new", "lr: unknown field; allowed: agent"),
    ("train dmo --out new", "unknown preset 'dmo'; did you mean 'demo'?"),
    ("train no.yaml --out new", "no.yaml: no such file"),
    ("train demo stps=5 --out new", "stps: unknown field; did you mean 'steps'?"),
    ("train demo steps=0 --out new", "steps: 0 is not allowed; must be greater than 0"),
    ("train demo --out empty", "empty: is a file, expected a folder"),
    ("imitate dmo --out new", "unknown preset 'dmo'; did you mean 'demo'?"),
    ("imitate demo agent.gamma=0.9 --out new", "agent: unknown field"),
    ("imitate demo method=dager --out new", "must be 'dagger' or 'bc'"),
    ("imitate problem.demonstration.enabled=false --out new", "is false; set it to true"),
    ("tune --trials 0 --out new", "invalid value for '--trials': "),
    ("tune controler=pid --out new", "controler: unknown field; did you mean 'controller'?"),
    ("demo --policy no.onnx --out new", "no.onnx: no such file"),
]


@pytest.mark.usefixtures("wrong_files")
@pytest.mark.parametrize(("words", "expected"), WRONG, ids=[words for words, _ in WRONG])
def test_wrong_input_is_one_line_and_exit_code_2(
    steersman: Steersman, words: str, expected: str
) -> None:
    result = steersman(*words.split())
    assert expected in result.stderr
    assert result.stderr.startswith("error: ")
    assert result.stderr.count("\n") == 1
    assert result.stdout == ""
    assert result.exit_code == 2


@pytest.mark.usefixtures("wrong_files")
def test_out_must_have_a_name(steersman: Steersman) -> None:
    for words in (["drive", "--out", ""], ["report", "folder", "--out", " "]):
        result = steersman(*words)
        assert result.stderr.startswith("error: --out: expected the name of a ")
        assert result.exit_code == 2


def test_a_faulty_setting_makes_no_folder(steersman: Steersman, tmp_path: FilePath) -> None:
    for command in ("drive", "train"):
        assert steersman(command, "sead=1", "--out", "new").exit_code == 2
    assert not any(tmp_path.iterdir())


def test_a_file_name_that_is_too_long_is_no_traceback(steersman: Steersman) -> None:
    result = steersman("drive", f"{'x' * 5000}.yaml")
    assert "name too long" in result.stderr
    assert result.exit_code == 2


def test_a_device_as_output_is_refused_before_anything_is_driven(
    steersman: Steersman, tmp_path: FilePath
) -> None:
    os.mkfifo(tmp_path / "fifo.mcap")
    (tmp_path / "link.html").symlink_to(os.devnull)
    for option, name, kind in (
        ("--mcap", "fifo.mcap", "a FIFO"),
        ("--report", "link.html", "a character device"),
    ):
        result = steersman("drive", "duration=1", option, name)
        assert result.stderr == f"error: {name}: cannot be written (it is {kind})\n"
        assert (result.exit_code, result.stdout) == (2, "")
    assert (tmp_path / "fifo.mcap").is_fifo()
    assert (tmp_path / "link.html").is_symlink()


@pytest.mark.parametrize(
    ("words", "cure"),
    [
        ("lqr start.heading=10", "10 deg are 0.175 rad"),
        ("lqr start.heading=-45", "-45 deg are -0.785 rad"),
        ("lqr plant.dt=50", "must be at most 2 [s]"),
        ("controler lqr", "write controller=NAME"),
        ("lqr path = circle", "write key=value or key.field=value, without blanks"),
        ("plant.steering_delay=0,1", "write 0.1"),
        ("mine.py", "a controller in Python is driven from Python: sm.drive(MyController(), ...)"),
        ("notes.doc", "notes.doc: is a file of no kind that drive takes"),
        ("controller=process controller.command='python3 a.py'", "write [python3, a.py]"),
        ("controller=driven", "a folder that holds no controller; what it was driven with: driven"),
        ("controller=notes.doc", "expected a file that ends in"),
    ],
)
def test_what_beginners_write_is_answered_with_what_to_write(
    words: str, cure: str, steersman: Steersman, tmp_path: FilePath, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.py").touch()
    (tmp_path / "notes.doc").touch()
    (tmp_path / "driven").mkdir()
    (tmp_path / "driven" / "config.yaml").write_text("path: circle\n", encoding="utf-8")
    result = steersman("drive", *shlex.split(words))
    assert (result.exit_code, result.stderr.count("\n")) == (2, 1)
    assert cure in result.stderr
