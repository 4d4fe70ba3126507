"""Classes of other packages: found by name, used like built-in ones, refused in one line where they cannot be."""

import importlib
import json
import os
import subprocess
import sys
import tomllib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, ClassVar, final

import numpy as np
import pytest
import torch
from hydra.core.config_store import ConfigStore
from torch import Tensor, nn

from geoskill import Skill, TrainConfig, learn, register
from geoskill.cli.compose import compose_training
from geoskill.config import DemonstrationConfig, FeaturesConfig, TrainerConfig
from geoskill.errors import InputError
from geoskill.features.extractor import FeatureExtractor
from geoskill.features.feature_set import FeatureSet
from geoskill.geometry.primitives import NodeType
from geoskill.kernels.enumeration import unordered_pairs
from geoskill.kernels.kernel import Kernel
from geoskill.kernels.p2p import PointToPoint
from geoskill.model.scorer import InstanceScorer, Motif
from geoskill.plugins import EXTRACTORS, KERNELS, REGISTRIES, SCORERS, TASKS, Registry, code_identity
from geoskill.skill.build import build_skill
from geoskill.skill.checkpoint import read_skill
from geoskill.skill.plan import plan_skill
from geoskill.skill.spec import SkillSpec
from geoskill.testing import check_extractor, check_kernel, check_scorer

ROOT = Path(__file__).resolve().parents[1]
EXAMPLE = ROOT / "tests" / "plugin_package"
GROUPS = {"perp": KERNELS, "corners": EXTRACTORS, "cosine": SCORERS, "covering": TASKS}

TINY = TrainConfig(
    model={"name": "bilinear", "hidden_dim": 8},
    features=FeaturesConfig(max_features=20, min_side=0),
    demonstration=DemonstrationConfig(max_span_ratio=0.0),
    trainer=TrainerConfig(max_epochs=1, limit_train_batches=2),
)


def forget_plug_ins() -> None:
    for registry in REGISTRIES:
        vars(registry).pop("plug_ins", None)


@pytest.fixture
def fresh_registries(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Registries and Hydra's groups as without plug-ins, also after the test."""
    forget_plug_ins()
    store = ConfigStore.instance().repo
    groups = {registry.kind: dict(store.get(registry.kind, {})) for registry in REGISTRIES}
    for registry in REGISTRIES:
        monkeypatch.setattr(registry, "_registered", {})
    yield
    monkeypatch.undo()
    store.update(groups)
    forget_plug_ins()


Install = Callable[..., None]


@pytest.fixture
def install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, fresh_registries: None) -> Install:
    """``install("a-package", {"geoskill.kernels": {"perp": "module:Class"}}, module="source")`` installs a package."""

    def run(package: str, points: Mapping[str, Mapping[str, str]], **modules: str) -> None:
        site = tmp_path / package
        folder = site / f"{package.replace('-', '_')}-1.dist-info"
        folder.mkdir(parents=True)
        (folder / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {package}\nVersion: 1\n")
        sections = [
            "\n".join([f"[{group}]", *(f"{name} = {value}" for name, value in entries.items())])
            for group, entries in points.items()
        ]
        (folder / "entry_points.txt").write_text("\n".join(sections) + "\n")
        for name, source in modules.items():
            (site / f"{name}.py").write_text(source)
            monkeypatch.delitem(sys.modules, name, raising=False)
        monkeypatch.syspath_prepend(site)
        forget_plug_ins()

    return run


@pytest.fixture
def example(install: Install, monkeypatch: pytest.MonkeyPatch) -> None:
    """The example package, installed by hand."""
    install(
        "geoskill-perp-example",
        {
            "geoskill.kernels": {"perp": "geoskill_perp_example.perp:Perpendicular"},
            "geoskill.extractors": {"corners": "geoskill_perp_example.corners:Corners"},
            "geoskill.scorers": {"cosine": "geoskill_perp_example.cosine:Cosine"},
            "geoskill.tasks": {"covering": "geoskill_perp_example.covering:Covering"},
        },
    )
    monkeypatch.syspath_prepend(EXAMPLE)


def pair(**changes: Any) -> Any:
    """A kernel of two points by the name of ``pair``, but for the changes; None leaves a member out."""
    members = {
        "__module__": __name__,
        "name": "pair",
        "meaning": "two points come together",
        "roles": (NodeType.POINT, NodeType.POINT),
        "edges": ((0, 1),),
        "error_dim": 2,
        "resolution": 1.0,
        "instances": lambda self, counts: unordered_pairs(counts[NodeType.POINT]),
        "control_error": lambda self, nodes: nodes[0] - nodes[1],
    }
    return final(type("Pair", (Kernel,), {key: own for key, own in {**members, **changes}.items() if own is not None}))


def plan(config: Any) -> SkillSpec:
    return plan_skill(config.kernel, config.descriptor, config.model, config.features, config.inference.top_k)


# Names


def test_built_in_names_are_found_without_importing_the_classes() -> None:
    program = (
        "import sys; from geoskill.plugins import REGISTRIES\n"
        "print([name for registry in REGISTRIES for name in registry.built_in])\n"
        "print([name for name in ('torch', 'cv2', 'mujoco', 'lightning') if name in sys.modules])"
    )
    ended = subprocess.run([sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, check=True)
    names, heavy = ended.stdout.splitlines()
    kernels = ["copl", "copl2", "l2l", "l2l3", "p2c", "p2l", "p2l3", "p2p", "p2p3", "p2pl", "par", "par3"]
    extractors = ["aliked", "conics", "disk", "lbd", "orb", "patch", "planes", "sift", "xfeat"]
    scorers = ["bilinear", "message_passing", "prototypes"]
    tasks = ["flush", "folding", "insertion", "ring", "screw", "sorting"]
    assert (names, heavy) == (str([*kernels, *extractors, *scorers, *tasks]), "[]")


@pytest.mark.parametrize("registry", REGISTRIES, ids=lambda registry: registry.kind)
def test_every_concrete_built_in_class_is_registered(registry: Registry) -> None:
    """A class that forgets its name would be on no command line."""
    folder = Path(str(importlib.import_module(registry._base_module).__file__)).parent
    for path in folder.glob("*.py"):
        importlib.import_module(f"{registry._package}.{path.stem}")
    classes = {cls for cls in registry.base.__subclasses__() if cls.__module__.startswith("geoskill.")}
    assert classes == {registry.get(name) for name in registry.built_in}


def test_entry_points_are_found_by_name(example: None) -> None:
    for name, registry in GROUPS.items():
        assert registry.names() == (*registry.built_in, name)
        assert registry.get(name).name == name  # type: ignore[attr-defined]
        assert registry.provider(name) == "geoskill-perp-example"
        assert registry.provider(registry.built_in[0]) == "geoskill"


def test_entry_points_of_the_example_are_those_that_it_declares(example: None) -> None:
    declared = tomllib.loads((EXAMPLE / "pyproject.toml").read_text())["project"]["entry-points"]
    assert declared == {registry.group: {name: registry.plug_ins[name].value} for name, registry in GROUPS.items()}


@pytest.mark.parametrize(
    ("registry", "name"),
    [
        (KERNELS, "p2p"),
        (KERNELS, "p2p_l2l"),
        (EXTRACTORS, "sift"),
        (SCORERS, "bilinear"),
        (SCORERS, "default"),
        (SCORERS, "paper"),
        (TASKS, "sorting"),
        (TASKS, "video"),
    ],
)
def test_entry_point_cannot_take_a_name_of_the_command_line(install: Install, registry: Registry, name: str) -> None:
    install("intruder", {registry.group: {name: "intruding:Class"}}, intruding="raise SystemExit('imported')")
    assert name not in registry.plug_ins
    if name in registry.built_in:
        assert registry.get(name).__module__.startswith("geoskill.")
        assert registry.provider(name) == "geoskill"
    else:
        with pytest.raises(InputError, match="no such"):
            registry.get(name)


@pytest.mark.parametrize("name", ["p2p", "p2p_l2l"])
def test_register_cannot_take_a_name_of_the_command_line(fresh_registries: None, name: str) -> None:
    with pytest.raises(InputError, match=f"kernel={name}: the name is taken"):
        register(pair(name=name))
    assert KERNELS.get("p2p") is PointToPoint


def test_register_cannot_take_the_name_of_a_plug_in(example: None) -> None:
    with pytest.raises(InputError, match="kernel=perp: the name is taken"):
        register(pair(name="perp"))


def test_plug_in_may_register_its_class_too(example: None) -> None:
    from geoskill_perp_example.perp import Perpendicular  # type: ignore[import-not-found]

    assert register(Perpendicular) is Perpendicular
    assert KERNELS.names() == (*KERNELS.built_in, "perp")
    assert KERNELS.provider("perp") == "geoskill-perp-example"


def test_two_packages_of_one_name_are_told(install: Install) -> None:
    for package in ("first-package", "second-package"):
        install(package, {"geoskill.kernels": {"twice": "somewhere:Class"}})
    with pytest.raises(InputError, match="kernel=twice: provided by first-package, second-package; expected one"):
        KERNELS.get("twice")


# Classes


@pytest.mark.parametrize(
    ("cls", "expected"),
    [
        (int, "int: cannot be registered; expected a subclass of Kernel, FeatureExtractor, InstanceScorer or Task"),
        ("pair", "'pair': cannot be registered"),
        (pair(control_error=None), "kernel=pair: Pair lacks control_error"),
        (pair(name=None), "kernel=: expected a name of small letters"),
        (pair(name="a.b"), "kernel=a.b: expected a name of small letters"),
        (pair(name="Pair"), "kernel=Pair: expected a name of small letters"),
    ],
)
@pytest.mark.usefixtures("fresh_registries", "annotations_unchecked")
def test_register_checks_the_class(cls: Any, expected: str) -> None:
    with pytest.raises(InputError, match=expected):
        register(cls)


def test_entry_point_is_checked_for_its_base_class(install: Install, monkeypatch: pytest.MonkeyPatch) -> None:
    points = {"geoskill.kernels": {"corners": "geoskill_perp_example.corners:Corners", "text": "builtins:str"}}
    install("mistaken", points)
    monkeypatch.syspath_prepend(EXAMPLE)
    for name in ("corners", "text"):
        with pytest.raises(InputError, match=f"kernel={name}: .* is no Kernel; expected a subclass of it"):
            KERNELS.get(name)


def test_entry_point_must_have_the_name_of_its_class(install: Install, monkeypatch: pytest.MonkeyPatch) -> None:
    install("misnamed", {"geoskill.kernels": {"right_angle": "geoskill_perp_example.perp:Perpendicular"}})
    monkeypatch.syspath_prepend(EXAMPLE)
    with pytest.raises(InputError, match=r"kernel=right_angle: Perpendicular\.name is 'perp'; expected 'right_angle'"):
        KERNELS.get("right_angle")


def test_example_passes_the_checks(example: None) -> None:
    check_kernel(KERNELS.get("perp"))
    check_extractor(EXTRACTORS.get("corners"))
    check_extractor(EXTRACTORS.get("corners")(min_distance=9.0))
    check_scorer(SCORERS.get("cosine"))  # type: ignore[arg-type]  # a class makes its instances


# Arguments


def extractor_of(constructor: Callable[..., None] | None, **changes: Any) -> Any:
    members = {
        "__module__": __name__,
        "name": "odd",
        "node_type": NodeType.POINT,
        "descriptor_dim": 4,
        "extract": lambda self, image, limit=None: FeatureSet.empty(NodeType.POINT, 4),
        "__init__": constructor,
        **changes,
    }
    return final(type("Odd", (FeatureExtractor,), {key: own for key, own in members.items() if own is not None}))


# ruff: noqa: RUF013, F821  # constructors as they should not be
def take_anything(self: Any, **settings: float) -> None: ...
def take_positions(self: Any, size: float = 1.0, /) -> None: ...
def take_a_list(self: Any, sizes: Any = (1, 2)) -> None: ...
def take_a_mistaken_default(self: Any, size: int = 0.5) -> None: ...  # type: ignore[assignment]
def take_a_name(self: Any, name: str = "x") -> None: ...
def take_a_size(self: Any, size: float) -> None: ...
def take_what_is_not_imported(self: Any, size: "Missing" = 1.0) -> None: ...  # type: ignore[name-defined]
def take_nothing_or(self: Any, size: float = None, count: int | None = 3, kind: list[int] = None) -> None: ...  # type: ignore[assignment]


@pytest.mark.parametrize(
    ("constructor", "expected"),
    [
        (take_anything, r"descriptor=odd: takes \*\*settings: float; expected named arguments"),
        (take_positions, "descriptor=odd: takes size: float = 1.0; expected named arguments"),
        (take_a_list, r"descriptor=odd: takes sizes: Any = \(1, 2\); expected a number, text, true, false or None"),
        (take_a_mistaken_default, "descriptor=odd: size=0.5: expected a whole number"),
        (take_a_name, "descriptor=odd: takes name: str = 'x'; expected named arguments, none called name"),
        (take_a_size, "descriptor=odd: expected a value for size"),
    ],
)
@pytest.mark.usefixtures("fresh_registries")
def test_arguments_that_cannot_be_written_down_are_refused(constructor: Callable[..., None], expected: str) -> None:
    register(extractor_of(constructor))
    with pytest.raises(InputError, match=expected):
        EXTRACTORS.build("odd", {})


@pytest.mark.usefixtures("fresh_registries")
def test_types_of_arguments_are_those_of_the_constructor() -> None:
    register(extractor_of(take_nothing_or))
    annotations = {key: own.annotation for key, own in EXTRACTORS.parameters("odd").items()}
    assert annotations == {"size": float | None, "count": int | None, "kind": Any}
    register(extractor_of(take_what_is_not_imported))
    assert EXTRACTORS.parameters("odd")["size"].annotation is Any
    register(extractor_of(None))
    assert EXTRACTORS.parameters("odd") == {}


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        ({"min_distance": "wide"}, "descriptor=corners: min_distance=wide: expected a number"),
        ({"min_distance": True}, "descriptor=corners: min_distance=.rue: expected a number"),
        ({"min_distance": None}, "descriptor=corners: min_distance=null: expected a number"),
        ({"min_distance": [1]}, "descriptor=corners: min_distance is .1.; expected a number, text, true or false"),
        ({"distance": 1}, "descriptor=corners has no argument 'distance'; expected min_distance, patch_size"),
    ],
)
@pytest.mark.usefixtures("annotations_unchecked")
def test_argument_is_refused_in_python(example: None, arguments: dict[str, Any], expected: str) -> None:
    with pytest.raises(InputError, match=expected):
        plan_skill("p2p", {"corners": arguments}, "bilinear", FeaturesConfig(), 10)


def test_argument_reaches_the_class(example: None) -> None:
    assert vars(EXTRACTORS.build("corners", {"min_distance": 3})()) == {"min_distance": 3, "patch_size": 12.0}


# The command line


def test_plug_ins_compose_with_their_arguments(example: None) -> None:
    overrides = ["kernel=[p2p,perp]", "descriptor=[corners,lbd]", "descriptor.corners.min_distance=3", "model=cosine"]
    spec = plan(compose_training(*overrides, "model.temperature=0.5"))
    assert list(spec.members) == ["p2p_corners", "perp_lbd"]
    assert spec.extractors["corners"].arguments == {"min_distance": 3.0, "patch_size": 12.0}
    assert (spec.model.name, spec.model.arguments) == ("cosine", {"temperature": 0.5})
    assert {spec.model.package, spec.extractors["corners"].package} == {"geoskill-perp-example"}
    assert compose_training("task=covering").task.name == "covering"
    assert SkillSpec.from_plain(spec.as_plain()) == spec


def test_ensembles_of_built_in_kernels_are_lists(fresh_registries: None) -> None:
    assert list(plan(compose_training("kernel=[l2l,par]")).members) == ["l2l_lbd", "par_lbd"]
    assert list(plan(compose_training("kernel=p2p_l2l")).members) == ["p2p_sift", "l2l_lbd"]


BROKEN = {
    "raising": "raise RuntimeError('two lines,\\nof trouble')",
    "leaving": "raise SystemExit('not now')",
    "incomplete": "",
    "listing": (
        "from typing import final\nfrom geoskill.kernels.p2p import PointToPoint as P\n"
        "from geoskill.kernels.kernel import Kernel\n"
        "class Class(Kernel):\n    name = 'listing'\n    meaning, roles, edges = P.meaning, P.roles, P.edges\n"
        "    error_dim, resolution = P.error_dim, P.resolution\n"
        "    instances, control_error = P.instances, P.control_error\n"
        "    def __init__(self, sizes=[1, 2]): pass\n"
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", BROKEN)
def test_broken_plug_in_disturbs_nobody_and_is_told_when_it_is_used(install: Install, name: str) -> None:
    points = {registry.group: {name: f"{name}_module:Class"} for registry in REGISTRIES}
    install("broken-package", points, **{f"{name}_module": BROKEN[name]})
    assert list(plan(compose_training()).members) == ["p2p_sift"]
    used = [
        ("kernel", plan, [f"kernel=[p2p,{name}]"]),
        ("descriptor", plan, [f"descriptor=[{name},lbd]", f"descriptor.{name}.size=3"]),
        ("model", plan, [f"model={name}", "model.size=3"]),
        ("task", lambda config: TASKS.build(config.task.name, {}), [f"task={name}"]),
    ]
    for kind, use, overrides in used:
        config = compose_training(*overrides)
        with pytest.raises(InputError, match=f"^{kind}={name}: "):
            use(config)


# Python


@final
class Middle(InstanceScorer):
    """The mean of the nodes' own scores."""

    name: ClassVar[str] = "middle"

    def __init__(self, motif: Motif, gain: float = 2.0) -> None:
        super().__init__()
        self.motif, self.gain = motif, gain
        self.weights = nn.ModuleDict({str(kind): nn.Linear(dim, 1) for kind, dim in motif.descriptor_dims.items()})

    def forward(self, descriptors: Mapping[NodeType, Tensor], instance_index: Tensor) -> Tensor:
        own = {kind: self.weights[str(kind)](rows).squeeze(1) for kind, rows in descriptors.items()}
        terms = [own[role][row] for role, row in zip(self.motif.roles, instance_index, strict=True)]
        return self.gain * torch.stack(terms).mean(dim=0)


@pytest.mark.slow
def test_registered_classes_are_learned_with_saved_and_loaded(
    fresh_registries: None, demonstration_frames: tuple[np.ndarray, ...], tmp_path: Path
) -> None:
    kernel = register(pair())
    assert register(Middle) is Middle  # as a decorator, it returns the class
    config = replace(TINY, kernel=["p2p", "pair"], model={"name": "middle", "gain": 3.0})
    learned = learn(config, [np.stack(demonstration_frames)])
    assert list(learned.skill.members) == ["p2p_sift", "pair_sift"]
    assert isinstance(learned.skill.members["pair_sift"].kernel, kernel)
    learned.save(tmp_path / "skill.ckpt")
    loaded = Skill.load(tmp_path / "skill.ckpt")
    scorer = loaded.members["pair_sift"].scorer
    assert isinstance(scorer, Middle)
    assert scorer.gain == 3.0
    expected = [association.as_json() for association in learned.skill.infer(demonstration_frames[0]).associations]
    assert [found.as_json() for found in loaded.infer(demonstration_frames[0]).associations] == expected


def test_class_of_a_script_is_asked_for_when_it_is_missing(fresh_registries: None) -> None:
    register(pair(__module__="__main__"))
    spec = plan_skill("pair", "sift", "bilinear", FeaturesConfig(), 10)
    part = spec.members["pair_sift"].kernel
    assert part.package == "__main__"
    KERNELS._registered.clear()
    with pytest.raises(InputError, match="kernel=pair: registered by the script that learned it; register it here too"):
        KERNELS.build(part.name, part.arguments, part.package)


def test_results_of_plug_ins_are_cached_by_their_code(install: Install, tmp_path: Path) -> None:
    install("edited-package", {}, edited_module="class Edited: ...")
    edited = importlib.import_module("edited_module").Edited
    before = code_identity(edited)
    Path(str(sys.modules["edited_module"].__file__)).write_text("class Edited: size = 3")
    assert len({before, code_identity(edited), code_identity(type("Nowhere", (), {"__module__": "nowhere"})), ""}) == 4
    assert code_identity(PointToPoint) == ""


# Checkpoints from others


def spec_with(example_part: str, **changes: str) -> dict[str, Any]:
    plain = plan_skill("p2p", "sift", "bilinear", FeaturesConfig(), 10).as_plain()
    part = {
        "kernel": plain["members"]["p2p_sift"]["kernel"],
        "descriptor": plain["extractors"]["sift"],
        "model": plain["model"],
    }[example_part]
    part.update(changes)
    return plain


@pytest.mark.parametrize("part", ["kernel", "descriptor", "model"])
@pytest.mark.parametrize("name", ["os.system", "../x", "", "this", "antigravity", "kernel", "__init__", "P2P", "p2p\n"])
def test_hostile_name_is_refused_and_nothing_is_imported(part: str, name: str) -> None:
    before = set(sys.modules)
    with pytest.raises(InputError):
        build_skill(SkillSpec.from_plain(spec_with(part, name=name)))
    assert not {"antigravity", "this"} & set(sys.modules)
    assert not {module for module in set(sys.modules) - before if not module.startswith(("geoskill", "torch"))}


@pytest.mark.parametrize("package", ["", "evil; rm -rf /", "a\nb", "https://example.com/x.whl", "-r"])
def test_hostile_package_is_not_repeated_as_advice(package: str) -> None:
    with pytest.raises(InputError, match="expected the name of a class or package"):
        SkillSpec.from_plain(spec_with("kernel", name="perp", package=package))


def test_missing_package_is_named() -> None:
    spec = SkillSpec.from_plain(spec_with("kernel", name="perp", package="geoskill-perp-example"))
    with pytest.raises(
        InputError, match="kernel=perp: provided by the package 'geoskill-perp-example', which is not installed here"
    ):
        build_skill(spec)


# An installed package, through the commands


@final
class Machine:
    """Commands in a folder of their own, with the example package installed or not."""

    def __init__(self, home: Path) -> None:
        self.home = home
        self.site = home / "site"
        kept = {name: value for name, value in os.environ.items() if not name.startswith(("WANDB_", "HYDRA_"))}
        self.environment = {**kept, "HOME": str(home), "XDG_CACHE_HOME": str(home / "cache"), "OMP_NUM_THREADS": "1"}

    def run(self, *command: str, installed: bool = True) -> "subprocess.CompletedProcess[str]":
        path = os.pathsep.join([str(self.site)] if installed else [])
        return subprocess.run(
            [sys.executable, *command],
            cwd=ROOT,
            env={**self.environment, "PYTHONPATH": path},
            capture_output=True,
            text=True,
            timeout=600,
            check=False,
        )

    def train(self, *overrides: str, name: str) -> Path:
        ended = self.run("train.py", *overrides, f"hydra.run.dir={self.home / name}")
        assert ended.returncode == 0, ended.stderr
        return self.home / name


@pytest.fixture(scope="session")
def machine(tmp_path_factory: pytest.TempPathFactory) -> Machine:
    """Where the example package is installed by pip, built by the backend that the development extra installs."""
    machine = Machine(tmp_path_factory.mktemp("machine"))
    options = ["--quiet", "--no-deps", "--no-build-isolation", "--disable-pip-version-check", "--target"]
    ended = machine.run("-m", "pip", "install", *options, str(machine.site), str(EXAMPLE), installed=False)
    assert ended.returncode == 0, ended.stderr
    return machine


@pytest.fixture(scope="session")
def tiny(demonstration_folder: Path) -> Sequence[str]:
    """Overrides that make a training of the synthetic demonstration last a second."""
    return (
        "task=video",
        f"task.path={demonstration_folder}",
        "logger=none",
        "threads=1",
        "features.min_side=0",
        "features.max_features=20",
        "demonstration.max_span_ratio=0",
        "trainer.max_epochs=1",
        "trainer.limit_train_batches=2",
    )


@pytest.fixture(scope="session")
def ensemble(machine: Machine, tiny: Sequence[str]) -> Path:
    """A run in which everything that a skill is made of comes from the example package, beside built-in classes."""
    choices = ["kernel=[p2p,perp]", "descriptor=[corners,lbd]", "descriptor.corners.min_distance=3"]
    return machine.train(*choices, "model=cosine", "model.temperature=0.5", *tiny, name="ensemble")


@pytest.mark.slow
def test_kernel_of_an_installed_package_is_learned(machine: Machine, tiny: Sequence[str]) -> None:
    run = machine.train("kernel=perp", "model=bilinear", "model.hidden_dim=8", *tiny, name="perp")
    assert "one line turns perpendicular to another" in (run / "skill.yaml").read_text()
    spec = read_skill(run).spec
    assert list(spec.members) == ["perp_lbd"]
    assert spec.members["perp_lbd"].kernel.package == "geoskill-perp-example"


@pytest.mark.slow
def test_ensemble_of_plug_ins_stores_names_and_plain_arguments(ensemble: Path) -> None:
    spec = read_skill(ensemble).spec
    assert list(spec.members) == ["p2p_corners", "perp_lbd"]
    assert spec.extractors["corners"].arguments == {"min_distance": 3.0, "patch_size": 12.0}
    assert spec.model.arguments == {"temperature": 0.5}
    assert b"geoskill_perp_example" not in (ensemble / "skill.ckpt").read_bytes()  # no module's path


@pytest.mark.slow
def test_skill_of_plug_ins_loads_infers_and_is_evaluated(
    machine: Machine, ensemble: Path, demonstration_folder: Path, tmp_path: Path
) -> None:
    skill, video = f"skill={ensemble}", f"video={demonstration_folder}"
    program = f"import geoskill; print(sorted(geoskill.Skill.load({str(ensemble)!r}).members))"
    ended = machine.run("-c", program)
    assert (ended.returncode, ended.stdout) == (0, "['p2p_corners', 'perp_lbd']\n"), ended.stderr
    ended = machine.run("infer.py", skill, video, f"hydra.run.dir={tmp_path / 'infer'}")
    assert ended.returncode == 0, ended.stderr
    lines = [json.loads(line) for line in (tmp_path / "infer" / "associations.jsonl").read_text().splitlines()]
    assert {line["kernel"] for line in lines} == {"p2p", "perp"}
    squares = {name: [[x, 46], [x + 32, 46], [x + 32, 78], [x, 78]] for name, x in (("object", 28), ("target", 108))}
    moved = {**squares, "object": [[x + 47.5, y] for x, y in squares["object"]], "hand": []}
    regions = {"image_size": [160, 120], "frames": {"0": {**squares, "hand": []}, "19": moved}}
    (tmp_path / "regions.json").write_text(json.dumps(regions))
    labeled = [video, f"regions={tmp_path / 'regions.json'}", "every=4"]
    ended = machine.run("evaluate.py", skill, *labeled, f"hydra.run.dir={tmp_path / 'evaluate'}")
    assert ended.returncode == 0, ended.stderr
    assert len(json.loads((tmp_path / "evaluate" / "metrics.json").read_text())["members"]) == 2


@pytest.mark.slow
def test_skill_names_the_package_that_is_missing(
    machine: Machine, ensemble: Path, demonstration_folder: Path, tmp_path: Path
) -> None:
    arguments = [f"skill={ensemble}", f"video={demonstration_folder}", f"hydra.run.dir={tmp_path / 'infer'}"]
    ended = machine.run("infer.py", *arguments, installed=False)
    assert ended.returncode == 2
    assert "provided by the package 'geoskill-perp-example', which is not installed here" in ended.stderr
    assert len(ended.stderr.splitlines()) == 1


@pytest.mark.slow
@pytest.mark.parametrize(
    ("override", "expected"),
    [
        ("descriptor.corners.min_distance=wide", "descriptor.corners.min_distance=wide: expected a number"),
        ("descriptor.corners.distance=3", "descriptor.corners.distance"),
    ],
)
def test_argument_of_a_plug_in_is_refused_on_the_command_line(
    machine: Machine, tiny: Sequence[str], override: str, expected: str, tmp_path: Path
) -> None:
    ended = machine.run("train.py", "descriptor=corners", override, *tiny, f"hydra.run.dir={tmp_path / 'run'}")
    assert ended.returncode == 2
    assert expected in ended.stderr
    assert "expected" in ended.stderr
    assert len(ended.stderr.splitlines()) == 1


@pytest.mark.slow
@pytest.mark.usefixtures("opengl")
def test_simulated_task_of_an_installed_package_is_learned_and_scored(machine: Machine, tiny: Sequence[str]) -> None:
    overrides = [override for override in tiny if not override.startswith("task")]
    small = ["model=bilinear", "model.hidden_dim=8", "task=covering", "task.every=20"]
    run = machine.train(*small, *overrides, name="covering")
    scene = read_skill(run).provenance.scene
    assert scene is not None
    assert scene.task == "covering"
    assert "feasible_frames" in json.loads((run / "metrics.json").read_text())  # scored on ground truth
