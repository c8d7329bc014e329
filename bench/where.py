"""Sums up samples of `perf` by stage: `where.sh` calls it."""

import collections
import re
import subprocess
import sys

# The stage of a sample is that of the first of these functions that its instruction was inlined from.
STAGES = {
    "subtract_products": "update products",
    "factor_panel": "panel factorisation",
    "add_to_panel": "extend-add",
    "add_to_update": "extend-add",
    "add_entries": "assembly",
    "pseudo_inverse": "inverse of the electrodes' matrices",
    "eliminate_all": "clearing and the rest of a front",
    "transfer_impedances": "result",
    "solve_into": "checks, copies and frames",
}


def load_bias(program, samples):
    """Difference between an address when running and in the file."""
    start, offset = next(
        (int(start, 16), int(offset, 16))
        for start, offset in re.findall(r"\[(0x\w+)\(0x\w+\) @ (0x\w+|0) .*r-xp .*dermis-bench", samples)
    )
    headers = subprocess.run(["readelf", "-lW", program], stdout=subprocess.PIPE, text=True, check=True).stdout
    segment = re.search(r"LOAD +(0x\w+) (0x\w+) \S+ \S+ \S+ R E", headers)
    return start - offset + int(segment[1], 16) - int(segment[2], 16)


def stages(program, addresses):
    """The stage of each address; `None` for one of another part of the program."""
    ordered = sorted(addresses)
    text = "\n".join(map(hex, ordered))
    lines = subprocess.run(
        ["addr2line", "-e", program, "-i", "-f", "-C", "-a"], input=text, stdout=subprocess.PIPE, text=True, check=True
    ).stdout
    blocks = re.split(r"^0x", lines, flags=re.M)[1:]
    found = {}
    for address, block in zip(ordered, blocks):
        found[address] = next((stage for name, stage in STAGES.items() if re.search(rf"\b{name}\b", block)), None)
    return found


def main():
    program, path = sys.argv[1:]
    samples = open(path).read()
    bias = load_bias(program, samples)
    counts, elsewhere = collections.Counter(), collections.Counter()
    for address, symbol, where in re.findall(r"^\s*\S+\s+([0-9a-f]+) (.*) \((.*)\)$", samples, flags=re.M):
        if where.endswith("dermis-bench"):
            counts[int(address, 16) - bias] += 1
        elif "mem" in symbol:
            elsewhere["clearing and the rest of a front" if "memset" in symbol else "moving memory"] += 1
    of = stages(program, counts)
    for address, count in counts.items():
        elsewhere[of[address]] += count
    elsewhere.pop(None, None)
    total = sum(elsewhere.values())
    print(f"{total} samples")
    for stage, count in elsewhere.most_common():
        print(f"{100 * count / total:5.1f} %  {stage}")


if __name__ == "__main__":
    main()
