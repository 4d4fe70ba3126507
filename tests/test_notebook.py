"""The notebook: stored with its pictures, and it runs with nothing but the repository."""

import base64
import os
import shutil
from pathlib import Path
from typing import Any

import cv2
import nbformat
import numpy as np
import pytest
from nbclient import NotebookClient

ROOT = Path(__file__).resolve().parents[1]
NOTEBOOK = ROOT / "notebooks" / "quickstart.ipynb"
PICTURES = 3
"""Curves, three frames with the selected association, and the control error over time."""


def outputs_of(notebook: Any) -> list[Any]:
    return [output for cell in notebook.cells for output in cell.get("outputs", [])]


def pictures_of(notebook: Any) -> list[np.ndarray]:
    encoded = [
        output["data"]["image/jpeg"] for output in outputs_of(notebook) if "image/jpeg" in output.get("data", {})
    ]
    decoded = [cv2.imdecode(np.frombuffer(base64.b64decode(text), np.uint8), cv2.IMREAD_COLOR) for text in encoded]
    return [np.asarray(picture) for picture in decoded]


def printed_by(notebook: Any) -> str:
    return "".join(output["text"] for output in outputs_of(notebook) if output["output_type"] == "stream")


def test_notebook_is_stored_with_its_pictures() -> None:
    notebook = nbformat.read(NOTEBOOK, as_version=4)
    nbformat.validate(notebook)
    assert NOTEBOOK.stat().st_size < 1e6
    code = [cell for cell in notebook.cells if cell.cell_type == "code"]
    assert [cell.execution_count for cell in code] == list(range(1, len(code) + 1))
    assert {output["output_type"] for output in outputs_of(notebook)} <= {"display_data", "stream"}
    assert all(output.get("name", "stdout") == "stdout" for output in outputs_of(notebook))
    pictures = pictures_of(notebook)
    assert len(pictures) == PICTURES
    assert all(picture.std() > 10 for picture in pictures)
    text = printed_by(notebook)
    assert "Skill(p2p_sift; learned from demonstration 1 at 640x480" in text
    assert str(ROOT) not in NOTEBOOK.read_text(encoding="utf-8")


def test_notebook_explains_every_step() -> None:
    kinds = [cell.cell_type for cell in nbformat.read(NOTEBOOK, as_version=4).cells]
    assert kinds[0] == "markdown"
    assert all(kinds[number - 1] == "markdown" for number, kind in enumerate(kinds) if kind == "code")


@pytest.mark.slow
@pytest.mark.usefixtures("opengl")
@pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::ResourceWarning")  # of Jupyter's own libraries
def test_notebook_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("notebooks", "outputs"):
        (tmp_path / name).mkdir()
    shutil.copy(NOTEBOOK, tmp_path / "notebooks")
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(filter(None, (str(ROOT), os.environ.get("PYTHONPATH")))))
    notebook = nbformat.read(tmp_path / "notebooks" / NOTEBOOK.name, as_version=4)
    for cell in notebook.cells:
        cell.pop("outputs", None) if cell.cell_type == "markdown" else cell.update(outputs=[], execution_count=None)
    NotebookClient(notebook, timeout=900, resources={"metadata": {"path": str(tmp_path / "notebooks")}}).execute()
    assert len(pictures_of(notebook)) == PICTURES
    lines = printed_by(notebook).splitlines()
    errors = next(line for line in lines if line.startswith("from ")).replace(" px", "").split()
    assert float(errors[1]) > 2 * float(errors[3].rstrip(";"))
    assert (tmp_path / "outputs" / "quickstart.ckpt").is_file()
    assert not any(output.get("name") == "stderr" for output in outputs_of(notebook))
