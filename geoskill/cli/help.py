"""What ``--help`` prints: what a command does, three examples, and each key with its meaning."""

import functools
import shutil
import textwrap
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

from geoskill.cli.schemas import SimulatedTaskConfig, VideoTaskConfig, WandbConfig
from geoskill.config import MODELS, Config
from geoskill.plugins import EXTRACTORS, KERNELS, SCORERS, TASKS
from geoskill.schema import as_written, flatten

EXAMPLES: Mapping[str, Sequence[tuple[str, str]]] = {
    "train": (
        ("", "learn from a simulated demonstration"),
        ("task=video task.path=demo.mp4", "learn from a video of yours, or a folder of images"),
        ("kernel=[p2p,l2l] task=video task.path=demo.mp4 task.start=2.5 task.end=9", "two kernels; a part of it"),
    ),
    "infer": (
        ("skill=RUN video=robot.mp4", "select associations in a video"),
        ("skill=RUN video=0", "in the pictures of a camera, until Ctrl-C"),
        ("skill=RUN video=DATASET episode=3 camera=observation.images.front", "in a LeRobot data set"),
    ),
    "evaluate": (
        ("skill=RUN video=DIR regions=labels.json", "score a skill on labeled frames"),
        ("skill=RUN video=DIR regions=LABELS regions.object=mug regions.target=tray", "with labels of LabelMe or COCO"),
        ("skill=RUN task=sorting scenario=occlusion", "on a simulated recording"),
    ),
    "servo": (
        ("", "points with noise as the plant"),
        ("controller=broyden faults=all trials=50", "with every fault of a selection"),
        ("plant=scene skill=RUN task=insertion trials=20", "rendered pictures, and what a skill selects in them"),
    ),
    "serve": (
        ("skill=RUN video=0", "publish what is selected in the pictures of a camera"),
        ("skill=RUN video=0 drive=true", "and how a robot has to move"),
        ("skill=RUN drive=true", "reply to the pictures of a client"),
    ),
    "reproduce": (
        ("artifact=table1", "the paper's table I, in simulation"),
        ("artifact=blocks artifact.data=DIR", "the results on real demonstrations"),
        ("artifact=ablations quick=true", "see that it runs, in minutes"),
    ),
}
# Choices that are files alone, by the group that a command has.
FILES = ("scenario", "trainer", "experiment", "artifact")
GROUPS = ("kernel", "descriptor", "model", "task", "logger", "artifact")
MIN_WIDTH = 60


def help_text(command: str, schema: type[Config], program: Sequence[str], configuration: Path) -> str:
    """Return the help of a command.

    Args:
        command: its name.
        schema: its configuration.
        program: how it is started.
        configuration: folder of the YAML files.
    """
    width = max(MIN_WIDTH, shutil.get_terminal_size((120, 40)).columns)
    started = " ".join(["python" if own.endswith(("python", "python3")) else own for own in map(_name, program)])
    does = " ".join((schema.__doc__ or "").split()).partition(": ")[2]
    lines = [f"{started} [KEY=VALUE ...]", f"  {does[:1].upper()}{does[1:]}", ""]
    if command in EXAMPLES:
        lines += ["Examples:"]
        lines += [f"  {started} {given}".rstrip() + f"\n      {meaning}" for given, meaning in EXAMPLES[command]]
        lines += [""]
    choices = dict(_choices(schema, configuration))
    if choices:
        lines += ["Choices (GROUP=NAME):"]
        for name, chosen in choices.items():
            names = textwrap.fill(", ".join(chosen), width, initial_indent=" " * 14, subsequent_indent=" " * 14)
            lines += [f"  {name + '=':<12}{names[14:]}"]
        lines += [""]
    lines += ["Keys, with their defaults:", *_keys(schema, "", width)]
    for title, own, prefix in _of_choices(choices):
        lines += ["", f"With {title}:", *_keys(own, prefix, width)]
    lines += [
        "",
        "-m KEY=A,B runs every value; --cfg job shows the configuration; debug=true shows the traceback of an error.",
        "geoskill-doctor checks the installation.",
    ]
    return "\n".join(lines)


def _name(part: str) -> str:
    return Path(part).name if "/" in part else part


def _choices(schema: type[Config], configuration: Path) -> Iterator[tuple[str, list[str]]]:
    """Yield the groups of a command with what can be chosen."""
    registries = {"kernel": KERNELS, "descriptor": EXTRACTORS, "model": SCORERS, "task": TASKS}
    own = {each.name for each in fields(schema)}  # type: ignore[arg-type]
    for group in (*registries, *FILES, "logger"):
        if group not in own and not (group == "experiment" and "kernel" in own):
            continue
        names = {path.stem for path in (configuration / group).glob("*.yaml")}
        if group in registries:
            names |= set(registries[group].names())
        names |= {"task": {"video"} if "kernel" in own else set(), "logger": {"wandb"}}.get(group, set())
        names |= {"scenario": {"human"}, "trainer": {"cpu"}}.get(group, set())
        yield group, sorted(names)
    for name, part in _parts(schema):
        described = next(each for each in fields(part) if each.name == "name")  # type: ignore[arg-type]
        yield name, list(described.metadata["choices"])


def _parts(schema: type[Config]) -> Iterator[tuple[str, Config]]:
    """Yield the groups whose choices differ in the default of ``name`` alone."""
    defaults = schema()
    for each in fields(schema):  # type: ignore[arg-type]
        value = getattr(defaults, each.name)
        if each.name not in GROUPS and each.type is Any and isinstance(value, Config):
            yield each.name, value


def _of_choices(choices: Mapping[str, Sequence[str]]) -> Iterator[tuple[str, type[Config], str]]:
    """Yield what choices bring with them: the choice, its settings and what precedes their names."""
    if "model" in choices:
        yield from ((f"model={name}", model, "model.") for name, model in MODELS.items())
    if "video" in choices.get("task", ()):
        yield "task=video", VideoTaskConfig, "task."
    if "task" in choices:
        yield "a simulated task", SimulatedTaskConfig, "task."
    if "logger" in choices:
        yield "logger=wandb", WandbConfig, "logger.wandb."


def _keys(schema: type[Config], prefix: str, width: int) -> Iterator[str]:
    defaults = schema()
    groups = {*GROUPS, *(name for name, _ in _parts(schema))} if not prefix else {"name"}
    # Those that are in no group come first, such as the recording and the skill.
    for key, own, _ in sorted(flatten(schema), key=lambda entry: "." in entry[0]):
        if key in groups:
            continue
        default: Any = functools.reduce(getattr, key.split("."), defaults)
        yield _entry(f"{prefix}{key}={as_written(default)}", own.metadata["help"], width)
    for name, part in _parts(schema) if not prefix else ():
        yield from _keys(type(part), f"{name}.", width)


def _entry(key: str, meaning: str, width: int) -> str:
    """Return one line, or two where a key is long."""
    column = 44
    text = textwrap.shorten(meaning.replace("`", ""), max(MIN_WIDTH, width) - column - 1, placeholder=" …")
    return f"  {key:<{column - 3}} {text}" if len(key) < column - 2 else f"  {key}\n{'':{column}}{text}"
