"""Tests of YAML with lines: values, and everything that is refused."""

from pathlib import Path

import pytest

from geoskill.errors import InputError
from geoskill.io.marked_yaml import MAX_BYTES, read_marked_yaml


def written(folder: Path, text: str | bytes) -> Path:
    path = folder / "edited.yaml"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def test_values_have_their_lines(tmp_path: Path) -> None:
    read = read_marked_yaml(written(tmp_path, "# why\na: 1\nb:\n  c: [x, 2.5]\n  d: {e: null, f: true}\ng: '1'\n"))
    assert read.plain() == {"a": 1, "b": {"c": ["x", 2.5], "d": {"e": None, "f": True}}, "g": "1"}
    assert isinstance(read.value, dict)
    assert {key: own.line for key, own in read.value.items()} == {"a": 2, "b": 3, "g": 6}
    inner = read.value["b"].value
    assert isinstance(inner, dict)
    assert {key: own.line for key, own in inner.items()} == {"c": 4, "d": 5}


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "is empty"),
        ("a: 1\nb: [1\n", "line 3: is no YAML"),
        ("a: 1\n\tb: 2\n", "line 2: is no YAML"),
        ("a: 1\nb: 2\na: 3\n", "line 3: 'a' occurs twice"),
        ("a: &x 1\nb: *x\n", "line 1: has an anchor or alias"),
        ("a: 1\nb: !!python/object/apply:os.getcwd []\n", "line 2: has the tag"),
        ("a: !!python/name:os.getcwd ''\n", "line 1: '' is a .*; expected plain values"),
        ("a: 2026-01-01\n", "line 1: '2026-01-01' is a timestamp"),
        ("a: .nan\n", "line 1: .nan is no finite number"),
        ("a: " + 5000 * "9", "line 1: '9.*cannot be read"),
        ("? [1]\n: 2\n", r"line 1: a key is \[1\]"),
        ("a: 1\n---\nb: 2\n", "line 2: begins another document"),
        (500 * "[", "line 1: "),
        (17 * "[" + 17 * "]", "line 1: is nested deeper than 16"),
        (b"a: \xff\n", "it is not UTF-8"),
        (b"a: \x00\n", "is no YAML"),
        ("#" * (MAX_BYTES + 1), "expected a file of at most"),
    ],
)
def test_bad_file_is_refused_with_its_line(tmp_path: Path, text: str | bytes, message: str) -> None:
    path = written(tmp_path, text)
    with pytest.raises(InputError, match=f"^{path}.*{message}") as raised:
        read_marked_yaml(path)
    assert "\n" not in str(raised.value)
    assert len(str(raised.value)) < 400 + len(str(path))


def test_missing_file_and_folder_are_refused(tmp_path: Path) -> None:
    for path in (tmp_path / "none.yaml", tmp_path):
        with pytest.raises(InputError, match=f"^{path}: cannot be read"):
            read_marked_yaml(path)
