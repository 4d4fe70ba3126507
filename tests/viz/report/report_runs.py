"""A run folder that is written by hand, for the tests of the page about it."""

import json
import math
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import yaml

from geoskill.viz.video_writer import VideoWriter

FRAMES = 30
RATE = 10
HOSTILE = "</script><script>window.hacked = 1</script><img src=x onerror='window.hacked = 2'>&{{ 7 * 7 }}.mp4"


def line_of(frame: int) -> dict[str, Any]:
    """A point that comes closer by 10 px a frame; another is selected in frame 10, and the gate is closed for two."""
    left = 10.0 * (FRAMES - 1 - frame)
    return {
        "frame": frame,
        "time_s": frame / RATE,
        "kernel": "p2p",
        "descriptor": "sift",
        "rank": 1,
        "confidence": 0.5 + frame / 100,
        "nodes": [],
        "error": [0.6 * left, -0.8 * left],
        "error_std": [0.7, 0.7],
        "goal_error": [0.6 * left, -0.8 * left] if frame >= 5 else None,
        "state": "unsure" if frame in (10, 11) else "at goal" if frame >= 28 else "approaching",
        "switched": frame == 10,
        "error_available": [frame not in (10, 11)] * 2,
    }


def write_run(folder: Path, source: str = "demo.mp4") -> Path:
    """Write what ``infer.py`` writes, but with few words."""
    (folder / "definition").mkdir(parents=True)
    (folder / ".hydra").mkdir()
    picture = np.full((40, 40, 3), 90, np.uint8)
    nodes = []
    for role in ("moving", "resting"):
        path = f"definition/p2p_sift-1-{role}.png"
        cv2.imwrite(str(folder / path), picture)
        nodes.append({"type": "point", "xy": [1.0, 2.0], "role": role, "picture": path})
    for name in ("first", "last"):
        cv2.imwrite(str(folder / "definition" / f"{name}.jpg"), picture)
    member = {
        "sentence": "One point comes onto another: a moved point and a resting point.",
        "kernel": "p2p",
        "meaning": "one point comes onto another",
        "descriptor": "sift",
        "error_rows": ["p2p_sift.x", "p2p_sift.y"],
        "unit": "px",
        "goal_tolerance": 3.0,
        "mean_confidence": 0.65,
        "frames": FRAMES,
        "frames_with_association": FRAMES,
        "error_norm": {"at_start": 290.0, "at_end": 0.0},
        "associations": [
            {"number": 1, "share": 1.0, "mean_confidence": 0.65, "seen_best_in_frame": 12, "nodes": nodes}
        ],
    }
    phases = [{"members": ["p2p_sift"], "settles_at": 0.8, "until": {"p2p_sift": 6.0}}]
    task = "A thing is moved until one point comes onto another."
    definition = {"source": source, "task": task, "phases": phases, "members": {"p2p_sift": member}}
    (folder / "skill.yaml").write_text(yaml.safe_dump(definition))
    lines = [line_of(frame) for frame in range(FRAMES)]
    text = "".join(f"{json.dumps(line)}\n{json.dumps({**line, 'rank': 2})}\n" for line in lines)
    (folder / "associations.jsonl").write_text(text)
    bins = [[0, math.nan, math.nan], [10, 0.55, 0.5], [20, 0.7, 0.75]]
    metrics = {"source": source, "found": True, "frames": FRAMES, "members": {"p2p_sift": {"reliability": bins}}}
    (folder / "metrics.json").write_text(json.dumps(metrics))
    table = "".join(f"{step},{step / 100},{0.1 / (step + 1)}\n" for step in range(100))
    (folder / "metrics.csv").write_text("step,p2p_sift/objective,p2p_sift/rsw\n" + table)
    (folder / ".hydra" / "overrides.yaml").write_text(yaml.safe_dump([f"video={source}"]))
    (folder / ".hydra" / "config.yaml").write_text("inference: {abstain: 0.2}\n")
    with VideoWriter(folder / "overlay.mp4", RATE) as video:
        for frame in range(FRAMES):
            video.write(np.full((48, 64, 3), 8 * frame, np.uint8), frame / RATE)
    return folder
