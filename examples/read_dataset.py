"""Read a dataset of `dermis simulate` with NumPy and with PyTorch, without Dermis.

python read_dataset.py DIR      (pip install numpy; safetensors and torch are used where they are installed)
"""

import json
import sys
from pathlib import Path

import numpy as np


def tensors(path):
    """The tensors of one file as views of a memory map: nothing is read before it is used."""
    with open(path, "rb") as file:
        length = int.from_bytes(file.read(8), "little")
        header = json.loads(file.read(length))
    data = np.memmap(path, dtype=np.uint8, mode="r", offset=8 + length)
    del header["__metadata__"]
    return {
        name: data[slice(*entry["data_offsets"])].view("<f4").reshape(entry["shape"])
        for name, entry in header.items()
    }


def samples(folder):
    """A file's frames less the untouched frame, normalised by channel, and its images; file by file."""
    manifest = json.loads((folder / "manifest.json").read_text())
    statistics = manifest["statistics"]
    mean = np.array(statistics["difference_mean_ohm"], dtype=np.float32)
    sd = np.array(statistics["difference_sd_ohm"], dtype=np.float32)
    for file in manifest["files"]:
        held = tensors(folder / file["name"])
        # `rest` has one row for all samples, or one for each: both subtract alike.
        yield (held["frames"] - held["rest"] - mean) / sd, held["images"], held["touches"]


def pytorch(folder):
    """The same as a data set for a DataLoader that shuffles over all files."""
    import torch

    class Samples(torch.utils.data.Dataset):
        def __init__(self):
            manifest = json.loads((folder / "manifest.json").read_text())
            self.count = manifest["record"]["recipe"]["samples"]
            self.per_file = manifest["record"]["samples_per_file"]
            self.files = [tensors(folder / file["name"]) for file in manifest["files"]]

        def __len__(self):
            return self.count

        def __getitem__(self, index):
            held, row = self.files[index // self.per_file], index % self.per_file
            rest = held["rest"][row if len(held["rest"]) > 1 else 0]
            return torch.from_numpy(held["frames"][row] - rest), torch.from_numpy(held["images"][row].copy())

    return Samples()


def main():
    folder = Path(sys.argv[1])
    squares, sums, count, images = 0.0, 0.0, 0, 0.0
    for frames, pictures, touches in samples(folder):
        assert np.isfinite(frames).all() and np.isfinite(touches[:, 0]).all()
        sums = sums + frames.sum(axis=0, dtype=np.float64)
        squares = squares + (frames.astype(np.float64) ** 2).sum(axis=0)
        images += pictures.sum(dtype=np.float64)
        count += len(frames)
    mean = sums / count
    sd = np.sqrt(squares / count - mean**2)
    print(f"{count} samples; normalised channels have mean within {abs(mean).max():.1e} of 0, "
          f"standard deviation within {abs(sd - 1).max():.1e} of 1")
    manifest = json.loads((folder / "manifest.json").read_text())
    assert count == manifest["statistics"]["samples"]
    assert abs(mean).max() < 1e-4 and abs(sd - 1).max() < 1e-4
    first = tensors(folder / manifest["files"][0]["name"])
    pixels = first["images"].shape[1]
    assert abs(images / (count * pixels) / manifest["statistics"]["image_mean"] - 1) < 1e-9
    try:
        from safetensors.numpy import load_file
    except ImportError:
        print("safetensors is not installed: not tried")
    else:
        again = load_file(folder / manifest["files"][0]["name"])
        assert all(np.array_equal(first[name], again[name], equal_nan=True) for name in first) and len(first) == len(again)
        print("safetensors reads the same values")
    try:
        data = pytorch(folder)
    except ImportError:
        print("PyTorch is not installed: not tried")
    else:
        import torch

        batch = next(iter(torch.utils.data.DataLoader(data, batch_size=360, shuffle=True)))
        assert batch[0].shape[1] == first["frames"].shape[1] and torch.isfinite(batch[0]).all()
        frame, image = data[count - 1]
        last = tensors(folder / manifest["files"][-1]["name"])
        assert np.array_equal(image.numpy(), last["images"][-1])
        assert np.array_equal(frame.numpy(), last["frames"][-1] - last["rest"][-1])
        print(f"PyTorch draws batches of {tuple(batch[0].shape)} and {tuple(batch[1].shape)}")


if __name__ == "__main__":
    main()
