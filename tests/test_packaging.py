"""What is needed to hand the project on: archives for a package index, the Dockerfile and the workflows."""

import os
import re
import shutil
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).resolve().parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]


def steps(path: Path) -> list[tuple[str, str]]:
    """The instructions of a Dockerfile, those over several lines in one."""
    text = re.sub(r"\\\n", " ", path.read_text(encoding="utf-8"))
    lines = [line for line in text.splitlines() if line and not line.startswith("#")]
    return [(word, rest) for word, _, rest in (line.partition(" ") for line in lines)]


def test_extras_that_messages_name_exist() -> None:
    named = {
        extra
        for path in (ROOT / "geoskill").rglob("*.py")
        for extra in re.findall(r'missing_extra\(.*?"(\w+)"\)', path.read_text(encoding="utf-8"))
    }
    assert {"datasets", "learned", "rerun", "ros2"} <= named <= set(PROJECT["optional-dependencies"])


def test_scripts_are_functions() -> None:
    for target in PROJECT["scripts"].values():
        module, _, function = target.partition(":")
        source = (ROOT / f"{module.replace('.', '/')}.py").read_text(encoding="utf-8")
        assert f"def {function}() -> None:" in source


def test_workflows_run_targets_of_make() -> None:
    targets = re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE)
    workflow = yaml.safe_load((ROOT / ".github" / "workflows" / "ci.yml").read_text(encoding="utf-8"))
    commands = [step["run"] for job in workflow["jobs"].values() for step in job["steps"] if "run" in step]
    made = [command.split()[1] for command in commands if command.startswith("make ")]
    assert set(made) >= {"lint", "test", "docs"}
    assert set(made) <= set(targets)


def test_dockerfile_copies_what_there_is() -> None:
    for word, rest in steps(ROOT / "Dockerfile"):
        if word == "COPY":
            assert all((ROOT / name).exists() for name in rest.split()[:-1]), rest


@pytest.mark.slow
def test_archives_for_a_package_index(tmp_path: Path) -> None:
    pytest.importorskip("build")
    pytest.importorskip("twine")
    run = {"cwd": ROOT, "check": True, "capture_output": True, "text": True}
    # Without isolation, which would ask the package index for hatchling.
    subprocess.run([sys.executable, "-m", "build", "--no-isolation", "--outdir", str(tmp_path)], **run)  # type: ignore[call-overload]
    archives = sorted(map(str, tmp_path.iterdir()))
    assert [Path(own).suffix for own in archives] == [".whl", ".gz"]
    checked = subprocess.run([sys.executable, "-m", "twine", "check", "--strict", *archives], **run)  # type: ignore[call-overload]
    assert checked.stdout.count("PASSED") == 2
    names = zipfile.ZipFile(archives[0]).namelist()
    assert {"geoskill/py.typed", "geoskill/conf/train.yaml", "geoskill/cli/doctor.py"} <= set(names)
    assert not [name for name in names if name.endswith((".png", ".jpg", ".mp4"))]


@pytest.mark.slow
def test_steps_of_the_dockerfile(tmp_path: Path) -> None:
    """Where no container engine is, in an empty folder: /opt/geoskill is in it, and system packages are left out."""
    if shutil.which("docker") or shutil.which("podman"):
        pytest.skip("a container engine is there; build the image with it")
    environment = {name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "VIRTUAL_ENV")}
    environment |= {"HOME": str(tmp_path), "XDG_CACHE_HOME": str(tmp_path / "cache"), "TORCH_INDEX": ""}
    here = str(tmp_path / "image")

    def inside(text: str) -> str:
        return text.replace("/opt/geoskill", here)

    for word, rest in steps(ROOT / "Dockerfile"):
        if word == "ENV":
            name, _, value = inside(rest).partition("=")
            environment[name] = value.replace("$PATH", environment["PATH"])
        elif word == "COPY":
            *sources, target = inside(rest).split()
            for source in sources:
                place = Path(target) / source if target.endswith("/") else Path(target)
                place.parent.mkdir(parents=True, exist_ok=True)
                copy = shutil.copytree if (ROOT / source).is_dir() else shutil.copy
                copy(ROOT / source, place)
        elif word == "RUN" and not rest.startswith("apt-get"):
            ended = subprocess.run(
                ["sh", "-ec", inside(rest)], cwd=tmp_path, env=environment, capture_output=True, text=True, check=False
            )
            assert ended.returncode == 0, f"{rest}\n{ended.stderr[-2000:]}"
        elif word == "CMD":
            command = yaml.safe_load(rest)
            ended = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
            assert ended.returncode == 0, ended.stdout + ended.stderr
            assert f"{here}/venv" in ended.stdout
