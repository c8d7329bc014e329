"""Datasets in object stores and on other file systems, by URL: whatever fsspec opens (s3://, gs://, hdfs://, sftp://, ...).

>>> import dermis, dermis.remote
>>> recipe = {"skins": "even", "touch": {"gaussian": {"most": 2, "width_m": [0.004, 0.012], "amplitude": [0.1, 0.3]}}}
>>> dermis.Skin.load("skin16").simulation(recipe, seed=1, samples=100).run("data")
100
>>> dermis.remote.copy_dataset(dermis.finish_dataset("data").folder, "memory://bucket/data")
>>> len(dermis.remote.open_dataset("memory://bucket/data", cache="cache"))
100
"""

import hashlib
import json
import os
import re
import uuid
from os import PathLike
from pathlib import Path
from typing import Any

import fsspec
from fsspec.implementations.local import LocalFileSystem

from dermis._dermis import Dataset
from dermis._errors import DermisError

__all__ = ["copy_dataset", "open_dataset"]

_MANIFEST, _RECORD = "manifest.json", "run.json"
_BLOCK = 8 << 20
# Stores of objects have no folders: to make one there would make a bucket.
_WITHOUT_FOLDERS = {"s3", "s3a", "gs", "gcs", "abfs", "abfss", "adl", "az", "oci", "oss"}
# Stores have errors of their own: of credentials, of operations that they do not have.
_ERRORS = Exception
# Names of files, and identities.
_PLAIN = re.compile(r"samples-\d+\.safetensors|[0-9a-f]{64}")


def open_dataset(url: str | PathLike[str], *, cache: str | PathLike[str] | None = None, **options: Any) -> Dataset:
    """Opens a finished dataset by its URL.

    Dermis maps files into memory, so the dataset is copied into a folder of the cache first, where the next call finds it. A
    copy is complete or continued by the next call; every file that is copied must have the checksum of the manifest.

    Args:
        url: A URL or the path of a folder.
        cache: The folder of the cache; `dermis` in `$XDG_CACHE_HOME` or in `~/.cache` without it.
        **options: Options of the file system, as of `fsspec.filesystem`: `endpoint_url`, `key`, `secret`, ...

    Raises:
        DermisError: A URL without a finished dataset or whose file system is not installed; a file that does not have its
            checksum.
    """
    source = _Folder(url, options)
    manifest = source.manifest()
    if cache is None:
        cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "dermis"
    folder = Path(cache) / manifest["identity"]
    _copy(source, manifest, _Folder(folder, {}))
    return Dataset(folder)


def copy_dataset(
    source: str | PathLike[str],
    target: str | PathLike[str],
    *,
    source_options: dict[str, Any] | None = None,
    target_options: dict[str, Any] | None = None,
) -> None:
    """Copies a finished dataset between folders and URLs. The manifest is written last: without it no reader opens the copy.

    A copy that was interrupted continues: a file of the right length is taken as complete. Every file that is copied must have
    the checksum of the manifest.

    Args:
        source: A URL or the path of a folder.
        target: A URL or the path of a folder, empty or with a part of the same dataset.
        source_options: Options of the source's file system, as of `fsspec.filesystem`.
        target_options: Options of the target's file system.

    Raises:
        DermisError: A source without a finished dataset, or with a file that does not have its checksum; a target with another
            dataset; a file system that refuses.
    """
    origin = _Folder(source, source_options or {})
    _copy(origin, origin.manifest(), _Folder(target, target_options or {}))


def _copy(source, manifest, target):
    """Copies what the target does not have."""
    there = target.read(_MANIFEST)
    record = source.read(_RECORD)
    if record is None or hashlib.sha256(record).hexdigest() != manifest["identity"]:
        raise DermisError(f"{source.of(_RECORD)} is not the record of the dataset", hint="check it with `dermis simulate --verify`")
    known = target.read(_RECORD)
    if known is not None and known != record:
        raise DermisError(f"{target} holds another dataset", hint="use another folder, or remove it")
    sizes = target.sizes()
    if known is None and set(sizes) & {file["name"] for file in manifest["files"]}:
        raise DermisError(f"{target} has files without their {_RECORD}", hint="use another folder, or remove them")
    text = source.read(_MANIFEST)
    # Files are written whole, and their length follows from the record: one of this length is complete.
    expected = source.sizes()
    is_there = lambda name: sizes.get(name) is not None and sizes[name] == expected.get(name)
    missing = [file for file in manifest["files"] if not is_there(file["name"])]
    if there == text and not missing:
        return
    if there is not None:
        target.remove(_MANIFEST)
    if known is None:
        target.write(_RECORD, [record])
    for file in missing:
        _copy_file(source, file, target)
    target.write(_MANIFEST, [text])


def _copy_file(source, file, target):
    """Copies a file and checks it."""
    name, digest = file["name"], hashlib.sha256()

    def blocks():
        for block in source.blocks(name):
            digest.update(block)
            yield block
        if digest.hexdigest() != file["sha256"]:
            message = f"{source.of(name)} is damaged: its SHA-256 is {digest.hexdigest()}, not {file['sha256']}"
            raise DermisError(message, hint="generate or copy it again")

    target.write(name, blocks())


def _words(protocol):
    return [protocol] if isinstance(protocol, str) else protocol


class _Folder:
    """A folder of a file system."""

    def __init__(self, url, options):
        self.url = os.fspath(url)
        try:
            self.system, self.path = fsspec.core.url_to_fs(self.url, **options)
        except (ImportError, ValueError, TypeError) as error:
            raise DermisError(f"{self.url} cannot be opened: {error}") from error
        self.is_local = isinstance(self.system, LocalFileSystem)

    def __str__(self):
        return self.url

    def of(self, name):
        """The name of a file in messages."""
        return f"{self.url.rstrip('/')}/{name}"

    def manifest(self):
        """The manifest of a finished dataset."""
        text = self.read(_MANIFEST)
        if text is None:
            hint = "finish it with `dermis simulate --finish`, or copy it with `dermis.remote.copy_dataset`"
            raise DermisError(f"{self.url} holds no finished dataset: it has no {_MANIFEST}", hint=hint)
        try:
            manifest = json.loads(text)
            names = [file["name"] for file in manifest["files"]]
            [file["sha256"] for file in manifest["files"]]
            is_plain = all(_PLAIN.fullmatch(name) for name in [manifest["identity"], *names])
        except (ValueError, KeyError, TypeError) as error:
            raise DermisError(f"{self.of(_MANIFEST)} is no manifest: {error!r}") from error
        if not is_plain:
            raise DermisError(f"{self.of(_MANIFEST)} is no manifest: it has names that `dermis simulate` does not give")
        return manifest

    def read(self, name):
        """The bytes of a small file; None if it does not exist."""
        try:
            return self.system.cat_file(self._path(name))
        except FileNotFoundError:
            return None
        except DermisError:
            raise
        except _ERRORS as error:
            raise self._refused(name, error) from error

    def sizes(self):
        """The length of each file, by name."""
        try:
            # S3 and others remember listings, which other processes change.
            self.system.invalidate_cache(self.path)
            entries = self.system.ls(self.path, detail=True)
        except FileNotFoundError:
            return {}
        except DermisError:
            raise
        except _ERRORS as error:
            raise self._refused("", error) from error
        files = {entry["name"].rstrip("/").rpartition("/")[2]: entry for entry in entries if entry["type"] == "file"}
        return {name: self._size(name, entry) for name, entry in files.items()}

    def _size(self, name, entry):
        """The length of a file; listings of web servers do not have it."""
        if entry["size"] is not None:
            return entry["size"]
        try:
            return self.system.size(self._path(name))
        except _ERRORS as error:
            raise self._refused(name, error) from error

    def blocks(self, name):
        """The bytes of a file, in blocks."""
        try:
            with self.system.open(self._path(name), "rb") as file:
                while block := file.read(_BLOCK):
                    yield block
        except DermisError:
            raise
        except _ERRORS as error:
            raise self._refused(name, error) from error

    def write(self, name, blocks):
        """Writes a file; what is not complete is removed."""
        # Local files appear before they are complete; an upload appears when it is closed.
        part = self._path(f".part-{uuid.uuid4().hex}" if self.is_local else name)
        try:
            if _WITHOUT_FOLDERS.isdisjoint(_words(self.system.protocol)):
                self.system.makedirs(self.path, exist_ok=True)
            file = self.system.open(part, "wb")
            try:
                for block in blocks:
                    file.write(block)
                if self.is_local:
                    file.flush()
                    os.fsync(file.fileno())
                file.close()
                if self.is_local:
                    os.replace(part, self._path(name))
            except BaseException:
                self._discard(file, part)
                raise
        except DermisError:
            raise
        except _ERRORS as error:
            raise self._refused(name, error) from error

    def _discard(self, file, path):
        """Ends an incomplete file without a trace."""
        if self.is_local or not hasattr(file, "discard"):
            file.close()
        else:
            file.discard()
            file.closed = True
        if self.system.exists(path):
            self.system.rm_file(path)

    def remove(self, name):
        """Removes a file."""
        try:
            self.system.rm_file(self._path(name))
        except DermisError:
            raise
        except _ERRORS as error:
            raise self._refused(name, error) from error

    def _path(self, name):
        return f"{self.path.rstrip('/')}/{name}"

    def _refused(self, name, error):
        return DermisError(f"{self.of(name)}: {error}")
