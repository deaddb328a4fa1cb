"""Golden runs: what the package computes, recorded so that a later version can be compared with it.

    python benchmarks/golden.py record OUT.json [--only PATTERN] [--small] [--keep]
    python benchmarks/golden.py compare REF.json [OUT.json] [--only PATTERN] [--small]

``golden.yaml`` has the runs as plain data. Whatever a run computes is a column of numbers or
texts; the record holds, for each, a digest of its bytes and a few statistics. Times and what tells
of the machine and of the version are left out. ``compare`` runs again, or reads OUT.json if that
is there (else writes it), and prints a line for each run that differs: its columns with the largest
differences. Those are of single values where both records were made with ``--keep``, which writes
all columns to OUT.npz; without it, of the statistics (last, least, greatest value and mean), so
that the values differ by at least as much. The exit code is 1 if anything differs.

All that touches the package stands in the section "adapter".
"""

from __future__ import annotations

import argparse
import csv
import fnmatch
import hashlib
import io
import json
import math
import os
import platform
import re
import shlex
import sys
import tempfile
import time
import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from importlib.metadata import version
from pathlib import Path
from typing import Any

# Before numpy and torch: one thread, so that sums are added in one order.
for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

import numpy as np  # noqa: E402
import yaml  # noqa: E402

RUNS = Path(__file__).with_name("golden.yaml")
FORMAT = 1
STATISTICS = ("digest", "n", "finite", "sum", "squares", "last", "min", "max")
PACKAGES = ("numpy", "scipy", "numba", "torch", "stable-baselines3", "onnxruntime", "daqp")
# Instructions that libraries choose their kernels by.
INSTRUCTIONS = ("sse4_2", "avx", "avx2", "fma", "avx512f", "avx512_bf16", "avx512_vnni", "amx_tile")
# Names of columns that tell of computing time, of versions and of places; and configurations, which
# are what was asked for rather than what was computed.
LEFT_OUT = re.compile(
    r"control_time|computing|deadline|(^|[./])seconds$|commit|versions?\b|made_by|(^|[./])key$"
    r"|json/files\.|(^|[./])(made|date|created|folder|file|source)$"
    r"|json/(training\.)?config\.|result\.json/suite\.|results\.json/controllers\."
    r"|contestants\.controller\."
)
# Columns of a line of the comparison.
SHOWN = 6
# Size of columns that are nearly zero, for relative differences.
SMALL = 1e-3

Columns = dict[str, Any]

# ------------------------------------------------------------------------------------ adapter
#
# What the rest of this file needs from the package, and nothing else does: drive, scenario,
# environment, train, commands. Each takes the words of golden.yaml and returns columns. Most go
# through the command line in the present folder, and what it wrote there is read. And the commit.


def drive(words: Sequence[str]) -> Columns:
    """The columns of an episode and its metrics."""
    return commands([["drive", *words, "--out", "out"]])


def train(words: Sequence[str]) -> Columns:
    """Weights, learning curve, exported policy."""
    return commands([["train", *words, "--out", "out"]])


def commands(lines: Sequence[Sequence[str]]) -> Columns:
    """What commands leave in the present folder, and how they failed."""
    given = {file for file in Path().rglob("*") if file.is_file()}
    errors = [error for line in lines if (error := _command(line))]
    found: Columns = {"error": errors} if errors else {}
    for file in sorted(file for file in Path().rglob("*") if file.is_file() and file not in given):
        reader = next((read for pattern, read in READERS.items() if file.match(pattern)), None)
        if reader is not None:
            found |= {f"{file.as_posix()}/{key}": each for key, each in reader(file).items()}
    return found


def _command(words: Sequence[str]) -> str:
    """Run one command of the shell here; its error, if it is one."""
    from steersman.cli import main

    told = io.StringIO()
    with redirect_stdout(io.StringIO()), redirect_stderr(told):
        try:
            main(list(words))
        except SystemExit as end:
            if not end.code:
                return ""
    lines = [line for line in told.getvalue().splitlines() if line.startswith("error: ")]
    return lines[-1] if lines else f"exit code without a word: {words[0]}"


def scenario(words: Sequence[str]) -> Columns:
    """A row of the benchmark."""
    from steersman.bench.drive import measure
    from steersman.bench.entrants import entrant
    from steersman.bench.suites import suite

    name, which, who = words[:3]
    seed = int(words[3].removeprefix("seed=")) if words[3:] else 0
    found = [one for one in suite(name).scenarios([seed]) if one.name.startswith(f"{which}/")]
    if len(found) != 1:
        raise ValueError(f"{len(found)} scenarios begin with {which}")
    return flat(measure(found[0], entrant(who)).plain())


def environment(words: Sequence[str]) -> Columns:
    """What an environment answers to fixed actions."""
    vehicles, steps = int(words[0]), int(words[1])
    actions = 0.6 * np.random.default_rng(1).uniform(-1.0, 1.0, (steps, vehicles, 1))
    actions[:, :, 0] += 0.3 * np.sin(0.2 * np.arange(steps))[:, None]
    return (_one if vehicles == 1 else _many)(_problem(words[2:]), actions.astype(np.float32))


def _problem(words: Sequence[str]) -> Any:
    from steersman.config import build, override
    from steersman.learning.problem import Problem

    return build(Problem, override({}, words))


def _one(problem: Any, actions: Any) -> Columns:
    from steersman.learning.env import PathFollowingEnv

    env = PathFollowingEnv(problem)
    seen, told = env.reset(seed=7)
    rows = [(seen, 0.0, False, False, told)]
    for action in actions[:, 0]:
        rows.append(env.step(action))
        if rows[-1][2] or rows[-1][3]:
            seen, told = env.reset()
            rows.append((seen, 0.0, False, False, told))
    env.close()
    seen, reward, terminated, truncated, infos = zip(*rows, strict=True)
    return {
        "observation": np.array(seen),
        "reward": np.array(reward),
        "terminated": np.array(terminated, dtype=float),
        "truncated": np.array(truncated, dtype=float),
        **{f"info/{key}": each for key, each in flat(list(infos)).items()},
    }


def _many(problem: Any, actions: Any) -> Columns:
    from steersman.learning.vec_env import PathFollowingVecEnv

    env = PathFollowingVecEnv(problem, actions.shape[1])
    env.seed(7)
    seen, rewards, ends, last, shown = [env.reset()], [], [], [], []
    for action in actions:
        if problem.demonstration.enabled:
            shown.append(env.demonstrated_actions()[:, 0].copy())
        out, reward, done, infos = env.step(action)
        seen.append(out), rewards.append(reward.copy()), ends.append(done.copy())
        last += [info for info in infos if info]
    env.close()
    return {
        "observation": np.array(seen),
        "reward": np.array(rewards),
        "done": np.array(ends, dtype=float),
        "demonstrated": np.array(shown),
        **{f"info/{key}": each for key, each in flat(last).items()},
    }


def _archive(file: Path) -> Columns:
    """An episode, or the weights of a checkpoint."""
    with np.load(file, allow_pickle=False) as data:
        found = {name: data[name] for name in data if name != "head"}
        if "head" in data:
            head = json.loads(bytes(data["head"]).decode())
            del head["meta"]
            found |= flat(head)
    return found


def _table(file: Path) -> Columns:
    with file.open(encoding="utf-8") as stream:
        rows = [{k: float(v) for k, v in row.items()} for row in csv.DictReader(stream)]
    return flat(rows)


def _json(file: Path) -> Columns:
    return flat(json.loads(file.read_text(encoding="utf-8")))


def _json_lines(file: Path) -> Columns:
    return flat([json.loads(line) for line in file.read_text(encoding="utf-8").splitlines()])


def _yaml(file: Path) -> Columns:
    return flat(yaml.safe_load(file.read_text(encoding="utf-8")))


def _text(file: Path) -> Columns:
    """Lines of source; those that name commit or version are left out."""
    lines = file.read_text(encoding="utf-8").splitlines()
    return {"lines": [line for line in lines if not re.search("commit|version", line, re.I)]}


def _network(file: Path) -> Columns:
    """Weights of an ONNX file, and what it answers."""
    import onnx
    import onnxruntime

    graph = onnx.load(str(file)).graph
    session = onnxruntime.InferenceSession(str(file), providers=["CPUExecutionProvider"])
    given = session.get_inputs()[0]
    shape = (16, given.shape[-1])
    inputs = np.random.default_rng(2).uniform(-1.0, 1.0, shape).astype(np.float32)
    answers = [session.run(None, {given.name: row[None, :]})[0] for row in inputs]
    weights = {f"weight/{one.name}": onnx.numpy_helper.to_array(one) for one in graph.initializer}
    return {
        **weights,
        "operators": [node.op_type for node in graph.node],
        "answers": np.concatenate(answers),
    }


def _kept(file: Path) -> Columns:
    """The episodes of a Minari dataset, of which ``file`` is the description."""
    import minari

    episodes = list(minari.MinariDataset(str(file.parent)).iterate_episodes())
    found: Columns = {"episodes": np.array([float(len(one.rewards)) for one in episodes])}
    for name in ("observations", "actions", "rewards", "terminations", "truncations"):
        found[name] = np.concatenate([np.asarray(getattr(one, name)).ravel() for one in episodes])
    for name in sorted(episodes[0].infos):
        found[f"info/{name}"] = np.concatenate([np.ravel(one.infos[name]) for one in episodes])
    return found


# Files that commands write, and how they are read; others hold configurations, drawings and logs.
READERS: dict[str, Callable[[Path], Columns]] = {
    "episode.npz": _archive,
    "checkpoints/*.npz": _archive,
    "progress.csv": _table,
    "rows.jsonl": _json_lines,
    "drives.jsonl": _json_lines,
    "tuned.yaml": _yaml,
    "data/metadata.json": _kept,
    "metrics.json": _json,
    "results.json": _json,
    "result.json": _json,
    "pareto.json": _json,
    "compare.json": _json,
    "falsify.json": _json,
    "policy.json": _json,
    "*/precision.json": _json,
    "*.onnx": _network,
    "*.c": _text,
    "*.h": _text,
    "*.xodr": _text,
}


def commit() -> Any:
    """Of the source that runs."""
    from steersman.provenance import provenance

    return provenance()["commit"]


KINDS: dict[str, Callable[[Sequence[str]], Columns]] = {
    "drive": drive,
    "scenario": scenario,
    "env": environment,
    "train": train,
}

# ----------------------------------------------------------------------------------- columns


def flat(data: Any, name: str = "") -> Columns:
    """Nested plain data as lists: items of lists share a name, so that a table gives columns."""
    if isinstance(data, Mapping):
        parts = [(f"{name}.{key}" if name else str(key), each) for key, each in data.items()]
    elif isinstance(data, list | tuple):
        parts = [(name, each) for each in data]
    elif isinstance(data, np.ndarray):
        return {name: data.ravel().tolist()}
    else:
        return {name: [data]}
    found: Columns = {}
    for key, each in parts:
        for inner, values in flat(each, key).items():
            found.setdefault(inner, []).extend(values)
    return found


def array(values: Any) -> Any:
    """The column as an array of numbers, or as a list of texts where it holds any."""
    if isinstance(values, np.ndarray):
        return values
    if any(isinstance(each, str) for each in values):
        return ["" if each is None else str(each) for each in values]
    return np.array([math.nan if each is None else float(each) for each in values])


def entry(column: Any) -> Any:
    """What is kept of a column: a single value itself, else digest and ``STATISTICS``."""
    if isinstance(column, list):
        digest = hashlib.sha256("\0".join(column).encode()).hexdigest()[:16]
        return column[0] if len(column) == 1 else [digest, len(column)]
    if column.size == 1 and np.isfinite(column).all():
        return float(column.reshape(-1)[0])
    digest = hashlib.sha256(np.ascontiguousarray(column).tobytes()).hexdigest()[:16]
    values = column.astype(np.float64).ravel()
    finite = values[np.isfinite(values)]
    if not finite.size:
        return [digest, values.size, 0, 0.0, 0.0, 0.0, 0.0, 0.0]
    figures = (finite.sum(), finite @ finite, finite[-1], finite.min(), finite.max())
    return [digest, values.size, finite.size, *(float(each) for each in figures)]


# ---------------------------------------------------------------------------------- recorder


def runs(only: str = "*", small: bool = False) -> dict[str, Callable[[], Columns]]:
    """Every run by its name; in those of ``train``, the preset comes first."""
    data = yaml.safe_load(RUNS.read_text(encoding="utf-8"))
    found: dict[str, Callable[[], Columns]] = {}
    for kind, function in KINDS.items():
        for name, text in data[kind].items():
            words = shlex.split(text)
            if kind == "train":
                words = [words[0], *_besides(data["train_words"], words), *words[1:]]
            found[f"{kind}/{name}"] = lambda function=function, words=words: function(words)
    for name, texts in data["commands"].items():
        lines = [shlex.split(text) for text in texts]
        found[f"commands/{name}"] = lambda lines=lines: commands(lines)
    if small:
        found = {name: found[name] for name in data["small"]}
    return {name: run for name, run in found.items() if _matches(name, only)}


def _besides(common: str, words: Sequence[str]) -> list[str]:
    """The common words about what a run does not set itself."""
    given = {word.partition("=")[0] for word in words}
    keys = ((word, word.partition("=")[0]) for word in shlex.split(common))
    return [word for word, key in keys if not {key, key.partition(".")[0]} & given]


def _matches(name: str, only: str) -> bool:
    return fnmatch.fnmatchcase(name, only) or only in name


def run_all(chosen: Mapping[str, Callable[[], Columns]]) -> Iterator[tuple[str, Columns]]:
    """Each run's columns; a run that fails has its error as the only one."""
    files = yaml.safe_load(RUNS.read_text(encoding="utf-8"))["files"]
    for number, (name, run) in enumerate(chosen.items(), 1):
        begun = time.perf_counter()
        with _folder(files):
            try:
                columns = run()
            except Exception as error:  # noqa: BLE001 - the other runs are to go on
                columns = {"failure": [traceback.format_exception_only(error)[-1].strip()]}
        columns = {key: each for key, each in columns.items() if not LEFT_OUT.search(key)}
        seconds = time.perf_counter() - begun
        _tell(f"{number}/{len(chosen)} {name}: {len(columns)} columns, {seconds:.1f} s")
        yield name, {key: array(each) for key, each in sorted(columns.items())}


@contextmanager
def _folder(files: Mapping[str, str]) -> Iterator[None]:
    """A working folder with the files that runs read, so that no path is one of this machine."""
    home = Path.cwd()
    with tempfile.TemporaryDirectory() as name:
        for file, text in files.items():
            Path(name, file).write_text(text, encoding="utf-8")
        os.chdir(name)
        try:
            yield
        finally:
            os.chdir(home)


def record(only: str = "*", small: bool = False, keep: Path | None = None) -> dict[str, Any]:
    """Run, and return the record; with ``keep``, all columns are written there."""
    found, raw = {}, {}
    for name, columns in run_all(runs(only, small)):
        found[name] = {key: entry(each) for key, each in columns.items()}
        raw |= {f"{name}|{k}": v for k, v in columns.items() if isinstance(v, np.ndarray)}
    if keep is not None:
        np.savez_compressed(keep, **{key.replace("/", "\\"): each for key, each in raw.items()})
    return {"format": FORMAT, "statistics": STATISTICS, "made": made(), "runs": found}


def made() -> dict[str, Any]:
    """With what the record was made."""
    flags = Path("/proc/cpuinfo")
    words = set(flags.read_text(encoding="utf-8").split()) if flags.is_file() else set()
    return {
        "commit": commit(),
        "python": platform.python_version(),
        **{name: version(name) for name in PACKAGES},
        "machine": platform.machine(),
        "instructions": [name for name in INSTRUCTIONS if name in words],
    }


def write(found: Mapping[str, Any], file: Path) -> None:
    """The record as JSON, a line for each run."""
    head = {key: each for key, each in found.items() if key != "runs"}
    lines = [
        f"{json.dumps(name)}:{json.dumps(each, separators=(',', ':'))}"
        for name, each in found["runs"].items()
    ]
    start = json.dumps(head, separators=(",", ":"))[:-1]
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(start + ',"runs":{\n' + ",\n".join(lines) + "\n}}\n", encoding="utf-8")


def _tell(line: str) -> None:
    print(line, file=sys.stderr, flush=True)  # noqa: T201


# ---------------------------------------------------------------------------------- comparing


def apart(one: Any, other: Any) -> float:
    """How far two entries are apart at least: infinite if they are not of the same kind."""
    if one == other:
        return 0.0
    if isinstance(one, float) and isinstance(other, float):
        return abs(one - other)
    lists = isinstance(one, list) and isinstance(other, list)
    if not lists or one[1:3] != other[1:3] or len(one) != len(STATISTICS):
        return math.inf
    figures = [(each[3] / max(each[2], 1), *each[5:]) for each in (one, other)]
    return max(abs(a - b) for a, b in zip(*figures, strict=True))


def close(one: Any, other: Any, tolerance: float) -> bool:
    """Whether two entries are the same but for rounding, relative to the column's size."""
    if one == other:
        return True
    if isinstance(one, float) and isinstance(other, float):
        return abs(one - other) <= tolerance * max(abs(one), abs(other), SMALL)
    lists = isinstance(one, list) and isinstance(other, list)
    if not lists or one[1:3] != other[1:3] or len(one) != len(STATISTICS):
        return False
    count, size = one[1], max(abs(one[6]), abs(one[7]), SMALL)
    scales = (count * size, count * size * size, size, size, size)
    pairs = zip(one[3:], other[3:], scales, strict=True)
    return all(abs(a - b) <= tolerance * scale for a, b, scale in pairs)


def differences(
    reference: Mapping[str, Any], found: Mapping[str, Any], exact: Mapping[str, float]
) -> dict[str, float]:
    """The columns of a run that differ, and by how much; those on one side only: infinitely."""
    names = [name for name in {**reference, **found} if reference.get(name) != found.get(name)]
    out = {name: apart(reference.get(name), found.get(name)) for name in names}
    return {name: exact.get(name, size) for name, size in out.items()}


def line(name: str, found: Mapping[str, float]) -> str:
    """A run's differences in words, the largest first."""
    order = sorted(found, key=lambda key: -found[key])
    shown = [f"{key} ({_size(found[key])})" for key in order[:SHOWN]]
    more = f" and {len(order) - SHOWN} more" if len(order) > SHOWN else ""
    return f"{name}: {len(order)} differ: {', '.join(shown)}{more}"


def _size(value: float) -> str:
    return "not comparable" if math.isinf(value) else f"{value:.2g}"


def exactly(one: Path, other: Path) -> dict[str, dict[str, float]]:
    """Largest absolute differences of kept columns by run, as far as both are kept."""
    out: dict[str, dict[str, float]] = {}
    if not (one.is_file() and other.is_file()):
        return out
    with np.load(one) as ours, np.load(other) as theirs:
        for key in set(ours.files) & set(theirs.files):
            a, b = ours[key].astype(np.float64), theirs[key].astype(np.float64)
            run, _, column = key.replace("\\", "/").partition("|")
            if a.shape == b.shape and a.size:
                gap = np.nanmax(np.abs(a - b), initial=0.0)
                out.setdefault(run, {})[column] = float(gap)
    return out


def compare(reference: Mapping[str, Any], found: Mapping[str, Any], exact: Any = None) -> list[str]:
    """A line for each run that differs, or that only one of the records has."""
    out = []
    for name in {**reference, **found}:
        if name not in reference or name not in found:
            out.append(f"{name}: only in the {'new' if name in found else 'old'} record")
            continue
        sizes = differences(reference[name], found[name], (exact or {}).get(name, {}))
        if sizes:
            errors = [found[name].get(key) for key in ("failure", "error") if key in sizes]
            told = "".join(f"; {error}" for error in errors if error)
            out.append(line(name, sizes) + told)
    return out


def _compare(options: argparse.Namespace) -> int:
    reference = json.loads(options.reference.read_text(encoding="utf-8"))["runs"]
    chosen = runs(options.only, options.small)
    if options.small or options.only != "*":
        reference = {name: each for name, each in reference.items() if name in chosen}
    if options.out is not None and options.out.is_file():
        found = json.loads(options.out.read_text(encoding="utf-8"))
    else:
        found = record(options.only, options.small, _raw(options.out, options.keep))
        if options.out is not None:
            write(found, options.out)
    exact = {} if options.out is None else exactly(_npz(options.reference), _npz(options.out))
    lines = compare(reference, found["runs"], exact)
    same = len(reference) - len(lines)
    last = f"{max(same, 0)} of {len(reference)} runs are the same to the bit"
    print("\n".join([*lines, last]))  # noqa: T201
    return int(bool(lines))


def _npz(file: Path) -> Path:
    return file.with_suffix(".npz")


def _raw(file: Path | None, keep: bool) -> Path | None:
    return _npz(file) if keep and file is not None else None


def _record(options: argparse.Namespace) -> int:
    options.out.parent.mkdir(parents=True, exist_ok=True)
    found = record(options.only, options.small, _raw(options.out, options.keep))
    write(found, options.out)
    failed = [name for name, columns in found["runs"].items() if "failure" in columns]
    _tell(f"{len(found['runs'])} runs, failed: {', '.join(failed) or 'none'}")
    return 0


def main(words: Sequence[str] | None = None) -> int:
    """Read the words of the command and do what they say."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    verbs = parser.add_subparsers(dest="verb", required=True)
    recorder = verbs.add_parser("record", help="run, and write the record")
    recorder.add_argument("out", type=Path)
    comparer = verbs.add_parser("compare", help="compare with a record")
    comparer.add_argument("reference", type=Path)
    comparer.add_argument("out", type=Path, nargs="?")
    for each in (recorder, comparer):
        each.add_argument("--only", default="*", metavar="PATTERN", help="part of names, or glob")
        each.add_argument("--small", action="store_true", help="the small set")
        each.add_argument("--keep", action="store_true", help="write all columns to OUT.npz")
    options = parser.parse_args(words)
    return _record(options) if options.verb == "record" else _compare(options)


if __name__ == "__main__":
    sys.exit(main())
