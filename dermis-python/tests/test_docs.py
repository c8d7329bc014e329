"""The Python examples of the documentation run, page by page."""

import importlib.util
import json
import re
import subprocess
import sys
from pathlib import Path

import dermis
import dermis.commands
import pytest

ROOT = Path(__file__).parents[2]
PAGES = [
    "README.md",
    "docs/python.md",
    "docs/scale-out.md",
    "docs/from-pyeit-and-eidors.md",
    "docs/robot.md",
    "dermis-python/README.md",
]
BLOCK = re.compile(r"(?:<!-- needs: (?P<needs>\w+) -->\n)?```python\n(?P<code>.*?)```", re.DOTALL)


@pytest.mark.parametrize("page", PAGES)
def test_examples_run(page, tmp_path, monkeypatch):
    text = (ROOT / page).read_text()
    blocks = list(BLOCK.finditer(text))
    assert blocks, f"{page} has no example"
    monkeypatch.chdir(tmp_path)
    if "arm.toml" in text:
        dermis.commands.new("robot", output="arm.toml")
    names = {}
    for block in blocks:
        needs = block["needs"]
        if needs and importlib.util.find_spec(needs) is None:
            continue
        line = text[: block.start("code")].count("\n")
        exec(compile("\n" * line + block["code"], page, "exec"), names)


@pytest.mark.parametrize("path", sorted((ROOT / "examples" / "notebooks").glob("*.ipynb")), ids=lambda path: path.stem)
def test_the_code_of_a_notebook_runs(path, tmp_path):
    cells = json.loads(path.read_text())["cells"]
    code = "\n".join("".join(cell["source"]) for cell in cells if cell["cell_type"] == "code")
    for module in ("mujoco", "torch"):
        if f"dermis.{module}" in code:
            pytest.importorskip(module)
    subprocess.run([sys.executable, "-c", code], cwd=tmp_path, check=True, timeout=600)


def test_the_readme_s_script_is_short():
    block = BLOCK.search((ROOT / "README.md").read_text())
    lines = [line for line in block["code"].splitlines() if line.strip()]
    assert len(lines) <= 10
