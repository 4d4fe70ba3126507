"""Registries of kernels, descriptors, networks and simulated tasks, by the name used on the command line.

A name comes from one of three places: a file of this package whose class has the file's name as its ``name``, an entry
point of an installed package (groups ``geoskill.kernels``, ``geoskill.extractors``, ``geoskill.scorers``,
``geoskill.tasks``), or :func:`register`. Checkpoints store names, plain arguments and the package that provides the
class, never a module path: only what is installed here can be built from a checkpoint.
"""

import functools
import inspect
import re
from collections.abc import Callable, Mapping
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points, packages_distributions
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final, final

from geoskill.errors import InputError

OWN_PACKAGE: Final = "geoskill"


@final
class Registry:
    """The classes of one kind, by name.

    Args:
        kind: what a class is called in messages and on the command line, such as ``kernel``.
        base: the abstract base class, as ``MODULE:CLASS``; built-in classes are files of that module's package.
        group: the group of entry points, such as ``geoskill.kernels``.
        given: arguments that this package passes to the constructor itself.
    """

    def __init__(self, kind: str, base: str, group: str, given: tuple[str, ...] = ()) -> None:
        self.kind = kind
        self.group = group
        self.given = given
        self._base_module, _, self._base_name = base.partition(":")
        self._package = self._base_module.rpartition(".")[0]
        self._registered: dict[str, type] = {}

    @property
    def base(self) -> type:
        """The abstract base class."""
        base: type = getattr(import_module(self._base_module), self._base_name)
        return base

    @functools.cached_property
    def built_in(self) -> tuple[str, ...]:
        """Names of the classes in this package, found without importing any of them."""
        specification = find_spec(self._package)
        assert specification is not None
        folders = specification.submodule_search_locations or ()
        files = sorted(path for folder in folders for path in Path(folder).glob("*.py"))
        return tuple(path.stem for path in files if _declares_name(path))

    @functools.cached_property
    def plug_ins(self) -> Mapping[str, EntryPoint]:
        """Entry points of installed packages by name; built-in names are not among them."""
        points = {point.name: point for point in entry_points(group=self.group)}
        return {name: point for name, point in points.items() if name not in self.built_in}

    def names(self) -> tuple[str, ...]:
        """Return all names, built-in ones first."""
        return tuple(dict.fromkeys([*self.built_in, *self.plug_ins, *self._registered]))

    def get(self, name: str, package: str | None = None) -> type:
        """Return the class of a name.

        Args:
            name: as on the command line.
            package: the package that is said to provide it, for the message when it is missing.

        Raises:
            InputError: when there is no such class, or its plug-in cannot be used.
        """
        if name in self.built_in:
            return self._checked(name, class_named(f"{self._package}.{name}", name))
        if name in self._registered:
            return self._registered[name]
        if name in self.plug_ins:
            point = self.plug_ins[name]
            try:
                return self._checked(name, point.load())
            except InputError:
                raise
            except Exception as error:  # whatever a package of somebody else raises while it is imported
                raise InputError(f"{self.kind}={name}: the plug-in {point.value} cannot be loaded ({error})") from error
        if package not in (None, OWN_PACKAGE):
            raise InputError(f"{self.kind}={name}: provided by the package {package!r}, which is not installed here")
        raise InputError(f"{self.kind}={name}: no such {self.kind}; expected one of {', '.join(self.names())}")

    def register(self, cls: type) -> None:
        """Add a class, replacing an earlier one of its name that was registered the same way.

        Raises:
            InputError: when it is not of this kind, or its name is taken by this package or by a plug-in.
        """
        name = str(getattr(cls, "name", ""))
        self._checked(name, cls)
        if name in self.built_in or name in self.plug_ins:
            raise InputError(f"{self.kind}={name}: the name is taken; expected another one")
        self._registered[name] = cls

    def provider(self, name: str) -> str:
        """Return the package to install for a name."""
        if name in self.built_in:
            return OWN_PACKAGE
        point = self.plug_ins.get(name)
        if point is not None and point.dist is not None:
            return point.dist.name
        top = self.get(name).__module__.partition(".")[0]
        return next(iter(packages_distributions().get(top, [top])))

    def parameters(self, name: str) -> Mapping[str, inspect.Parameter]:
        """Return the arguments that a user may give to the class of this name.

        Raises:
            InputError: when there is no such class, or it takes arguments of other kinds.
        """
        found = inspect.signature(self.get(name)).parameters
        own = {key: parameter for key, parameter in found.items() if key not in self.given}
        named = (inspect.Parameter.KEYWORD_ONLY, inspect.Parameter.POSITIONAL_OR_KEYWORD)
        strange = [key for key, parameter in own.items() if parameter.kind not in named]
        if strange:
            raise InputError(f"{self.kind}={name}: takes {', '.join(strange)}; expected named arguments only")
        return own

    def build(self, name: str, arguments: Mapping[str, Any], package: str | None = None) -> Callable[..., Any]:
        """Return the class of a name with a user's plain arguments bound to it.

        Raises:
            InputError: when there is no such class or argument, or a value is not plain.
        """
        cls = self.get(name, package)
        known = self.parameters(name)
        for key, value in arguments.items():
            if key not in known:
                expected = ", ".join(known) or "no arguments"
                raise InputError(f"{self.kind}={name} has no argument {key!r}; expected {expected}")
            if not isinstance(value, bool | int | float | str | None):
                raise InputError(f"{self.kind}={name}: {key} is {value!r}; expected a number, text, true or false")
        return functools.partial(cls, **arguments)

    def _checked(self, name: str, cls: object) -> type:
        if not (isinstance(cls, type) and issubclass(cls, self.base)):
            raise InputError(f"{self.kind}={name}: {cls!r} is no {self._base_name}; expected a subclass of it")
        if inspect.isabstract(cls):
            missing = ", ".join(sorted(cls.__abstractmethods__))  # type: ignore[attr-defined]
            raise InputError(f"{self.kind}={name}: {cls.__name__} lacks {missing}")
        if not name or getattr(cls, "name", None) != name:
            raise InputError(
                f"{self.kind}={name}: {cls.__name__}.name is {getattr(cls, 'name', None)!r}; expected {name!r}"
            )
        return cls


KERNELS: Final = Registry("kernel", "geoskill.kernels.kernel:Kernel", "geoskill.kernels")
EXTRACTORS: Final = Registry("descriptor", "geoskill.features.extractor:FeatureExtractor", "geoskill.extractors")
SCORERS: Final = Registry("model", "geoskill.model.scorer:InstanceScorer", "geoskill.scorers", given=("motif",))
TASKS: Final = Registry("task", "geoskill.simulation.tasks.task:Task", "geoskill.tasks")
REGISTRIES: Final = (KERNELS, EXTRACTORS, SCORERS, TASKS)


def register(cls: type) -> type:
    """Make a kernel, descriptor, network or simulated task known by its ``name``; usable as a class decorator.

    Raises:
        InputError: when it is none of these, or its name is taken.
    """
    ancestors = {f"{base.__module__}:{base.__qualname__}" for base in cls.__mro__}
    for registry in REGISTRIES:
        if f"{registry._base_module}:{registry._base_name}" in ancestors:
            registry.register(cls)
            return cls
    raise InputError(
        f"{cls.__name__}: cannot be registered; expected a subclass of Kernel, FeatureExtractor, InstanceScorer or Task"
    )


def class_named(module: str, name: str) -> object:
    """Return the class of a module of this package that has this ``name``."""
    for value in vars(import_module(module)).values():
        if isinstance(value, type) and value.__module__ == module and value.__dict__.get("name") == name:
            return value
    raise InputError(f"{module}: no class has the name {name!r}")


def _declares_name(path: Path) -> bool:
    declaration = rf'^    name: ClassVar\[str\] = "{re.escape(path.stem)}"$'
    return re.search(declaration, path.read_text(encoding="utf-8"), re.MULTILINE) is not None
