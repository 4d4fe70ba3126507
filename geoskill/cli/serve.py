"""``python serve.py``: what a skill selects and commands, live, for programs on the same computer or elsewhere."""

import json
import sys
from collections.abc import Generator, Iterator, Sequence
from contextlib import closing, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, final

from geoskill.cli.command import Run, run_command
from geoskill.cli.progress import LINES
from geoskill.cli.schemas import ServeCommandConfig
from geoskill.errors import InputError

if TYPE_CHECKING:
    from geoskill.exports.live_server import LiveServer
    from geoskill.exports.record import NeutralRecord
    from geoskill.exports.session import LiveSession, View, Watcher
    from geoskill.io.frames import FrameSource
    from geoskill.skill.association import InferenceResult
    from geoskill.skill.skill import Skill


def main() -> None:
    """Run ``serve.py`` or ``geoskill-serve``."""
    run_command("serve", ServeCommandConfig, serve)


def serve(config: ServeCommandConfig, run: Run) -> None:
    """Publish a message for every frame and answer requests, until a client, Ctrl-C or the end of the video stops it.

    Raises:
        InputError: for an unusable skill, video or address.
    """
    from geoskill.cli.inputs import load_skill, use_threads
    from geoskill.cli.summary import print_summary
    from geoskill.exports.live_server import LiveServer, address_of, is_loopback
    from geoskill.exports.messages import Kind, Message, Request
    from geoskill.exports.session import LiveSession
    from geoskill.io.choice import Choice
    from geoskill.io.sources import open_frames
    from geoskill.training.quiet import quiet_libraries

    with quiet_libraries():
        threads = use_threads(config.threads)
        host, port = address_of(config.bind)
        skill = load_skill(config.skill, config.device, config.precision, None, config.definition)
        choice = Choice(config.episode, config.camera, config.topic)
        source = None if config.video is None else open_frames(str(config.video), config.frame_rate, choice)
        _check(config, skill)
        _warm_up(skill)
        with live_log(run.folder, skill, drives=config.drive) as write:
            session = LiveSession(lambda: _watcher(config, skill), write, None if source is None else source.name)

            def answer(request: Request) -> Message:
                reply = session.answer(request)
                if request.kind is Kind.FRAME:
                    server.publish(reply)
                return reply

            with LiveServer(config.bind, answer) as server:
                if not is_loopback(config.bind):
                    print(
                        f"warning: {config.bind}: whoever can reach it can send pictures and stop it", file=sys.stderr
                    )
                requests = f"requests at tcp://{host}:{port + 1}"
                LINES.stage = "serving"
                LINES.say(f"serving: messages at {config.bind}, {requests}; Ctrl-C ends it")
                try:
                    ended = _run(config, skill, session, server, source, threads)
                except Exception as error:
                    server.publish({"end": " ".join(str(error).split())})
                    raise
                server.publish({"end": ended})
    latency = session.latency_s
    timed = "" if latency is None else f", {1000 * latency:.0f} ms after each was taken"
    print_summary([f"served {session.frames} frames{timed}; {ended}"], run.folder, [])


def _check(config: ServeCommandConfig, skill: "Skill") -> None:
    """Refuse settings that do not go together."""
    if config.cameras > 1 and not config.drive:
        raise InputError(f"cameras={config.cameras}: without drive=true one picture is looked at; expected cameras=1")
    if config.cameras > 1 and config.video is not None:
        raise InputError(
            f"cameras={config.cameras}: a video is of one camera; expected pictures by requests, no video="
        )
    if config.drive or config.video is None:
        skill.require_depth("the live interface")


def _warm_up(skill: "Skill") -> None:
    """Look at a picture of noise, since the first one takes seconds."""
    import numpy as np

    if not any(member.kernel.in_space for member in skill.members.values()):
        width, height = skill.provenance.image_size
        skill.infer(np.random.default_rng(0).integers(0, 256, (height, width, 3), np.uint8))


def _watcher(config: ServeCommandConfig, skill: "Skill") -> "Watcher":
    from geoskill.cli.inputs import selection
    from geoskill.exports.session import Driver, Observer
    from geoskill.skill.servoing import Servo

    if not config.drive:
        return Observer(skill, selection(skill, config.inference))
    servo = Servo(skill, dof=config.dof, cameras=config.cameras, config=config.servo, selection=config.inference.filter)
    return Driver(servo, config.servo.rate_hz)


def _run(
    config: ServeCommandConfig,
    skill: "Skill",
    session: "LiveSession",
    server: "LiveServer",
    source: "FrameSource | None",
    threads: int,
) -> str:
    """Serve until the end, and return why it ended."""
    try:
        if source is None:
            while not server.wait(1.0):
                pass
            return "stopped by a client"
        with closing(_views(skill, source, threads, real_time=config.realtime)) as views:
            for view in views:
                if server.wait(0.0):
                    return "stopped by a client"
                server.publish(session.take(view))
        return "no more frames"
    except KeyboardInterrupt:
        return "stopped by Ctrl-C"


def _views(skill: "Skill", source: "FrameSource", threads: int, *, real_time: bool) -> "Generator[View, None, None]":
    """Yield the frames of a video with their features, of which those of the next frame are extracted meanwhile."""
    import time

    from geoskill.exports.session import View
    from geoskill.io.latest import Taken, latest_frames
    from geoskill.io.prefetch import prefetch_map
    from geoskill.io.sources import is_live

    def seen(taken: Taken) -> View:
        frame = taken.frame
        features = skill.extract(frame.image, frame.depth)
        return View([frame.image], frame.index, frame.time_s, taken.taken_at, features, frame.depth)

    live = is_live(source)
    if live or real_time:
        frames: Iterator[Taken] = latest_frames(source, real_time=not live)
    else:
        frames = (Taken(frame, time.time()) for frame in source)
    yield from prefetch_map(seen, frames, threads=threads, max_prefetch=1)


@final
class LiveLog:
    """Lines of ``associations.jsonl`` and ``servo.jsonl``, written as they come.

    Args:
        skill: that selects.
        associations: file.
        steps: file, or None where nothing is commanded.
    """

    def __init__(self, skill: "Skill", associations: Any, steps: Any) -> None:
        self._skill, self._associations, self._steps = skill, associations, steps

    def write(self, view: "View", results: "Sequence[InferenceResult]", record: "NeutralRecord") -> None:
        """Write the lines of a view; of several cameras, the associations of the first."""
        from geoskill.cli.reporting import association_lines
        from geoskill.exports.exporter import finite
        from geoskill.io.frames import Frame

        frame = Frame(view.frame, view.time_s, view.pictures[0])
        for line in association_lines(frame, results[0], self._skill.members):
            if line["rank"] <= self._skill.top_k:
                self._associations.write(json.dumps(line) + "\n")
        if self._steps is not None:
            self._steps.write(json.dumps(finite(record)) + "\n")


@contextmanager
def live_log(folder: Path, skill: "Skill", *, drives: bool) -> "Iterator[Any]":
    """Open the files of a live run, each line complete in the file once it is written, and give what writes them."""
    with (folder / "associations.jsonl").open("w", encoding="utf-8", buffering=1) as associations:
        if not drives:
            yield LiveLog(skill, associations, None).write
            return
        with (folder / "servo.jsonl").open("w", encoding="utf-8", buffering=1) as steps:
            yield LiveLog(skill, associations, steps).write


if __name__ == "__main__":
    main()
