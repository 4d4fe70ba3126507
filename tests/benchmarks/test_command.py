"""The commands ``python -m geoskill.benchmarks.select_out`` and ``.training``, on small cases and on bad input."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

SMALL = ("models=[default,bilinear]", "kernels=[p2p]", "repeats=2", "threads=1")


def run(job: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", f"geoskill.benchmarks.{job}", *arguments], capture_output=True, text=True, check=False
    )


@pytest.mark.slow
@pytest.mark.parametrize("job", ["select_out", "training"])
def test_benchmark_writes_table_json_and_plot(job: str, tmp_path: Path) -> None:
    process = run(job, *SMALL, "features=[8,4]", f"hydra.run.dir={tmp_path}")
    assert (process.returncode, process.stderr) == (0, "")
    assert "| p2p | bilinear | float32 | 8 | 28 |" in process.stdout
    content = json.loads((tmp_path / f"{job}.json").read_text())
    assert [(row["model"], row["precision"], row["features"], row["instances"]) for row in content["rows"]] == [
        ("default", "float32", 4, 6),
        ("default", "float32", 8, 28),
        ("default", "bfloat16", 4, 6),
        ("default", "bfloat16", 8, 28),
        ("bilinear", "float32", 4, 6),
        ("bilinear", "float32", 8, 28),
    ]
    assert content["machine"]["threads"] == 1
    for row in content["rows"]:
        variants = {"dense", "cascade", "pyg", "matmul_bound"} & row.keys()
        assert variants == ({"dense", "pyg", "matmul_bound"} if row["model"] == "default" else {"dense"})
        for variant in variants:
            assert len(row[variant]["seconds"]) == 2
            assert row[variant]["median_s"] == pytest.approx(sum(row[variant]["seconds"]) / 2)
            assert (row[variant]["peak_mb"] is None) == (variant == "matmul_bound")
    assert (tmp_path / f"{job}.md").read_text().count("\n") == 8
    assert (tmp_path / f"{job}.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.slow
def test_unsupported_precision_falls_back_to_first_available(tmp_path: Path) -> None:
    arguments = (
        "models=[bilinear]",
        "kernels=[p2p]",
        "repeats=1",
        "threads=1",
        "features=[4]",
        "precisions=[bfloat16]",
    )
    assert run("select_out", *arguments, f"hydra.run.dir={tmp_path}").returncode == 0
    rows = json.loads((tmp_path / "select_out.json").read_text())["rows"]
    assert [row["precision"] for row in rows] == ["float32"]


@pytest.mark.slow
def test_limit_s_leaves_out_slow_cases(tmp_path: Path) -> None:
    process = run("select_out", *SMALL, "features=[8,16]", "limit_s=1e-9", f"hydra.run.dir={tmp_path}")
    assert process.returncode == 0
    rows = json.loads((tmp_path / "select_out.json").read_text())["rows"]
    assert [row["features"] for row in rows] == [8, 8, 8]


@pytest.mark.slow
def test_cascade_is_measured_only_above_its_number_of_instances(tmp_path: Path) -> None:
    arguments = (
        "models=[default]",
        "kernels=[p2p]",
        "repeats=1",
        "threads=1",
        "features=[45,64]",
        "precisions=[float32]",
    )
    process = run("select_out", *arguments, f"hydra.run.dir={tmp_path}")
    assert (process.returncode, process.stderr) == (0, "")
    few, many = json.loads((tmp_path / "select_out.json").read_text())["rows"]
    assert (few["instances"], many["instances"]) == (990, 2016)
    assert "cascade" not in few
    assert many["cascade"]["peak_mb"] < many["dense"]["peak_mb"]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("argument", "message"),
    [
        ("kernels=[p2p,p2q]", "kernel=p2q: no such kernel; expected one of "),
        ("models=[large]", "models=large: expected some of default, paper, bilinear, prototypes"),
        ("precisions=[]", "precisions=[]: expected some of float32, bfloat16"),
        ("precisions=[half]", "precisions=half: expected some of float32, bfloat16"),
        ("features=[1]", "features=1: expected whole numbers of at least 2"),
        ("repeats=0", "repeats=0: expected a whole number of at least 1"),
        ("threads=0", "threads=0: expected a whole number of at least 1"),
        ("limit_s=-1", "limit_s=-1: expected a number above 0"),
        ("device=tpu", "device=tpu: expected cpu or cuda"),
        ("feature=[8]", "'feature': there is no such key; expected features"),
    ],
)
def test_select_out_rejects_bad_input(argument: str, message: str, tmp_path: Path) -> None:
    process = run("select_out", argument, f"hydra.run.dir={tmp_path}")
    assert process.returncode == 2
    assert process.stderr.startswith(f"error: {message}")
    assert process.stderr.count("\n") == 1
