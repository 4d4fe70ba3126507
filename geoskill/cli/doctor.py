"""``geoskill-doctor``: whether everything that geoskill needs is here, and what to do about what is not."""

import importlib.util
import os
import platform
import shutil
import sys
import tempfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import final

from geoskill.errors import InputError

NEEDED = ("torch", "lightning", "torch-geometric", "opencv-python-headless", "av", "mujoco", "hydra-core")
# Modules of the extras, by the names of these.
EXTRAS: Mapping[str, str] = {
    "datasets": "pyarrow",
    "ros2": "mcap_ros2",
    "learned": "kornia",
    "rerun": "rerun",
    "live": "zmq",
}
DECODERS, ENCODERS = ("h264", "hevc", "vp9", "av1", "mpeg4", "mjpeg"), ("libx264",)
FREE_GB = 2.0


@final
@dataclass(frozen=True)
class Finding:
    """One thing that was looked at.

    Attributes:
        what: it is.
        found: what there is.
        advice: what to do; None where all is well.
        needed: whether geoskill does not work without.
    """

    what: str
    found: str
    advice: str | None = None
    needed: bool = True

    def __str__(self) -> str:
        mark = "ok  " if self.advice is None else "MISS" if self.needed else "--  "
        line = f"{mark} {self.what:<12} {self.found}"
        return line if self.advice is None else f"{line}\n                  -> {self.advice}"


def main() -> None:
    """Run ``geoskill-doctor``; the exit status is 1 where something is missing that is needed."""
    if {"-h", "--help"} & set(sys.argv[1:]):
        print("geoskill-doctor\n  Print versions, devices, codecs and rendering, and what to do about what is missing.")
        return
    findings: list[Finding] = []
    for finding in examined():
        findings.append(finding)
        print(finding, flush=True)
    missing = [finding.what for finding in findings if finding.advice is not None and finding.needed]
    print(f"\nmissing: {', '.join(missing)}" if missing else "\nAll is there. Next: geoskill-train --help")
    sys.exit(1 if missing else 0)


def examined() -> Iterator[Finding]:
    """Yield what is here, one after the other: each takes a moment."""
    for examine in (_python, _packages, _devices, _codecs, _rendering, _folders, _extras):
        try:
            yield from examine()
        except Exception as error:  # a broken package is what this command looks for
            reason = " ".join(str(error).split()) or type(error).__name__
            what = examine.__name__.strip("_")
            yield Finding(what, f"failed: {reason}", "reinstall: pip install --force-reinstall -c constraints.txt -e .")


def _python() -> Iterator[Finding]:
    version = platform.python_version()
    advice = None if sys.version_info >= (3, 11) else "Python 3.11 or later is needed: python3.11 -m venv .venv"
    yield Finding("python", f"{version}, {sys.executable}", advice)
    inside = sys.prefix != sys.base_prefix or "CONDA_PREFIX" in os.environ
    advice = None if inside else "a virtual environment keeps packages apart: . .venv/bin/activate"
    yield Finding("environment", sys.prefix if inside else "none, the packages of the system", advice, needed=False)
    yield Finding("platform", platform.platform())


def _packages() -> Iterator[Finding]:
    for name in ("geoskill", *NEEDED):
        try:
            yield Finding("package", f"{name} {metadata.version(name)}")
        except metadata.PackageNotFoundError:
            advice = "pip install -c constraints.txt -e . (in the folder of the clone)"
            # A checkout that is on the path works, too.
            yield Finding("package", f"{name} is not installed", advice, needed=name != "geoskill")


def _devices() -> Iterator[Finding]:
    import torch

    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    yield Finding("processor", f"{cores} cores, {torch.get_num_threads()} threads of PyTorch")
    if torch.cuda.is_available():
        for number in range(torch.cuda.device_count()):
            memory_gb = torch.cuda.get_device_properties(number).total_memory / 1e9
            yield Finding(f"cuda:{number}", f"{torch.cuda.get_device_name(number)}, {memory_gb:.0f} GB")
        torch.ones(2, device="cuda").sum().item()
        return
    if torch.version.cuda is None:
        advice = "for an NVIDIA GPU: pip install torch (on Linux the default build has CUDA); not needed otherwise"
    else:
        advice = "PyTorch has CUDA but finds no GPU: does nvidia-smi show one? Not needed otherwise"
    yield Finding("GPU", f"none; PyTorch {torch.__version__}", advice, needed=False)


def _codecs() -> Iterator[Finding]:
    import av

    for what, names, mode in (("decoders", DECODERS, "r"), ("encoders", ENCODERS, "w")):
        missing = [name for name in names if not _has_codec(name, mode)]
        there = ", ".join(name for name in names if name not in missing) or "none"
        advice = f"without {', '.join(missing)}; pip install --force-reinstall av brings them" if missing else None
        yield Finding(what, f"{there} (PyAV {av.__version__})", advice, needed=mode == "w" or "h264" in missing)


def _has_codec(name: str, mode: str) -> bool:
    import av

    try:
        av.Codec(name, "r" if mode == "r" else "w")
    except ValueError:
        return False
    return True


def _rendering() -> Iterator[Finding]:
    import geoskill.simulation  # noqa: F401  # decides how MuJoCo renders, before it is imported

    asked = os.environ.get("MUJOCO_GL", "egl")
    try:
        import mujoco

        from geoskill.simulation.renderer import Renderer, add_camera

        spec = mujoco.MjSpec()
        add_camera(spec, 64, 48)
        Renderer(spec.compile(), 64, 48).close()
    except InputError as error:
        # Learning from videos does not render.
        yield Finding("rendering", f"does not work (MUJOCO_GL={asked})", str(error), needed=False)
    else:
        yield Finding("rendering", f"works (MUJOCO_GL={asked}, MuJoCo {mujoco.__version__})")


def _folders() -> Iterator[Finding]:
    from platformdirs import user_cache_path

    try:
        cache = user_cache_path("geoskill")
    except RuntimeError:  # of a user without a home folder
        yield Finding("cache", "none, for there is no home folder", "set XDG_CACHE_HOME to a folder", needed=False)
    else:
        there = next(folder for folder in (cache, *cache.parents) if folder.is_dir())
        advice = None if os.access(there, os.W_OK) else "set XDG_CACHE_HOME to a folder that can be written"
        yield Finding("cache", str(cache), advice, needed=False)
    for what, folder in (("work folder", Path.cwd()), ("temporary", Path(tempfile.gettempdir()))):
        free_gb = shutil.disk_usage(folder).free / 1e9
        advice = None
        if not os.access(folder, os.W_OK):
            advice = "cannot be written: start from another folder, or set TMPDIR"
        elif free_gb < FREE_GB:
            advice = f"less than {FREE_GB:.0f} GB is free; long videos need more"
        yield Finding(what, f"{folder}, {free_gb:.0f} GB free", advice, needed=not os.access(folder, os.W_OK))


def _extras() -> Iterator[Finding]:
    there = [name for name, module in EXTRAS.items() if importlib.util.find_spec(module) is not None]
    missing = [name for name in EXTRAS if name not in there]
    advice = f"on demand: pip install 'geoskill[{','.join(missing)}]'" if missing else None
    yield Finding("extras", ", ".join(there) or "none", advice, needed=False)


if __name__ == "__main__":
    main()
