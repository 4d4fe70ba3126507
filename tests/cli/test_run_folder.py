"""Runs that start at the same time."""

import subprocess
import sys
from collections.abc import Sequence
from multiprocessing.pool import ThreadPool
from pathlib import Path

import pytest
from omegaconf import OmegaConf

from geoskill.cli.run_folder import claim_folder, register_new_folder
from geoskill.errors import InputError


def test_folder_that_is_there_gets_a_number(tmp_path: Path) -> None:
    claim = claim_folder.__wrapped__
    wanted = str(tmp_path / "train" / "12-00-00")
    assert [claim(wanted) for _ in range(3)] == [wanted, f"{wanted}-2", f"{wanted}-3"]
    assert all(path.is_dir() for path in (tmp_path / "train").iterdir())


def test_claims_of_many_at_once_differ(tmp_path: Path) -> None:
    with ThreadPool(8) as pool:
        claimed = pool.map(claim_folder.__wrapped__, [str(tmp_path / "run")] * 64)
    assert len(set(claimed)) == len(list(tmp_path.iterdir())) == 64


def test_one_process_has_one_folder_in_all_its_configurations(tmp_path: Path) -> None:
    register_new_folder()
    configurations = [OmegaConf.create({"dir": f"${{new_folder:{tmp_path}/run}}"}) for _ in range(2)]
    assert {config.dir for config in configurations} == {str(tmp_path / "run")}
    assert [path.name for path in tmp_path.iterdir()] == ["run"]


def test_folder_that_cannot_be_made_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    assert claim_folder.__wrapped__(str(tmp_path / "file")) == str(tmp_path / "file-2")
    with pytest.raises(InputError, match=r"file/run: cannot be made \(.*\); expected a folder for the run"):
        claim_folder.__wrapped__(str(tmp_path / "file" / "run"))


@pytest.mark.slow
def test_two_runs_in_the_same_second(
    environment: dict[str, str], skill: Path, demonstration_folder: Path, tmp_path: Path
) -> None:
    root = Path(__file__).resolve().parents[2]
    command = [sys.executable, str(root / "infer.py"), f"skill={skill}", f"video={demonstration_folder}", "threads=1"]
    runs = [
        subprocess.Popen(command, cwd=tmp_path, env=environment, stdout=subprocess.PIPE, text=True) for _ in range(3)
    ]
    folders = [run.communicate(timeout=120)[0].strip().splitlines()[-1] for run in runs]
    assert [run.returncode for run in runs] == [0] * 3
    assert len(set(folders)) == 3
    assert all((tmp_path / folder / "associations.jsonl").stat().st_size > 0 for folder in folders)


@pytest.mark.slow
def test_sweep_has_one_folder_with_a_folder_for_each_run(
    tiny: Sequence[str], tmp_path: Path, environment: dict[str, str]
) -> None:
    root = Path(__file__).resolve().parents[2]
    arguments = ["-m", *tiny, "seed=0,1", "trainer.max_epochs=1"]
    ended = subprocess.run(
        [sys.executable, str(root / "train.py"), *arguments],
        cwd=tmp_path, env=environment, capture_output=True, text=True, check=True,
    )  # fmt: skip
    (sweep,) = (tmp_path / "outputs" / "sweep").iterdir()
    assert ended.stdout.strip().splitlines()[-1] == str(sweep)
    assert {path.name for path in sweep.iterdir() if path.is_dir()} == {"0", "1"}
    assert [path.name for path in (tmp_path / "outputs").iterdir()] == ["sweep"]
