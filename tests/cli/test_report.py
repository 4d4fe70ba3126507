"""``report.html`` of the commands."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from tests.cli.test_evaluate import write_regions

Command = Callable[..., Any]


@pytest.mark.slow
def test_infer_and_evaluate_write_a_page(
    command: Command, trained: Any, demonstration_folder: Path, tmp_path: Path
) -> None:
    source = [f"skill={trained.folder}", f"video={demonstration_folder}", "report=true"]
    regions = write_regions(tmp_path / "regions.json", True)
    for name, further in (("infer", []), ("evaluate", [f"regions={regions}"])):
        run = tmp_path / name
        ended = command(name, *source, *further, f"hydra.run.dir={run}")
        assert (ended.status, ended.stderr) == (0, "")
        page = (run / "report.html").read_text(encoding="utf-8")
        assert f"geoskill {name}" in page
        assert "Nothing was learned from the demonstration." in page  # of the skill's own definition
        assert 'id="slider" min="0" max="19"' in page
        assert f"skill={trained.folder}" in page


def test_page_can_be_switched_off(trained: Any) -> None:
    assert not (trained.folder / "report.html").exists()
    assert (trained.folder / "definition" / "first.jpg").is_file()
