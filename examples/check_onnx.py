"""Check an ONNX file of `dermis export` against images that Dermis made of the same frames, with ONNX Runtime.

python check_onnx.py MODEL.onnx DIFFERENCES.npy IMAGES.npy      (pip install numpy onnxruntime; onnx, where installed, checks the file)

DIFFERENCES are frames less the untouched frame, ohm, a row each; IMAGES what `dermis reconstruct` made of them. Images must
agree to 1e-5 of the largest value; one frame alone, and all at once.
"""

import sys

import numpy as np
import onnxruntime

AGREEMENT = 1e-5


def session(path, threads=1):
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = threads
    options.inter_op_num_threads = 1
    return onnxruntime.InferenceSession(path, options, providers=["CPUExecutionProvider"])


def main():
    path, differences, images = sys.argv[1:]
    differences = np.load(differences).astype(np.float32)
    images = np.load(images).reshape(len(differences), -1)
    # A picture has no numbers outside the body; the network gives the pixels inside.
    images = images[:, np.isfinite(images[0])]
    try:
        import onnx
    except ImportError:
        print("onnx is not installed: the file's form is checked by ONNX Runtime alone")
    else:
        onnx.checker.check_model(path, full_check=True)
    network = session(path)
    (given,), (made,) = network.get_inputs(), network.get_outputs()
    assert (given.name, made.name) == ("difference_ohm", "image"), (given.name, made.name)
    together = network.run(None, {given.name: differences})[0]
    alone = np.concatenate([network.run(None, {given.name: row[None]})[0] for row in differences])
    largest = np.abs(images).max()
    for name, theirs in (("all at once", together), ("one by one", alone)):
        worst = np.abs(theirs - images).max() / largest
        print(f"{name}: {len(images)} images of {images.shape[1]} pixels agree to {worst:.1e} of the largest value, {largest:.3g}")
        if not worst <= AGREEMENT:
            sys.exit(f"more than {AGREEMENT:.0e}")


if __name__ == "__main__":
    main()
