"""Datasets, benchmarks and sweeps of trainings on many machines, by Ray.

Where the environment variable `RAY_ADDRESS` names a cluster (`ray start`), tasks run on its nodes; without it, on this
machine. Folders are shared by all nodes: NFS, or any file system with locks. Every node has the same version of dermis.

>>> import dermis.ray
>>> recipe = {"skins": "even", "touch": {"gaussian": {"most": 2, "width_m": [0.004, 0.012], "amplitude": [0.1, 0.3]}}}
>>> data = dermis.ray.simulate("skin16", "data", recipe=recipe, seed=1, samples=1000)
>>> len(data)
1000
"""

import functools
import itertools
import json
import os
import pickle
import shutil
import socket
import sys
import time
import tomllib
from collections.abc import Sequence
from os import PathLike
from pathlib import Path
from typing import Any, NamedTuple

import ray
from ray.exceptions import LocalRayletDiedError, NodeDiedError, OutOfMemoryError, RaySystemError, WorkerCrashedError

from dermis import _progress
from dermis._command import command, options_of
from dermis._dermis import Dataset, Skin, __version__, finish_dataset
from dermis._errors import DermisError
from dermis._files import write_whole

__all__ = ["Sweep", "benchmark", "simulate", "sweep", "table"]

# A task is started again this often when its node or its process dies.
_RETRIES = 10
# A trial is started again this often, whatever ends it.
_TRIAL_RETRIES = 3
# Tasks that are handed to Ray at once: more would only wait there.
_AT_ONCE = 1000
# Time for a cluster to answer.
_CONNECT_TIMEOUT_S = 10.0
_SYSTEM_FAILURES = (LocalRayletDiedError, NodeDiedError, OutOfMemoryError, RaySystemError, WorkerCrashedError)
# Options of `dermis train` that name files, and those that name folders.
_FILES, _FOLDERS = ("noise", "stream"), ("data", "test")


def simulate(
    design: Skin | str | PathLike[str] | dict[str, Any],
    output: str | PathLike[str],
    *,
    recipe: str | PathLike[str] | dict[str, Any],
    seed: int,
    samples: int,
    threads: int = 1,
) -> Dataset:
    """Generates a dataset by one task per file of 8,192 samples; the files are those of `dermis simulate`, bit for bit.

    The folder is the state: files that exist are kept. A task whose node dies runs again on another one. After the end of this
    process the same call continues; a file that a task of the former call still generates is waited for. References carry
    counts only. Progress is shown where standard error is a terminal.

    Args:
        design: A `dermis.Skin`, a shipped name, the path of a design file, or a dict with its keys.
        output: The folder, shared by all nodes.
        recipe: The path of a recipe file, or a dict with its keys.
        seed: The seed.
        samples: Number of samples.
        threads: Threads of each task, as many CPUs as it asks Ray for. A task holds one file in memory.

    Returns:
        The finished dataset.

    Raises:
        DermisError: A recipe that cannot be used; a folder with another dataset, without space, or that a node does not see; a
            node without dermis or with another version.
    """
    skin = design if isinstance(design, Skin) else Skin.load(design)
    simulation = skin.simulation(recipe, seed=seed, samples=samples)
    folder = os.path.abspath(output)
    missing = simulation.begin(folder)
    if missing:
        _check_threads(threads)
        job = (pickle.dumps(skin), json.dumps(_keys(recipe)), seed, samples)
        made, begun = simulation.files - len(missing), time.monotonic()
        for _ in _results("_simulate_file", [(*job, folder, number, threads) for number in missing], threads):
            made += 1
            _progress.show("files", made, simulation.files, time.monotonic() - begun)
    elif (Path(folder) / "manifest.json").exists():
        return Dataset(folder)
    return finish_dataset(folder)


def benchmark(
    design: str | PathLike[str],
    methods: str | PathLike[str] | Sequence[str | PathLike[str]],
    *,
    twin: str = "lab",
    twins: int = 10,
    seed: int = 1001,
    quick: bool = False,
    dead: int = 0,
    threads: int = 1,
) -> dict[str, Any]:
    """Runs `dermis benchmark` on many twins, by one task per method and twin.

    Args:
        design: A shipped name, or the path of a design file that all nodes see.
        methods: Names of methods or folders of networks that all nodes see; one or several.
        twin: `ideal`, `lab`, `lab-b`, `lab-c` or `harsh`, or the path of a twin file.
        twins: Number of twins.
        seed: Seed of the first twin; the following twins have the following seeds.
        quick: Use a tenth of the frames.
        dead: Number of disconnected electrodes of each twin.
        threads: Threads of each task, as many CPUs as it asks Ray for.

    Returns:
        The result of each method by its name: what `dermis.command("benchmark", ...)` returns for all twins. `table` makes
        rows of it.

    Raises:
        DermisError: What the command refuses; a node without dermis or with another version.
    """
    names = [methods] if isinstance(methods, (str, os.PathLike)) else list(methods)
    names = list(dict.fromkeys(os.fspath(name) for name in names))
    _check_count("twins", twins)
    if not names:
        raise DermisError("`methods` is empty", hint=f"give some of {', '.join(Skin.load(design).methods)}")
    _check_threads(threads)
    options = {"twin": twin, "quick": quick, "dead": dead}
    pairs = [(name, seed + number) for name in names for number in range(twins)]
    calls = [(os.getcwd(), os.fspath(design), {**options, "method": name, "seed": own}, threads) for name, own in pairs]
    results, begun = [None] * len(calls), time.monotonic()
    for done, (number, result) in enumerate(_results("_benchmark_twin", calls, threads), start=1):
        results[number] = result
        _progress.show("twins", done, len(calls), time.monotonic() - begun)
    merged = {}
    for (name, _), result in zip(pairs, results):
        if name in merged:
            merged[name]["twins"] += result["twins"]
        else:
            merged[name] = result
    return merged


def table(results: dict[str, Any]) -> list[dict[str, Any]]:
    """The numbers of `benchmark` as rows, one per method and twin, for `pandas.DataFrame`.

    Args:
        results: What `benchmark` returns.

    Returns:
        Dicts with `method`, `seed` and a number for each name, SI units: `random.localisation_m.mean`.
    """
    return [{"method": name, **_flat(twin)} for name, result in results.items() for twin in result["twins"]]


class Sweep(NamedTuple):
    """The result of a sweep.

    Attributes:
        best: The folder of the best model.
        trials: A dict per trial, the best first: its `options`, the folder of its `model`, its `score`, its `test_loss`, and
            `error`: None, or why it has no score.
    """

    best: Path
    trials: list[dict[str, Any]]


def sweep(
    design: str | PathLike[str],
    output: str | PathLike[str],
    space: dict[str, Any],
    *,
    trials: int = 1,
    seed: int = 1,
    benchmark: dict[str, Any] | None = None,
    threads: int = 1,
) -> Sweep:
    """Trains networks with many settings by Ray Tune, and exports the best one.

    Each trial is `dermis train` with a folder of its own in `output`, in which it continues after its last epoch when its
    node dies. After the end of this process the same call continues the sweep.

    Args:
        design: A shipped name, or the path of a design file that all nodes see.
        output: The folder, shared by all nodes: `best` (the best model), `models`, and the state of the sweep.
        space: Options of `dermis train` by name, with underscores for hyphens: a value, or a distribution of Tune
            (`ray.tune.grid_search(["paper", "spots"])`). Recipes are `stream`, datasets `data`.
        trials: Number of draws from the distributions; each with every combination of the grids.
        seed: Seed of the draws.
        benchmark: Options of `dermis benchmark`. With it, the score is the mean localisation error of its random presses over all
            twins, m: required to compare recipes, whose test samples differ. Without it, the score is the lowest test loss.
        threads: Threads of each trial, as many CPUs as it asks Ray for.

    Returns:
        A `Sweep`.

    Raises:
        DermisError: An unknown option; a folder with another sweep; no trial that has succeeded; a node without dermis or with
            another version.
    """
    from ray import tune

    _check_count("trials", trials)
    _check_options("train", space, ("design", "output", "json"))
    _check_options("benchmark", benchmark or {}, ("design", "method", "map", "curve", "json"))
    _check_threads(threads)
    output = Path(os.path.abspath(output))
    record = {"design": os.fspath(design), "space": {name: _text(space[name]) for name in sorted(space)}}
    record.update(trials=trials, seed=seed, benchmark=benchmark, version=__version__)
    _check_record(output, json.loads(json.dumps(record, default=os.fspath)))
    _connect(threads)
    job = (os.getcwd(), os.fspath(design), str(output / "models"), benchmark, threads)
    trainable = tune.with_resources(_trial(__version__, job), {"cpu": threads})
    if tune.Tuner.can_restore(str(output / "tune")):
        tuner = tune.Tuner.restore(str(output / "tune"), trainable, resume_unfinished=True, resume_errored=True)
    else:
        search = tune.search.BasicVariantGenerator(random_state=seed)
        tuner = tune.Tuner(
            trainable,
            param_space=dict(space),
            tune_config=tune.TuneConfig(num_samples=trials, search_alg=search),
            run_config=tune.RunConfig(
                name="tune",
                storage_path=str(output),
                failure_config=tune.FailureConfig(max_failures=_TRIAL_RETRIES),
                verbose=int(sys.stderr.isatty()),
            ),
        )
    return _export(output, tuner.fit())


def _export(output, results):
    """Copies the model with the lowest score, completely or not at all."""
    trials = [_outcome(result) for result in results]
    trials.sort(key=lambda trial: (trial["error"] is not None, trial["score"]))
    if trials[0]["error"] is not None:
        raise DermisError(f"none of {len(trials)} trainings has succeeded: {trials[0]['error']}")
    best, part = output / "best", output / f".part-best-{os.getpid()}"
    shutil.rmtree(part, ignore_errors=True)
    shutil.copytree(trials[0]["model"], part, ignore=shutil.ignore_patterns("checkpoint.safetensors"))
    if best.exists():
        shutil.rmtree(best)
    part.rename(best)
    return Sweep(best, trials)


def _outcome(result):
    """A trial of Tune as a dict."""
    metrics = result.metrics or {}
    error = metrics.get("error")
    if error is None and "score" not in metrics:
        error = str(result.error or "it has not ended")
    return {"options": result.config, "error": error, **{key: metrics.get(key) for key in ("score", "test_loss", "model")}}


def _check_record(output, record):
    """Writes the record of a sweep into its folder, or checks the one that is there."""
    path = output / "sweep.json"
    if path.exists():
        there = json.loads(path.read_text())
        different = [key for key in record if there.get(key) != record[key]]
        if different:
            key = different[0]
            raise DermisError(
                f"{output} holds another sweep: its `{key}` is {there.get(key)}, not {record[key]}",
                hint="continue it with its own settings, or use another folder",
            )
        return
    output.mkdir(parents=True, exist_ok=True)
    write_whole(path, json.dumps(record, indent=2).encode())


# Connection, tasks.


def _connect(threads):
    """Connects to the cluster of `RAY_ADDRESS`, or starts Ray on this machine."""
    address = os.environ.get("RAY_ADDRESS")
    if address and not ray.is_initialized():
        try:
            _check_answers(address)
            ray.init(address=address, logging_level="warning")
        except (OSError, RuntimeError, ValueError) as error:
            hint = "start it with `ray start --head`, or unset RAY_ADDRESS to use this machine"
            raise DermisError(f"no Ray cluster answers at RAY_ADDRESS={address}: {error}", hint=hint) from error
    elif not ray.is_initialized():
        ray.init(address="local", include_dashboard=False, logging_level="warning")
    if not address:
        most = int(max(node["Resources"].get("CPU", 0) for node in ray.nodes() if node["Alive"]))
        if threads > most:
            raise DermisError(f"`threads` is {threads}, but Ray has nodes with {most} CPUs at most", hint=f"give 1 to {most}")


def _check_answers(address):
    """Tries to reach an address: Ray itself would try for minutes."""
    host, _, port = address.removeprefix("ray://").rpartition(":")
    if host:
        socket.create_connection((host.strip("[]"), int(port)), timeout=_CONNECT_TIMEOUT_S).close()


def _results(name, calls, threads):
    """Runs a function of this module in tasks; yields the number of each call and its result as they end."""
    _connect(threads)
    remote = ray.remote(num_cpus=threads, max_retries=_RETRIES)(_on_a_node())
    waiting, running = iter(enumerate(calls)), {}
    try:
        while True:
            for number, arguments in itertools.islice(waiting, _AT_ONCE - len(running)):
                running[remote.remote(__version__, name, arguments)] = number
            if not running:
                return
            done, _ = ray.wait(list(running), timeout=1)
            for reference in done:
                yield running.pop(reference), _answer(reference)
    finally:
        for reference in running:
            ray.cancel(reference)


def _answer(reference):
    """The result of a task; its error, if it has one."""
    try:
        result, error = ray.get(reference)
    except _SYSTEM_FAILURES as failure:
        raise DermisError(f"a task has died {_RETRIES + 1} times: {failure}", hint="see the logs of Ray") from failure
    if error:
        raise DermisError(**error)
    return result


def _on_a_node():
    """The body of tasks. A function in a function: Ray sends its code, so that a node without dermis can say so."""

    def on_a_node(version, name, arguments):
        import ray

        node = ray.util.get_node_ip_address()
        try:
            import dermis

            found = dermis.__version__
        except ImportError as error:
            message = f"node {node} cannot import dermis: {error}; this process has version {version}"
            return None, {"message": message, "hint": f"install version {version} there"}
        if found != version:
            message = f"node {node} has version {found} of dermis; this process has version {version}"
            return None, {"message": message, "hint": "install one version on all nodes"}
        import dermis.ray

        try:
            return getattr(dermis.ray, name)(*arguments), None
        except dermis.DermisError as error:
            return None, {"message": f"node {node}: {error.message}", "hint": error.hint}

    return on_a_node


def _trial(version, job):
    """The body of trials."""
    body = _on_a_node()

    def trial(options):
        from ray import tune

        result, error = body(version, "_train", (*job, tune.get_context().get_trial_id(), options))
        tune.report(result or {"error": error["message"]})
        if error:
            raise RuntimeError(error["message"])

    return trial


# On the nodes.


@functools.lru_cache(maxsize=2)
def _simulation(skin, recipe, seed, samples):
    return pickle.loads(skin).simulation(json.loads(recipe), seed=seed, samples=samples)


def _simulate_file(skin, recipe, seed, samples, folder, number, threads):
    """Generates a file of a dataset; the number of generated samples."""
    if not (Path(folder) / "run.json").exists():
        raise DermisError(f"{folder} is not there or empty", hint="give a folder that all nodes share")
    simulation = _simulation(skin, recipe, seed, samples)
    return simulation.run(folder, (number, simulation.files), threads=threads, wait=True)


def _benchmark_twin(base, design, options, threads):
    os.environ["RAYON_NUM_THREADS"] = str(threads)
    design = _path(base, design)
    given = {"twin": _path(base, options["twin"]), "method": _method(base, design, options["method"])}
    return command("benchmark", design, twins=1, **{**options, **given})


def _train(base, design, models, benchmark, threads, trial, options):
    """Trains a network, or continues; its score and folder."""
    os.environ["RAYON_NUM_THREADS"] = str(threads)
    model = Path(models) / trial
    given = {name: _path(base, value) if name in _FILES else value for name, value in options.items()}
    given.update({name: _folders(base, options[name]) for name in _FOLDERS if options.get(name)})
    design = _path(base, design)
    epochs = command("train", design, output=model, **given)["epochs"]
    result = {"model": str(model), "test_loss": min(epoch["test_loss"] for epoch in epochs)}
    if not benchmark:
        return {**result, "score": result["test_loss"]}
    twins = command("benchmark", design, method=model, **benchmark)["twins"]
    errors = [twin["random"]["localisation_m"]["mean"] for twin in twins]
    # Without a contact there is no error of its position.
    missing = any(error is None for error in errors)
    return {**result, "score": float("inf") if missing else sum(errors) / len(errors)}


# Values.


def _path(base, value):
    """The path of a file from the folder of the caller; names as they are."""
    path = Path(base) / value
    return str(path) if path.is_file() else os.fspath(value)


def _method(base, design, value):
    """The folder of a network from the folder of the caller; names of methods as they are, before folders of that name."""
    path, name = Path(base) / value, os.fspath(value)
    return str(path) if path.is_dir() and name not in Skin.load(design).methods else name


def _folders(base, value):
    """The paths of one or several folders from the folder of the caller."""
    return [str(Path(base) / item) for item in (value if isinstance(value, (list, tuple)) else [value])]


def _keys(recipe):
    """A recipe as a dict."""
    return recipe if isinstance(recipe, dict) else tomllib.loads(Path(recipe).read_text())


def _text(value):
    """A value or a distribution of Tune in words."""
    if not hasattr(value, "domain_str"):
        return value
    if " at 0x" in value.domain_str:
        raise DermisError("a function of Tune has no name by which a sweep is continued", hint="use tune.choice or another draw")
    # A rounded distribution gives its step alone with its sampler.
    return f"{type(value).__name__} {value.domain_str} {value.get_sampler()} {getattr(value.sampler, 'q', '')}"


def _flat(value, name=""):
    """The numbers of nested dicts, by dotted names."""
    if isinstance(value, dict):
        rows = {}
        for key, item in value.items():
            rows.update(_flat(item, f"{name}.{key}" if name else key))
        return rows
    return {name: value} if isinstance(value, (int, float)) and not isinstance(value, bool) else {}


def _check_count(name, value):
    if not (isinstance(value, int) and value > 0):
        raise DermisError(f"`{name}` is {value!r}", hint="give a whole number, at least 1")


def _check_threads(threads):
    _check_count("threads", threads)


def _check_options(name, options, reserved):
    """Refuses options that a command does not have, or that are set here."""
    known = {option.replace("-", "_") for option in options_of(name)} - set(reserved)
    for option in options:
        if option not in known:
            raise DermisError(f"{name} has no option {option!r} here", hint=f"one of {', '.join(sorted(known))}")
