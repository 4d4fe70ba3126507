"""The page about a run that a command writes last."""

import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from geoskill.cli.command import Run, program
from geoskill.skill.skill import Skill

_LABELED: Final = ("video=DIR", "regions=labels.json")


def report_training(run: Run, skill: Skill, task: str | None) -> None:
    """Write the page about a training.

    Args:
        run: of the command.
        skill: that was learned.
        task: simulated one that was demonstrated; None for a video.
    """
    folder = str(run.folder)
    evaluation = (f"task={task}", "scenario=robot") if task else _LABELED
    _write(
        "train",
        run,
        skill,
        [
            ("Select these features in another video:", _line("infer", [f"skill={folder}", "video=robot.mp4"])),
            ("Score them:", _line("evaluate", [f"skill={folder}", *evaluation])),
            (
                "Leave out a member, change a tolerance or pin an association in a copy of skill.yaml:",
                _line("infer", [f"skill={folder}", "definition=edited.yaml", "video=robot.mp4"]),
            ),
            (
                "Learn from another demonstration, starting from these weights:",
                _line("train", ["task=video", "task.path=other.mp4", f"init_from={folder}"]),
            ),
        ],
    )


def report_inference(run: Run, skill: Skill, reference: str) -> None:
    """Write the page about an inference."""
    _write(
        "infer",
        run,
        skill,
        [
            ("Again:", shlex.join([*program(), *run.overrides])),
            ("Score the skill on labeled frames:", _line("evaluate", [f"skill={reference}", *_LABELED])),
        ],
    )


def report_evaluation(run: Run, skill: Skill, reference: str, lines: Sequence[Mapping[str, Any]]) -> None:
    """Write the page about an evaluation; ``lines`` are those of ``associations.jsonl``."""
    folder = Path(reference).expanduser()
    _write(
        "evaluate",
        run,
        skill,
        [
            ("Again:", shlex.join([*program(), *run.overrides])),
            ("See what it selects in a video:", _line("infer", [f"skill={reference}", "video=robot.mp4"])),
        ],
        definition_folder=folder if folder.is_dir() else folder.parent,
        lines=lines,
    )


def report_study(run: Run, folder: Path) -> None:
    """Write the page about a study, whose tables are in ``folder``."""
    from geoskill.viz.report.page import About, write_report

    again = shlex.join([*program(), *run.overrides, f"hydra.run.dir={run.folder}"])
    write_report(folder, About("reproduce", [("What is not complete is done, and what is stays:", again)]))


def _write(command: str, run: Run, skill: Skill, next_commands: Sequence[tuple[str, str]], **further: Any) -> None:
    # What the page needs is imported by who wants one: that takes a second.
    from geoskill.viz.report.page import About, write_report

    write_report(run.folder, About(command, next_commands, skill.provenance, **further))


def _line(command: str, arguments: Sequence[str]) -> str:
    """Return the line that starts a command as this one was started."""
    started = program()[-1]
    script = started.endswith(".py")
    return shlex.join([*(["python", f"{command}.py"] if script else [f"geoskill-{command}"]), *arguments])
