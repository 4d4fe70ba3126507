"""Damaged files: each is read or refused in a line, within two gigabytes and a minute."""

import copy
import json
import random
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from geoskill.features.cache import _pack
from geoskill.features.sift import Sift
from tests.io.test_video import write_video

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="limits of memory are Linux's")

READER = Path(__file__).with_name("reader.py")
ROOT = Path(__file__).resolve().parents[2]
VALUES: tuple[Any, ...] = (None, True, -1, 0, 10**9, 2**300, 1.5, float("nan"), "x", "x" * 5000, [], [[]], {}, {"a": 1})


def damaged_bytes(content: bytes, chance: random.Random) -> bytes:
    """Flip, cut, repeat, insert or overwrite, once or several times."""
    changed = bytearray(content)
    for _ in range(chance.choice((1, 1, 2, 8))):
        if not changed:
            break
        place, length = chance.randrange(len(changed)), chance.choice((1, 2, 4, 8, 64))
        kind = chance.randrange(6)
        if kind == 0:
            changed[place] ^= 1 << chance.randrange(8)
        elif kind == 1:
            del changed[place:]
        elif kind == 2:
            del changed[place : place + length]
        elif kind == 3:
            changed[place:place] = changed[place : place + length]
        elif kind == 4:
            changed[place:place] = chance.randbytes(length)
        else:
            changed[place : place + length] = chance.choice((b"\x00", b"\xff", b"\x7f")) * length
    return bytes(changed)


def places(node: Any) -> Iterator[tuple[Any, Any]]:
    for key in list(node) if isinstance(node, dict) else range(len(node)):
        yield node, key
        if isinstance(node[key], dict | list):
            yield from places(node[key])


def change_a_place(contents: Any, chance: random.Random) -> Any:
    """Replace, remove or add a value somewhere."""
    changed = copy.deepcopy(contents)
    container, key = chance.choice(list(places(changed)))
    kind = chance.randrange(4)
    if kind == 0 and isinstance(container, dict):
        del container[key]
    elif kind == 1 and isinstance(container, dict):
        container[chance.choice(("_target_", "", "a.b", "x" * 3000))] = chance.choice(VALUES)
    elif isinstance(container[key], torch.Tensor):
        container[key] = chance.choice((*VALUES, *damaged_tensors(container[key])))
    else:
        container[key] = chance.choice(VALUES)
    return changed


def damaged_tensors(tensor: torch.Tensor) -> Iterator[torch.Tensor]:
    yield torch.full_like(tensor, torch.iinfo(torch.int64).max if tensor.dtype == torch.int64 else float("nan"))
    yield torch.zeros(1).expand(10**9)
    yield tensor.reshape(-1)[:1]
    yield tensor.to(torch.float64)
    yield tensor.unsqueeze(0).repeat(3, *[1] * tensor.ndim)
    yield torch.full_like(tensor, 3) if tensor.dtype == torch.int64 else tensor * 1e30


def check(kind: str, skill: Path, files: list[Path]) -> None:
    command = [sys.executable, str(READER), kind, str(skill), *map(str, files)]
    ended = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    lines = [json.loads(line) for line in ended.stdout.splitlines()]
    last = lines[-1]["name"] if lines else "none"
    assert ended.returncode == 0, f"ended with {ended.returncode} after {last}: {ended.stderr[-2000:]}"
    assert [line["name"] for line in lines] == [str(file) for file in files]
    assert [line for line in lines if line["ended"] not in ("read", "refused")] == []
    assert [line for line in lines if line["mb"] > 2000 or line["seconds"] > 60] == []
    assert {"read", "refused"} >= {line["ended"] for line in lines}


def test_checkpoints_with_damaged_bytes(small_skill: Path, rounds: int, tmp_path: Path) -> None:
    chance, content = random.Random(1), small_skill.read_bytes()
    files = [tmp_path / f"{number}.ckpt" for number in range(rounds)]
    for file in files:
        file.write_bytes(damaged_bytes(content, chance))
    check("checkpoint", small_skill, files)


def test_checkpoints_with_other_values(small_skill: Path, rounds: int, tmp_path: Path) -> None:
    chance, contents = random.Random(2), torch.load(small_skill, weights_only=True)
    files = [tmp_path / f"{number}.ckpt" for number in range(rounds)]
    for file in files:
        torch.save(change_a_place(contents, chance), file)
    check("checkpoint", small_skill, files)


def test_regions(small_skill: Path, rounds: int, tmp_path: Path) -> None:
    square = [[10, 10], [50.5, 10], [50, 60], [10, 60]]
    contents = {
        "sequence": "tiles",
        "image_size": [160, 120],
        "frames": {str(number): {"object": square, "target": square[:3], "hand": []} for number in (0, 7, 19)},
    }
    chance, files = random.Random(3), [tmp_path / f"{number}.json" for number in range(rounds)]
    for number, file in enumerate(files):
        text = json.dumps(contents if number % 2 else change_a_place(contents, chance)).encode()
        file.write_bytes(damaged_bytes(text, chance) if number % 2 else text)
    check("regions", small_skill, files)


def test_labels_of_other_programs(small_skill: Path, rounds: int, tmp_path: Path) -> None:
    polygon, image = [10, 10, 50.5, 10, 50, 60], {"id": 1, "file_name": "7.jpg", "width": 160, "height": 120}
    mask = {"size": [120, 160], "counts": [2000, 50, 70, 50, 17030]}
    coco = {
        "images": [image],
        "categories": [{"id": 1, "name": "mug"}, {"id": 2, "name": "coaster"}],
        "annotations": [
            {"image_id": 1, "category_id": 1, "segmentation": [polygon]},
            {"image_id": 1, "category_id": 2, "segmentation": mask},
        ],
    }
    points = [[10, 10], [50.5, 10], [50, 60]]
    shapes = [{"label": label, "points": points, "shape_type": "polygon"} for label in ("mug", "coaster")]
    labelme = {"imagePath": "7.jpg", "imageWidth": 160, "imageHeight": 120, "shapes": shapes}
    cvat = (
        '<annotations><image id="7" name="7.jpg" width="160" height="120"><polygon label="mug" points="1,1;9,1;9,9"/>'
        '<mask label="coaster" rle="1,3,4,1" left="3" top="4" width="3" height="3"/></image></annotations>'
    )
    chance, files = random.Random(6), [tmp_path / f"{number}.labels" for number in range(rounds)]
    for number, file in enumerate(files):
        whole = (coco, labelme)[number % 2]
        text = cvat if number % 3 == 0 else json.dumps(whole if number % 5 else change_a_place(whole, chance))
        file.write_bytes(damaged_bytes(text.encode(), chance) if number % 5 else text.encode())
    check("labels", small_skill, files)


def test_cache_files(
    small_skill: Path, demonstration_frames: tuple[np.ndarray, ...], rounds: int, tmp_path: Path
) -> None:
    features = Sift().extract(np.ascontiguousarray(demonstration_frames[0][:, :, 1]), 20)
    np.savez(tmp_path / "whole.npz", **_pack(features))  # type: ignore[arg-type]
    chance, content = random.Random(4), (tmp_path / "whole.npz").read_bytes()
    files = [tmp_path / f"{number}.npz" for number in range(rounds)]
    for file in files:
        file.write_bytes(damaged_bytes(content, chance))
    check("cache", small_skill, files)


@pytest.mark.parametrize("suffix", [".png", ".jpg", ".bmp", ".webp", ".tif"])
def test_pictures(
    small_skill: Path, small_picture: Callable[[str], bytes], rounds: int, tmp_path: Path, suffix: str
) -> None:
    chance, content = random.Random(5), small_picture(suffix)
    files = [tmp_path / f"{number}{suffix}" for number in range(max(rounds // 5, 20))]
    for file in files:
        file.write_bytes(damaged_bytes(content, chance))
    check("picture", small_skill, files)


@pytest.mark.parametrize("suffix", [".mp4", ".webm", ".avi"])
def test_videos(
    small_skill: Path, demonstration_frames: tuple[np.ndarray, ...], rounds: int, tmp_path: Path, suffix: str
) -> None:
    chance, files = random.Random(7), [tmp_path / f"{number}{suffix}" for number in range(rounds)]
    content = write_video(tmp_path / f"whole{suffix}", demonstration_frames).read_bytes()
    for file in files:
        file.write_bytes(damaged_bytes(content, chance))
    check("video", small_skill, files)
