"""The notebook runs, and is stored as it was written."""

import os
from pathlib import Path

import nbformat
import pytest
from nbclient import NotebookClient

ROOT = Path(__file__).resolve().parents[1]
NOTEBOOK = ROOT / "notebooks" / "quickstart.ipynb"


def test_it_is_short_and_stored_without_outputs() -> None:
    notebook = nbformat.read(NOTEBOOK, as_version=4)
    nbformat.validate(notebook)
    assert len(notebook.cells) < 10
    for cell in notebook.cells:
        assert not cell.get("outputs")
        assert cell.get("execution_count") is None


@pytest.fixture
def _environment(demonstration_folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("GEOSKILL_DEMONSTRATION", str(demonstration_folder))
    monkeypatch.setenv("GEOSKILL_RUN", str(tmp_path / "run"))
    monkeypatch.setenv(
        "GEOSKILL_OVERRIDES",
        "model=bilinear logger=none threads=1 features.min_side=0 trainer.max_epochs=1 trainer.limit_train_batches=3",
    )
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(filter(None, (str(ROOT), os.environ.get("PYTHONPATH")))))


@pytest.mark.slow
@pytest.mark.usefixtures("_environment")
@pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::ResourceWarning")  # of Jupyter's own libraries
def test_it_runs(tmp_path: Path) -> None:
    notebook = nbformat.read(NOTEBOOK, as_version=4)
    NotebookClient(notebook, timeout=300, resources={"metadata": {"path": str(NOTEBOOK.parent)}}).execute()
    outputs = [output for cell in notebook.cells for output in cell.get("outputs", [])]
    pictures = [output for output in outputs if "image/png" in output.get("data", {})]
    assert len(pictures) == 2  # the curves, and three frames in one figure
    # How a cell's output is cut into pieces depends on how busy the machine is.
    printed = "".join(output["text"] for output in outputs if output["output_type"] == "stream").splitlines()
    assert printed[0] == str(tmp_path / "run")
    lines = printed[-2:]
    assert [line.split(":")[0] for line in lines] == ["frame 0", "frame 10"]
    assert all("error [" in line for line in lines)
