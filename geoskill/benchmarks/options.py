"""The choices of the configuration that the benchmarks go through by name: kernels and networks."""

from pathlib import Path
from typing import Literal

from omegaconf import DictConfig, OmegaConf

from geoskill.cli.command import configuration_folder

Group = Literal["kernel", "model"]


def option_names(group: Group) -> list[str]:
    """Return the names of all options of a group, in alphabetical order."""
    return sorted(path.stem for path in (Path(configuration_folder()) / group).glob("*.yaml"))


def load_option(group: Group, name: str) -> DictConfig:
    """Return the configuration of one option, as its file has it."""
    option = OmegaConf.load(Path(configuration_folder()) / group / f"{name}.yaml")
    assert isinstance(option, DictConfig)
    return option
