"""What could run code by its name is used at the door alone: in the whole package, read as syntax."""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

import geoskill

PACKAGE = Path(geoskill.__file__).parent

# Each with the files that may have it, and why they may.
DANGEROUS: dict[str, set[str]] = {
    "instantiate": set(),
    "get_class": set(),
    "get_method": set(),
    "get_object": set(),
    "get_static_method": set(),
    "locate": set(),
    "eval": set(),
    "exec": set(),
    "compile": set(),
    "__import__": set(),
    "pickle": set(),
    "cloudpickle": set(),
    "dill": set(),
    "marshal": set(),
    "shelve": set(),
    "runpy": set(),
    "system": set(),
    "popen": set(),
    "import_module": {"__init__.py", "plugins.py"},  # its own modules, and entry points of installed packages
    "instantiate_launcher": {"cli/reproduce.py"},  # of the command line's hydra/launcher
    "subprocess": {"cli/study.py", "benchmarks/waiting.py"},  # this package's own commands
    "hydra": {"cli/*"},
    "omegaconf": {"cli/*"},
}
# Functions that are harmless with an argument of theirs.
SAFE_WITH = {"torch.load": ("weights_only", True), "np.load": ("allow_pickle", False)}
# Readers of YAML that make objects.
UNSAFE_YAML = ("load", "load_all", "full_load", "full_load_all", "unsafe_load", "unsafe_load_all")


def findings(source: str) -> Iterator[str]:
    """Yield everything in a module that could run what it is given."""
    for node in ast.walk(ast.parse(source)):
        names: list[str] = []
        if isinstance(node, ast.Import):
            names = [part for own in node.names for part in own.name.split(".")]
        elif isinstance(node, ast.ImportFrom):
            names = [*(node.module or "").split("."), *(own.name for own in node.names)]
        elif isinstance(node, ast.Name):
            names = [node.id]
        elif isinstance(node, ast.Attribute):
            # Methods of the same name are others: ``model.eval()``, ``re.compile``.
            names = [] if node.attr in ("eval", "compile") else [node.attr]
        yield from (name for name in names if name in DANGEROUS)
        if isinstance(node, ast.Call):
            called = ast.unparse(node.func)
            given = {own.arg: ast.unparse(own.value) for own in node.keywords}
            if called in SAFE_WITH and given.get(SAFE_WITH[called][0]) != str(SAFE_WITH[called][1]):
                yield called
            if called in {f"yaml.{name}" for name in UNSAFE_YAML}:
                yield called


def allowed(name: str, file: str) -> bool:
    return any(Path(file).match(pattern) for pattern in DANGEROUS.get(name, ()))


@pytest.mark.parametrize("path", sorted(PACKAGE.rglob("*.py")), ids=lambda path: str(path.relative_to(PACKAGE)))
def test_nothing_runs_what_it_is_given(path: Path) -> None:
    file = str(path.relative_to(PACKAGE))
    found = set(findings(path.read_text(encoding="utf-8")))
    assert [name for name in found if not allowed(name, file)] == []


@pytest.mark.parametrize(
    ("source", "expected"),
    [
        ("from hydra.utils import instantiate", {"hydra", "instantiate"}),
        ("import hydra\nhydra.utils.instantiate(x)", {"hydra", "instantiate"}),
        ("exec(text)", {"exec"}),
        ("model.eval()\nre.compile(x)", set()),
        ("torch.load(path)", {"torch.load"}),
        ("torch.load(path, weights_only=False)", {"torch.load"}),
        ("torch.load(path, weights_only=True)", set()),
        ("np.load(path)", {"np.load"}),
        ("yaml.load(text, Loader)", {"yaml.load"}),
        ("yaml.safe_load(text)", set()),
        ("import importlib\nimportlib.import_module(x)", {"import_module"}),
        ("from os import system", {"system"}),
    ],
)
def test_what_is_found(source: str, expected: set[str]) -> None:
    assert set(findings(source)) == expected


def test_what_is_allowed_is_used() -> None:
    """Nothing stays allowed once it is gone."""
    for name, patterns in DANGEROUS.items():
        for pattern in patterns:
            files = [path for path in PACKAGE.rglob("*.py") if path.relative_to(PACKAGE).match(pattern)]
            assert any(name in set(findings(path.read_text(encoding="utf-8"))) for path in files), (name, pattern)
