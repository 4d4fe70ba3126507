"""Tasks of ViSP's Python bindings, which no package index has: only documented names are used, with these shapes."""

import ast
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from geoskill.control.rows import Constraint
from geoskill.errors import InputError
from geoskill.exports import visp_tasks
from geoskill.exports.intrinsics import IntrinsicMotion, interaction_matrices
from geoskill.exports.record import NeutralRecord
from geoskill.exports.visp import features_of

# Of ViSP's Python documentation (https://visp-doc.inria.fr, modules/python/doc/_autosummary of its repository).
DOCUMENTED = {
    "core": {"ColVector", "Matrix", "VelocityTwistMatrix"},
    "visual_features": {"GenericFeature", "FeaturePoint", "FeatureLine"},
    "vs": {"Servo"},
    "Servo": {
        *("setServo", "setInteractionMatrixType", "setLambda", "addFeature", "set_cVe", "set_eJe", "computeControlLaw"),
        *("EYEINHAND_CAMERA", "EYETOHAND_L_cVe_eJe", "CURRENT"),
    },
    "GenericFeature": {"set_s", "setInteractionMatrix"},
    "FeaturePoint": {"set_xyZ"},
    "FeatureLine": {"setRhoTheta", "setABCD"},
}
METHODS = set().union(*(names for key, names in DOCUMENTED.items() if key[0].isupper()))


def test_only_documented_names_are_used() -> None:
    used: dict[str, set[str]] = {}
    for node in ast.walk(ast.parse(Path(visp_tasks.__file__).read_text(encoding="utf-8"))):
        if isinstance(node, ast.Attribute):
            used.setdefault(ast.unparse(node.value), set()).add(node.attr)
    for module in ("core", "visual_features", "vs"):
        assert used[module] <= DOCUMENTED[module]
    for name in ("task", "vs.Servo", "feature", "present", "desired"):
        assert used[name] <= METHODS, name


class Feature:
    """What the bindings' features take, checked as they do: columns of d and matrices of d x 6, of float64."""

    def __init__(self, dim: int = 2) -> None:
        self.dim = dim

    def set_s(self, s: np.ndarray) -> None:
        assert s.shape == (self.dim,)
        self.s = s

    def setInteractionMatrix(self, matrix: np.ndarray) -> None:
        assert matrix.shape == (self.dim, 6)
        self.matrix = matrix


class Point(Feature):
    """vpFeaturePoint: x, y and their interaction matrix with a moving camera."""

    def set_xyZ(self, x: float, y: float, z: float) -> None:
        self.set_s(np.array([x, y]))
        self.setInteractionMatrix(interaction_matrices(np.array([[x, y]]), np.array([z]))[0])


class Servo:
    """vpServo's law, v = -lambda (sign L)+ (s - s*), of which signs are those of setServo."""

    EYEINHAND_CAMERA, EYETOHAND_L_cVe_eJe, CURRENT = 1, -1, 0

    def __init__(self) -> None:
        self.features: list[tuple[Feature, np.ndarray]] = []

    def setServo(self, kind: int) -> None:
        self.sign = kind

    def setInteractionMatrixType(self, kind: int) -> None:
        assert kind == self.CURRENT

    def setLambda(self, gain: float) -> None:
        self.gain = gain

    def set_cVe(self, matrix: Any) -> None:
        assert matrix == "identity"

    def set_eJe(self, matrix: np.ndarray) -> None:
        np.testing.assert_array_equal(matrix, np.eye(6))

    def addFeature(self, present: Feature, desired: Feature | None = None) -> None:
        self.features.append((present, np.zeros(present.dim) if desired is None else desired.s))

    def computeControlLaw(self) -> np.ndarray:
        matrix = np.concatenate([self.sign * own.matrix for own, _ in self.features])
        errors = np.concatenate([own.s - goal for own, goal in self.features])
        return np.asarray(-self.gain * np.linalg.pinv(matrix) @ errors)


@pytest.fixture
def bindings(monkeypatch: pytest.MonkeyPatch) -> None:
    """In place of the bindings: the documented classes that are used, with numpy's arrays."""

    def array(dimensions: int) -> Callable[[np.ndarray], np.ndarray]:
        def checked(values: np.ndarray) -> np.ndarray:
            assert values.dtype == np.float64
            assert values.ndim == dimensions
            return values

        return checked

    parts: dict[str, dict[str, Any]] = {
        "core": {"ColVector": array(1), "Matrix": array(2), "VelocityTwistMatrix": lambda: "identity"},
        "visual_features": {"GenericFeature": Feature, "FeaturePoint": Point},
        "vs": {"Servo": Servo},
    }
    package = ModuleType("visp")
    for name, contents in parts.items():
        module = ModuleType(f"visp.{name}")
        vars(module).update(contents)
        setattr(package, name, module)
    monkeypatch.setitem(sys.modules, "visp", package)


@pytest.mark.usefixtures("bindings")
def test_both_tasks_give_the_velocity_of_the_carried_thing(
    record_of: Callable[..., NeutralRecord], scene: Sequence[Constraint], motion: IntrinsicMotion
) -> None:
    record = record_of(*scene[:4])
    record["rows"][3]["weight"] = 0.0  # not to be used
    record["rows"][0]["weight"] = 0.25
    frame = features_of(record, motion)
    task, kept = visp_tasks.generic_task(frame, gain=0.4)
    roots = np.repeat([0.5, 1.0, 1.0], 2)
    stacked = roots[:, None] * np.concatenate([row["jacobian"] for row in record["rows"][:3]])
    errors = roots * np.concatenate([row["error"] for row in record["rows"][:3]])
    np.testing.assert_allclose(task.computeControlLaw(), -0.4 * np.linalg.pinv(stacked) @ errors, rtol=1e-6)
    assert len(kept) == 3
    task, kept = visp_tasks.picture_task(frame, gain=0.4)
    scales = np.tile(1 / np.array([600.0, 610.0]), 3)
    pairs = np.concatenate([row["jacobian"] for row in record["rows"][:3]])
    plain = np.concatenate([row["error"] for row in record["rows"][:3]])
    wanted = -0.4 * np.linalg.pinv(scales[:, None] * pairs) @ (scales * plain)
    np.testing.assert_allclose(task.computeControlLaw(), wanted, rtol=1e-4)
    assert len(kept) == 6


@pytest.mark.usefixtures("bindings")
def test_frames_without_camera_are_refused(
    record_of: Callable[..., NeutralRecord], scene: Sequence[Constraint]
) -> None:
    record = record_of(scene[0])
    record["rows"][0]["jacobian"] = None
    frame = features_of(record)
    with pytest.raises(InputError, match="frame 3 has no L; expected an export with intrinsics=FILE"):
        visp_tasks.generic_task(frame)
    with pytest.raises(InputError, match="frame 3 has no point and no line; expected an export with intrinsics=FILE"):
        visp_tasks.picture_task(frame)


def test_without_visp() -> None:
    with pytest.raises(InputError, match="visp is not installed; expected ViSP's Python bindings"):
        visp_tasks.generic_task({"features": []})
