"""Training samples as datasets."""

import operator
import os
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from dermis._dermis import Dataset as _Dataset
from dermis._dermis import Samples, Skin


class SampleDataset(torch.utils.data.Dataset[dict[str, Tensor]]):
    """The samples of a folder of `dermis simulate`, map-style.

    A sample is a dict of tensors: `frame` and `rest` (channels,), `image` (pixels,), `touches` (most, 6), `index`; see
    `dermis.Dataset.batch`. `__getitems__` reads a whole batch at once.

    Args:
        folder: The folder of the dataset.
    """

    folder: str

    def __init__(self, folder: str | os.PathLike[str]) -> None:
        self.folder = os.fspath(folder)
        self._dataset = _Dataset(self.folder)

    def __len__(self) -> int:
        return len(self._dataset)

    def __getitem__(self, index: int) -> dict[str, Tensor]:
        return self.__getitems__([operator.index(index)])[0]

    def __getitems__(self, indices: Sequence[int]) -> list[dict[str, Tensor]]:
        length = len(self)
        if wrong := [index for index in indices if not -length <= index < length]:
            raise IndexError(f"sample {wrong[0]} of {length}")
        return _samples(self._dataset.batch([index + length if index < 0 else index for index in indices]))

    def __getstate__(self) -> str:
        return self.folder

    def __setstate__(self, folder: str) -> None:
        self.__init__(folder)


class SampleStream(torch.utils.data.IterableDataset[dict[str, Tensor]]):
    """The endless stream of samples of a recipe; each worker of a DataLoader computes its own part.

    Args:
        skin: A `dermis.Skin`.
        recipe: The path of a recipe file, or a dict with its keys.
        seed: The seed.
        first: Index of the first sample.
        block: Number of samples that are computed at once.
    """

    skin: Skin
    recipe: str | os.PathLike[str] | dict[str, Any]
    seed: int
    first: int
    block: int
    _samples: Samples | None

    def __init__(
        self,
        skin: Skin,
        recipe: str | os.PathLike[str] | dict[str, Any],
        seed: int,
        *,
        first: int = 0,
        block: int = 512,
    ) -> None:
        self.skin, self.recipe, self.seed, self.first, self.block = skin, recipe, seed, first, block
        self._samples = None

    def __iter__(self) -> Iterator[dict[str, Tensor]]:
        if self._samples is None:
            self._samples = self.skin.samples(self.recipe, self.seed)
        worker = torch.utils.data.get_worker_info()
        number, count = (0, 1) if worker is None else (worker.id, worker.num_workers)
        at = self.first + number * self.block
        while True:
            yield from _samples(self._samples.batch(at, self.block))
            at += count * self.block

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_samples": None}


def _samples(arrays: dict[str, NDArray[Any]]) -> list[dict[str, Tensor]]:
    """The samples of a batch, one dict each."""
    tensors = {name: torch.from_numpy(values.astype(np.int64) if name == "index" else values) for name, values in arrays.items()}
    count = len(arrays["index"])
    return [{name: values[row] for name, values in tensors.items()} for row in range(count)]
