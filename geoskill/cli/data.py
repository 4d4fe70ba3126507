"""``make data``: fetch the real demonstrations of the results from the public repository of their authors.

The archive of one commit is read as a stream, and what is wanted of it written; nothing else of it is. A sequence is
taken only if its frames are, byte for byte, those on which the results were measured.
"""

import hashlib
import re
import sys
import tarfile
import urllib.error
import urllib.request
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from typing import Final, final

from geoskill.errors import InputError
from geoskill.io.atomic import atomic_path

REPOSITORY: Final = "https://github.com/atlas-jj/state-representation-robotics"
COMMIT: Final = "04e381d"
ARCHIVE: Final = f"https://codeload.github.com/atlas-jj/state-representation-robotics/tar.gz/{COMMIT}"
LICENSE: Final = 'free of charge and of conditions, "as is" ("My TOTALLY FREE License", Copyright (c) 2019 Jun Jin)'
FRAME: Final = re.compile(r"raw_([0-9]{1,6})\.jpg")
TIMEOUT_S = 60
MAX_FRAME_BYTES = 10_000_000


@final
@dataclass
class Sequence:
    """One recording.

    Attributes:
        folder: where the archive has it.
        count: number of its frames.
        digest: SHA-256 of all frames, in the order of their numbers.
        frames: what was read so far, by number.
    """

    folder: str
    count: int
    digest: str
    frames: dict[int, bytes] = field(default_factory=dict)

    @property
    def content(self) -> list[bytes]:
        """The frames in the order of their numbers."""
        return [self.frames[number] for number in sorted(self.frames)]


SEQUENCES: Final[Mapping[str, tuple[str, int, str]]] = {
    "blocks/human1": (
        "Dataset/Blocks/human1",
        205,
        "3414af4c1b29247f72673809075c7fcc40472cc03ae844c6f8ae65faa2186814",
    ),
    "blocks/robot1": (
        "Dataset/Blocks/robot1",
        315,
        "288e8341de12a9c4bd92f95293156db9227cb82591e4849bdfc41bfeb9536f7b",
    ),
    "cloth/human1": (
        "Dataset/Cloth/human1",
        105,
        "a947498cfedba394e86621a0fae848ec49c8a0a06c6e9cc83b2db0777fb011ef",
    ),
    "cloth/robot1": (
        "Dataset/Cloth/robot1",
        256,
        "d4f879de6aed73e456d251105ddbf5b8102fe40b8be8c5f1b781bd77270f87d7",
    ),
}
"""The demonstrations by the folder that they get, with place, number of frames and digest."""


def main() -> None:
    """Run ``python -m geoskill.cli.data [DIR]``; the folder is ``data`` by default."""
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else "data")
    print(f"{REPOSITORY}, commit {COMMIT}\nlicense: {LICENSE}", flush=True)
    try:
        for name in fetch(folder, ARCHIVE):
            print(f"  {folder / name}")
    except InputError as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(2)
    print(f"\nnext: python train.py task=video task.path={folder / 'blocks' / 'human1'}")


def fetch(folder: Path, url: str, wanted: Mapping[str, tuple[str, int, str]] = SEQUENCES) -> list[str]:
    """Write the sequences that are not in ``folder`` yet, and return the names of all that are.

    Raises:
        InputError: when the archive cannot be fetched, is damaged, or has other frames.
    """
    missing = {name: Sequence(*own) for name, own in wanted.items() if not _is_there(folder / name, own[1])}
    if missing:
        _read(url, {own.folder: own for own in missing.values()})
    for name, own in missing.items():
        found = hashlib.sha256(b"".join(own.content)).hexdigest()
        if (len(own.frames), found) != (own.count, own.digest):
            raise InputError(
                f"{url}: {own.folder} has {len(own.frames)} frames with the digest {found[:12]}…; expected {own.count}"
                f" with {own.digest[:12]}…, those of the results"
            )
        (folder / name).mkdir(parents=True, exist_ok=True)
        for number, content in enumerate(own.content):
            with atomic_path(folder / name / f"{number:04d}.jpg") as temporary:
                temporary.write_bytes(content)
    return list(wanted)


def _is_there(folder: Path, count: int) -> bool:
    return folder.is_dir() and len(list(folder.glob("*.jpg"))) == count


def _read(url: str, sequences: Mapping[str, Sequence]) -> None:
    try:
        with (
            urllib.request.urlopen(url, timeout=TIMEOUT_S) as stream,
            tarfile.open(fileobj=stream, mode="r|gz") as archive,
        ):
            for member in archive:
                # The first folder is named after repository and commit.
                path = PurePosixPath(*PurePosixPath(member.name).parts[1:])
                frame = FRAME.fullmatch(path.name)
                sequence = sequences.get(str(path.parent))
                if frame is None or sequence is None or not member.isfile() or member.size > MAX_FRAME_BYTES:
                    continue
                opened = archive.extractfile(member)
                assert opened is not None
                sequence.frames[int(frame[1])] = opened.read()
    except (urllib.error.URLError, TimeoutError) as error:
        reason = getattr(error, "reason", error)
        raise InputError(f"{url}: cannot be fetched ({reason}); expected a network that reaches it") from error
    except (tarfile.TarError, EOFError, OSError) as error:
        raise InputError(f"{url}: damaged or cut off ({error}); expected a whole archive") from error


if __name__ == "__main__":
    main()
