"""Registries of kernels, descriptors, networks and simulated tasks, by the name used on the command line.

A name comes from one of three places: a file of this package whose class has the file's name as its ``name``, an entry
point of an installed package (groups ``geoskill.kernels``, ``geoskill.extractors``, ``geoskill.scorers``,
``geoskill.tasks``), or :func:`register`. Checkpoints store names, plain arguments and the package that provides the
class, never a module path: only what is installed here can be built from a checkpoint.
"""

import functools
import hashlib
import inspect
import re
from collections.abc import Callable, Mapping
from dataclasses import Field, field
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points, packages_distributions
from importlib.util import find_spec
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, Final, TypeVar, Union, final, get_args, get_origin, get_type_hints
from uuid import uuid4

from geoskill.errors import InputError
from geoskill.schema import check_value

OWN_PACKAGE: Final = "geoskill"
SCRIPT: Final = "__main__"
"""Module, and so in place of a package, of classes that a script or notebook registers."""

NAME: Final = re.compile(r"[a-z][a-z0-9_]*")
"""Names are parts of Hydra's overrides and of the keys of a checkpoint's weights."""

PACKAGE: Final = re.compile(r"[A-Za-z0-9_]([A-Za-z0-9._-]*[A-Za-z0-9_])?")
"""Packages as the package index names them, and modules."""

PLAIN: Final = (bool, int, float, str, NoneType)
_PROCESS: Final = uuid4().hex

C = TypeVar("C", bound=type)


@final
class Registry:
    """The classes of one kind, by name.

    Args:
        kind: what a class is called in messages and on the command line, such as ``kernel``.
        base: the abstract base class, as ``MODULE:CLASS``; built-in classes are files of that module's package.
        group: the group of entry points, such as ``geoskill.kernels``.
        given: arguments that this package passes to the constructor itself.
        reserved: names of other choices on the command line.
    """

    def __init__(
        self, kind: str, base: str, group: str, given: tuple[str, ...] = (), reserved: tuple[str, ...] = ()
    ) -> None:
        self.kind = kind
        self.group = group
        self.given = given
        self.reserved = reserved
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
        """Entry points of installed packages by name; names that are taken or malformed are left out."""
        taken = {*self.built_in, *self.reserved}
        points = [own for own in entry_points(group=self.group) if NAME.fullmatch(own.name) and own.name not in taken]
        return {point.name: point for point in reversed(points)}  # of rivals the first on the path, as for modules

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
            rivals = {own.dist.name for own in entry_points(group=self.group, name=name) if own.dist is not None}
            if len(rivals) > 1:
                raise InputError(f"{self.kind}={name}: provided by {', '.join(sorted(rivals))}; expected one package")
            try:
                cls = point.load()
            except (Exception, SystemExit) as error:  # whatever somebody else's package raises while it is imported
                raise InputError(
                    f"{self.kind}={name}: the plug-in {point.value} cannot be loaded ({type(error).__name__}: {error})"
                ) from error
            return self._checked(name, cls)
        if package == SCRIPT:
            raise InputError(f"{self.kind}={name}: registered by the script that learned it; register it here too")
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
        point = self.plug_ins.get(name)
        if point is not None and point.value == f"{cls.__module__}:{cls.__qualname__}":
            return  # a plug-in that registers itself too
        if name in (*self.built_in, *self.reserved) or point is not None:
            raise InputError(f"{self.kind}={name}: the name is taken; expected another one")
        self._registered[name] = cls

    def provider(self, name: str) -> str:
        """Return the package to install for a name."""
        if name in self.built_in:
            return OWN_PACKAGE
        point = None if name in self._registered else self.plug_ins.get(name)
        if point is not None and point.dist is not None:
            return point.dist.name
        top = self.get(name).__module__.partition(".")[0]
        return next(iter(packages_distributions().get(top, [top])))

    def parameters(self, name: str) -> Mapping[str, inspect.Parameter]:
        """Return the arguments that a user may give to the class of this name; their annotations are types.

        Raises:
            InputError: when there is no such class, or it takes arguments that cannot be written down.
        """
        cls = self.get(name)
        try:
            found = inspect.signature(cls).parameters
        except (TypeError, ValueError) as error:
            raise InputError(f"{self.kind}={name}: the arguments of {cls.__name__} are not known ({error})") from error
        try:
            hints = get_type_hints(cls.__init__)  # type: ignore[misc]  # the constructor of a class, not of an object
        except Exception:  # such as a type that only a type checker imports
            hints = {}
        own = {key: parameter for key, parameter in found.items() if key not in self.given}
        return {key: self._plain(name, parameter, hints.get(key, Any)) for key, parameter in own.items()}

    def build(self, name: str, arguments: Mapping[str, Any], package: str | None = None) -> Callable[..., Any]:
        """Return the class of a name with a user's plain arguments bound to it.

        Raises:
            InputError: when there is no such class or argument, a value is not plain or of another type than the
                constructor declares, or an argument without default is missing.
        """
        cls = self.get(name, package)
        known = self.parameters(name)
        for key, value in arguments.items():
            if key not in known:
                expected = ", ".join(known) or "no arguments"
                raise InputError(f"{self.kind}={name} has no argument {key!r}; expected {expected}")
            if not isinstance(value, PLAIN):
                raise InputError(f"{self.kind}={name}: {key} is {value!r}; expected a number, text, true or false")
            self._check_type(name, key, value, known[key].annotation)
        missing = [key for key, own in known.items() if own.default is own.empty and key not in arguments]
        if missing:
            raise InputError(f"{self.kind}={name}: expected a value for {', '.join(missing)}")
        return functools.partial(cls, **arguments)

    def _plain(self, name: str, parameter: inspect.Parameter, hint: Any) -> inspect.Parameter:
        """Return an argument of a class with the type that its value must have, or Any, for its annotation."""
        if parameter.kind not in (parameter.KEYWORD_ONLY, parameter.POSITIONAL_OR_KEYWORD) or parameter.name == "name":
            raise InputError(f"{self.kind}={name}: takes {parameter}; expected named arguments, none called name")
        allowed = get_args(hint) if get_origin(hint) in (Union, UnionType) else (hint,)
        hint = hint if all(kind in PLAIN for kind in allowed) else Any
        if parameter.default is None and hint is not Any:
            hint |= None
        elif parameter.default is not parameter.empty:
            if not isinstance(parameter.default, PLAIN):
                raise InputError(f"{self.kind}={name}: takes {parameter}; expected a number, text, true, false or None")
            self._check_type(name, parameter.name, parameter.default, hint)
        return parameter.replace(annotation=hint)

    def _check_type(self, name: str, key: str, value: object, hint: Any) -> None:
        unlimited: Field[Any] = field()
        check_value(f"{self.kind}={name}: {key}", value, unlimited, hint)

    def _checked(self, name: str, cls: object) -> type:
        if not (isinstance(cls, type) and issubclass(cls, self.base)):
            raise InputError(f"{self.kind}={name}: {cls!r} is no {self._base_name}; expected a subclass of it")
        if inspect.isabstract(cls):
            missing = ", ".join(sorted(cls.__abstractmethods__))  # type: ignore[attr-defined]
            raise InputError(f"{self.kind}={name}: {cls.__name__} lacks {missing}")
        if not NAME.fullmatch(name):
            raise InputError(f"{self.kind}={name}: expected a name of small letters, digits and underscores")
        if getattr(cls, "name", None) != name:
            raise InputError(
                f"{self.kind}={name}: {cls.__name__}.name is {getattr(cls, 'name', None)!r}; expected {name!r}"
            )
        return cls


KERNELS: Final = Registry("kernel", "geoskill.kernels.kernel:Kernel", "geoskill.kernels", reserved=("p2p_l2l", "auto"))
EXTRACTORS: Final = Registry("descriptor", "geoskill.features.extractor:FeatureExtractor", "geoskill.extractors")
SCORERS: Final = Registry(
    "model",
    "geoskill.model.scorer:InstanceScorer",
    "geoskill.scorers",
    given=("motif",),
    reserved=("default", "paper"),
)
TASKS: Final = Registry("task", "geoskill.simulation.tasks.task:Task", "geoskill.tasks", reserved=("video",))
REGISTRIES: Final = (KERNELS, EXTRACTORS, SCORERS, TASKS)


def register(cls: C) -> C:
    """Make a kernel, descriptor, network or simulated task known by its ``name``; usable as a class decorator.

    Raises:
        InputError: when it is none of these, or its name is taken.
    """
    ancestors = {f"{base.__module__}:{base.__qualname__}" for base in getattr(cls, "__mro__", ())}
    for registry in REGISTRIES:
        if f"{registry._base_module}:{registry._base_name}" in ancestors:
            registry.register(cls)
            return cls
    shown = getattr(cls, "__name__", repr(cls))
    raise InputError(
        f"{shown}: cannot be registered; expected a subclass of Kernel, FeatureExtractor, InstanceScorer or Task"
    )


def class_named(module: str, name: str) -> object:
    """Return the class of a module of this package that has this ``name``."""
    for value in vars(import_module(module)).values():
        if isinstance(value, type) and value.__module__ == module and value.__dict__.get("name") == name:
            return value
    raise InputError(f"{module}: no class has the name {name!r}")


def code_identity(cls: type) -> str:
    """Return what the results of a class depend on beside its arguments, for the keys of caches.

    Nothing for classes of this package, whose caches have versions; a digest of the file of others; where there is no
    file, as for a class of a notebook, a text that only this process has.
    """
    if cls.__module__.partition(".")[0] == OWN_PACKAGE:
        return ""
    try:
        return hashlib.sha256(Path(inspect.getfile(cls)).read_bytes()).hexdigest()
    except (OSError, TypeError):
        return _PROCESS


def _declares_name(path: Path) -> bool:
    declaration = rf'^    name: ClassVar\[str\] = "{re.escape(path.stem)}"$'
    return re.search(declaration, path.read_text(encoding="utf-8"), re.MULTILINE) is not None
