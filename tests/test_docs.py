"""The documentation's sizes, links and examples; ``make docs`` builds it."""

import importlib
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "docs"
PAGES = sorted(path for path in DOCS.rglob("*.md") if "_generated" not in path.parts)
MARKDOWN = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *PAGES]
CODE = re.compile(r"^```.*?^```$", re.MULTILINE | re.DOTALL)
TOCTREE = re.compile(r"^```\{toctree\}\n(.*?)^```", re.MULTILINE | re.DOTALL)
PYTHON = re.compile(r"^```python\n(.*?)^```$", re.MULTILINE | re.DOTALL)
LINK = re.compile(r"\]\(([^)\s]+)\)")


def _name(path: Path) -> str:
    return str(path.relative_to(ROOT))


def _slugs(text: str) -> set[str]:
    """The anchors of a page's headings, as MyST and GitHub make them."""
    headings = re.findall(r"^#{1,6} (.+)$", CODE.sub("", text), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


@pytest.mark.parametrize(("page", "limit"), [("README.md", 6144), ("CONTRIBUTING.md", 3072)])
def test_page_is_short(page: str, limit: int) -> None:
    assert (ROOT / page).stat().st_size <= limit


@pytest.mark.parametrize("page", MARKDOWN, ids=_name)
def test_relative_links_resolve(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    targets = [target for target in LINK.findall(CODE.sub("", text)) if "://" not in target]
    for target in targets:
        path, _, anchor = target.partition("#")
        linked = (page.parent / path).resolve() if path else page
        assert linked.exists(), f"{_name(page)} links to {target}"
        if anchor:
            assert anchor in _slugs(linked.read_text(encoding="utf-8")), f"{_name(page)} links to {target}"


def test_pages_that_the_source_mentions_exist() -> None:
    mentioned = {
        (match, _name(path))
        for path in (ROOT / "geoskill").rglob("*.py")
        for match in re.findall(r"docs/[\w/-]+\.md", path.read_text(encoding="utf-8"))
    }
    missing = sorted(f"{page} ({source})" for page, source in mentioned if not (ROOT / page).is_file())
    assert not missing


def test_pages_are_in_the_table_of_contents() -> None:
    listed = {DOCS / "index.md"}
    for page in PAGES:
        for block in TOCTREE.findall(page.read_text(encoding="utf-8")):
            listed |= {page.parent / f"{line}.md" for line in block.split() if not line.startswith(":")}
    assert [_name(page) for page in PAGES if page not in listed] == []


def test_design_choices_are_numbered_from_1_to_17() -> None:
    text = (DOCS / "design-choices.md").read_text(encoding="utf-8")
    numbers = [int(number) for number in re.findall(r"^## (\d+)\. ", text, re.MULTILINE)]
    assert numbers == list(range(1, 18))


def test_pictures_are_used() -> None:
    used = {Path(target).name for page in MARKDOWN for target in LINK.findall(page.read_text(encoding="utf-8"))}
    assert {picture.name for picture in (DOCS / "images").iterdir()} <= used


@pytest.mark.parametrize("page", MARKDOWN, ids=_name)
def test_python_examples_compile(page: Path) -> None:
    for block in PYTHON.findall(page.read_text(encoding="utf-8")):
        compile(block, _name(page), "exec")


def test_plug_in_examples_pass_their_own_tests(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("geoskill.testing")
    blocks = PYTHON.findall((DOCS / "usage" / "extending.md").read_text(encoding="utf-8"))
    package = tmp_path / "geoskill_extras"
    package.mkdir()
    for name in ("__init__", "perp", "test_perp", "corners", "test_corners"):
        (package / f"{name}.py").write_text("" if name == "__init__" else blocks.pop(0), encoding="utf-8")
    assert not blocks
    monkeypatch.syspath_prepend(tmp_path)
    for name in ("test_perp", "test_corners"):
        examples = vars(importlib.import_module(f"geoskill_extras.{name}"))
        tests = [value for key, value in examples.items() if key.startswith("test_")]
        assert len(tests) == 3
        for test in tests:
            test()
