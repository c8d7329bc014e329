"""Datasets by URL: local folders, memory, and S3 of a local server. Skipped without fsspec; S3 without s3fs and moto."""

import functools
import http.server
import shutil
import threading

import pytest

import dermis

fsspec = pytest.importorskip("fsspec")
from dermis.remote import copy_dataset, open_dataset  # noqa: E402

RECIPE = {"skins": "even", "touch": {"gaussian": {"most": 1, "width_m": [0.004, 0.012], "amplitude": [0.1, 0.3]}}}
DISK = {
    "body": {"disk": {"diameter_m": 0.1}},
    "sheet": {"sheet_resistance_ohm": 1000, "touch": "conductance_rises"},
    "electrodes": {"shape": {"arc": {"length_m": 0.005}}, "contact_impedance_ohm_m": 0.01, "layout": {"rim": {"count": 8}}},
    "protocol": {"pattern": "adjacent_undriven"},
    "image": {"grid": {"rows": 8, "columns": 8}},
    "mesh": {"max_edge_m": 0.02, "electrode_edge_m": 0.0025},
}


def made(folder, seed=1):
    """A dataset of two files."""
    dermis.Skin.load(DISK).simulation(RECIPE, seed=seed, samples=8300).run(folder)
    return dermis.finish_dataset(folder)


def bytes_of(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir()}


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    return made(tmp_path_factory.mktemp("data") / "set").folder


@pytest.fixture
def memory():
    system = fsspec.filesystem("memory")
    yield system
    system.store.clear()
    system.pseudo_dirs[:] = [""]


@pytest.fixture
def s3(monkeypatch):
    """The options of a bucket's server."""
    pytest.importorskip("s3fs")
    server = pytest.importorskip("moto.server").ThreadedMotoServer(port=0, verbose=False)
    server.start()
    host, port = server.get_host_and_port()
    options = {"key": "a", "secret": "b", "endpoint_url": f"http://{host}:{port}"}
    fsspec.filesystem("s3", **options).mkdir("skins")
    yield options
    server.stop()


def test_a_copy_has_the_same_bytes(data, memory, tmp_path):
    copy_dataset(data, "memory://bucket/set")
    copy_dataset("memory://bucket/set", tmp_path / "copy")
    copy_dataset(f"file://{tmp_path}/copy", tmp_path / "other")
    assert bytes_of(tmp_path / "copy") == bytes_of(tmp_path / "other") == bytes_of(data)
    opened = open_dataset("memory://bucket/set", cache=tmp_path / "cache")
    assert len(opened) == 8300 and opened.folder.parent == tmp_path / "cache"
    assert bytes_of(opened.folder) == bytes_of(data)


def test_s3(data, s3, tmp_path):
    copy_dataset(data, "s3://skins/a/set", target_options=s3)
    opened = open_dataset("s3://skins/a/set", cache=tmp_path / "cache", **s3)
    assert bytes_of(opened.folder) == bytes_of(data)
    system = fsspec.filesystem("s3", **s3)
    name = "skins/a/set/samples-00001.safetensors"
    system.pipe_file(name, b"0" + system.cat_file(name)[1:])
    with pytest.raises(dermis.DermisError, match="samples-00001.safetensors is damaged: its SHA-256 is"):
        open_dataset("s3://skins/a/set", cache=tmp_path / "second", **s3)
    with pytest.raises(dermis.DermisError, match="holds no finished dataset"):
        open_dataset("s3://skins/nothing", cache=tmp_path / "cache", **s3)
    with pytest.raises(dermis.DermisError, match="s3://nowhere"):
        copy_dataset(data, "s3://nowhere/set", target_options=s3)


def test_an_interrupted_copy_is_no_dataset_and_continues(data, memory, tmp_path, monkeypatch):
    url = "memory://bucket/set"
    write = memory.open

    def full(path, *arguments, **options):
        if path.endswith("samples-00001.safetensors"):
            raise OSError(28, "No space left on device")
        return write(path, *arguments, **options)

    with monkeypatch.context() as patch:
        patch.setattr(memory, "open", full)
        with pytest.raises(dermis.DermisError, match="No space left"):
            copy_dataset(data, url)
    with pytest.raises(dermis.DermisError, match="holds no finished dataset"):
        open_dataset(url, cache=tmp_path / "cache")
    before = memory.created("/bucket/set/samples-00000.safetensors")
    copy_dataset(data, url)
    assert memory.created("/bucket/set/samples-00000.safetensors") == before
    assert bytes_of(open_dataset(url, cache=tmp_path / "cache").folder) == bytes_of(data)


def test_a_cache_with_a_damaged_length_is_repaired(data, tmp_path):
    folder = open_dataset(data, cache=tmp_path).folder
    path = folder / "samples-00000.safetensors"
    path.write_bytes(path.read_bytes()[:1000])
    open_dataset(data, cache=tmp_path)
    assert bytes_of(folder) == bytes_of(data)


def test_damage_leaves_no_file(data, tmp_path):
    damaged, target = tmp_path / "damaged", tmp_path / "target"
    shutil.copytree(data, damaged)
    path = damaged / "samples-00000.safetensors"
    path.write_bytes(path.read_bytes()[:-1] + b"x")
    with pytest.raises(dermis.DermisError, match="samples-00000.safetensors is damaged") as error:
        copy_dataset(damaged, target)
    assert error.value.hint
    assert [path.name for path in target.iterdir()] == ["run.json"]


def test_other_datasets_are_not_overwritten(data, tmp_path):
    other = made(tmp_path / "other", seed=2).folder
    before = bytes_of(other)
    with pytest.raises(dermis.DermisError, match="holds another dataset"):
        copy_dataset(data, other)
    assert bytes_of(other) == before


@pytest.mark.parametrize(
    ("url", "words"),
    [
        ("no-such-folder", "no-such-folder holds no finished dataset"),
        ("nothing://a/b", "nothing://a/b cannot be opened"),
        ("memory://nothing/here", "holds no finished dataset"),
    ],
)
def test_urls_without_a_dataset_are_named(url, words, tmp_path):
    with pytest.raises(dermis.DermisError, match=words):
        open_dataset(url, cache=tmp_path)


def test_a_manifest_with_foreign_names_is_refused(data, tmp_path):
    folder = tmp_path / "set"
    shutil.copytree(data, folder)
    path = folder / "manifest.json"
    for old, new in [("samples-00000.safetensors", "../x"), ('"files"', '"file"')]:
        path.write_text((data / "manifest.json").read_text().replace(old, new))
        with pytest.raises(dermis.DermisError, match="is no manifest"):
            open_dataset(folder, cache=tmp_path / "cache")


def test_a_dataset_is_copied_from_a_web_server(data, tmp_path):
    """Its listings have no lengths."""
    pytest.importorskip("aiohttp")
    handler = functools.partial(http.server.SimpleHTTPRequestHandler, directory=data.parent)
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        url = f"http://127.0.0.1:{server.server_port}"
        copy_dataset(f"{url}/{data.name}", tmp_path / "copy")
        with pytest.raises(dermis.DermisError):
            copy_dataset(data, f"{url}/other")
        server.shutdown()
    assert bytes_of(tmp_path / "copy") == bytes_of(data)
