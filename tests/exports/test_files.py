"""The files for other programs, each read back by another reader."""

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

from geoskill.control.rows import Constraint
from geoskill.errors import InputError
from geoskill.exports.exporter import open_exports
from geoskill.exports.intrinsics import IntrinsicMotion
from geoskill.exports.names import exporters_of
from geoskill.exports.record import NeutralRecord
from geoskill.exports.visp import features_of, polar_line
from tests.exports.conftest import CAMERA, DEPTH_M

Record = Callable[..., NeutralRecord]
LINES = [{"frame": 3, "rank": 1, "confidence": float("nan")}]


def written(folder: Path, name: str, motion: IntrinsicMotion | None, *records: NeutralRecord) -> None:
    with open_exports(exporters_of(name, folder)) as exports:
        for record in records:
            exports.add(record, LINES, motion)


def visjac_p(uv: np.ndarray, depth: np.ndarray, k: np.ndarray) -> np.ndarray:
    """CentralCamera.visjac_p as its documentation and the book have it (equation 15.6), written out for K."""
    rows = []
    for (u, v), z in zip(uv.T, depth, strict=True):
        x, y = (u - k[0, 2]) / k[0, 0], (v - k[1, 2]) / k[1, 1]
        rows.append(k[0, 0] * np.array([-1 / z, 0, x / z, x * y, -(1 + x * x), y]))
        rows.append(k[1, 1] * np.array([0, -1 / z, y / z, 1 + y * y, -x * y, -x]))
    return np.array(rows)


# ------------------------------------------------------------------------------------------------ toolbox


def test_toolbox_pairs_drive_the_carried_points_to_their_places(
    record_of: Record, scene: Sequence[Constraint], motion: IntrinsicMotion, tmp_path: Path
) -> None:
    record = record_of(*scene)
    written(tmp_path, "mvtb", motion, record, {**record, "frame": 4})
    with np.load(tmp_path / "mvtb.npz", allow_pickle=False) as data:
        arrays = dict(data)
    assert arrays["frame"].tolist() == [3] * 4 + [4] * 4
    assert arrays["member"].tolist()[:4] == ["m", "m", "n", "m"]
    assert arrays["Z"].tolist() == [DEPTH_M] * 8
    now = arrays["frame"] == 3
    jacobian = visjac_p(arrays["uv"][:, now], arrays["Z"][now], arrays["K"])
    ours = np.concatenate([np.array(row["jacobian"]) for row in record["rows"] if row["kernel"] == "p2p"])
    ours[2:4] *= -1  # the pair whose second point is carried
    np.testing.assert_allclose(jacobian, -ours, atol=2e-3)
    # A small step of the thing, the negative of the camera's: the points come nearer to where they are to be.
    step = -0.2 * np.linalg.pinv(jacobian) @ (arrays["uv_d"] - arrays["uv"])[:, now].flatten(order="F")
    points = CAMERA.back_project(arrays["uv"][:, now].T, arrays["Z"][now])
    moved = CAMERA.project(points + step[:3] + np.cross(step[3:], points))
    before, after = (np.linalg.norm(arrays["uv_d"][:, now].T - at) for at in (arrays["uv"][:, now].T, moved))
    assert after < 0.9 * before


def test_toolbox_without_camera_has_the_pairs_alone(
    record_of: Record, scene: Sequence[Constraint], tmp_path: Path
) -> None:
    written(tmp_path, "mvtb", None, record_of(*scene), record_of())
    with np.load(tmp_path / "mvtb.npz", allow_pickle=False) as data:
        assert sorted(data) == ["frame", "member", "time_s", "uv", "uv_d", "weight"]
        assert data["uv"].shape == data["uv_d"].shape == (2, 4)


TOOLBOX = """
import sys
import numpy as np
from machinevisiontoolbox import CentralCamera
data = np.load(sys.argv[1])
K, now = data["K"], data["frame"] == 3
camera = CentralCamera(f=0.008, rho=(0.008 / K[0, 0], 0.008 / K[1, 1]), imagesize=(640, 480), pp=(K[0, 2], K[1, 2]))
np.testing.assert_allclose(camera.K, K)
J = camera.visjac_p(data["uv"][:, now], data["Z"][now])
e = (data["uv_d"] - data["uv"])[:, now].flatten(order="F")
print(repr(J.tolist())); print(repr((0.5 * np.linalg.pinv(J) @ e).tolist()))
"""


@pytest.mark.slow
def test_toolbox_itself_reads_the_pairs(
    record_of: Record, scene: Sequence[Constraint], motion: IntrinsicMotion, tmp_path: Path
) -> None:
    """In an environment of its own, for its OpenCV is another one; GEOSKILL_TOOLBOX_PYTHON names one that is there."""
    python = os.environ.get("GEOSKILL_TOOLBOX_PYTHON")
    if python is None:
        environment = tmp_path / "venv"
        python = str(environment / "bin" / "python")
        for command in (
            [sys.executable, "-m", "venv", str(environment)],
            [
                python,
                "-m",
                "pip",
                "install",
                "--quiet",
                "--disable-pip-version-check",
                "machinevision-toolbox-python>=2,<3",
            ],
        ):
            made = subprocess.run(command, capture_output=True, text=True, check=False)
            if made.returncode != 0:
                pytest.skip(f"machinevision-toolbox-python cannot be installed: {made.stderr.strip()[-200:]}")
    written(tmp_path, "mvtb", motion, record_of(*scene))
    own = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"}
    ended = subprocess.run(
        [python, "-c", TOOLBOX, str(tmp_path / "mvtb.npz")], capture_output=True, text=True, check=False, env=own
    )
    assert ended.returncode == 0, ended.stderr
    jacobian, velocity = map(json.loads, ended.stdout.strip().splitlines()[-2:])
    with np.load(tmp_path / "mvtb.npz", allow_pickle=False) as data:
        expected = visjac_p(data["uv"], data["Z"], data["K"])
        errors = (data["uv_d"] - data["uv"]).flatten(order="F")
    np.testing.assert_allclose(jacobian, expected, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(velocity, 0.5 * np.linalg.pinv(expected) @ errors, rtol=1e-6, atol=1e-9)


# ------------------------------------------------------------------------------------------------ ROS 2


def read_bag(path: Path) -> dict[str, list[tuple[int, str, Any]]]:
    found: dict[str, list[tuple[int, str, Any]]] = {}
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        for schema, channel, message, decoded in reader.iter_decoded_messages():
            assert schema is not None
            found.setdefault(channel.topic, []).append((message.log_time, schema.name, decoded))
    return found


def test_bag_is_read_by_the_package_of_the_format(
    record_of: Record, scene: Sequence[Constraint], motion: IntrinsicMotion, tmp_path: Path
) -> None:
    record = record_of(*scene)
    record["rows"][3]["weight"] = 0.0
    used = [row for row in record["rows"] if row["weight"] > 0]
    commanded = {**record, "time_s": 0.2, "twist_frame": "base", "twist": [0.1, 0.2, 0.3, 0.4, 0.5, 0.6]}
    written(tmp_path, "ros2", motion, record, commanded)
    bag = read_bag(tmp_path / "error.mcap")
    assert {topic: len(found) for topic, found in bag.items()} == {
        "/geoskill/error": 2,
        "/geoskill/jacobian": 2,
        "/geoskill/twist": 1,
        "/geoskill/associations": 2,
    }
    time, kind, error = bag["/geoskill/error"][0]
    assert (time, kind) == (100_000_000, "std_msgs/msg/Float64MultiArray")
    assert list(error.data) == [value for row in used for value in row["error"]]
    [dimension] = error.layout.dim
    assert (dimension.label, dimension.size, dimension.stride) == (
        "m/1.0,m/1.1,m/1.0,m/1.1,n/1.0,n/1.1,l/1.0,l/1.1",
        8,
        8,
    )
    jacobian = bag["/geoskill/jacobian"][0][2]
    rows, columns = jacobian.layout.dim
    assert (rows.size, rows.stride, columns.label, columns.size, columns.stride) == (
        8,
        48,
        "x,y,z,roll,pitch,yaw",
        6,
        6,
    )
    table = np.array(jacobian.data).reshape(rows.size, columns.size)
    np.testing.assert_array_equal(table, np.concatenate([row["jacobian"] for row in used]))
    time, kind, twist = bag["/geoskill/twist"][0]
    assert (time, kind, twist.header.frame_id) == (200_000_000, "geometry_msgs/msg/TwistStamped", "base_link")
    assert (twist.header.stamp.sec, twist.header.stamp.nanosec) == (0, 200_000_000)
    assert [twist.twist.linear.y, twist.twist.angular.z] == [0.2, 0.6]
    line = json.loads(bag["/geoskill/associations"][0][2].data)
    assert line == {"frame": 3, "rank": 1, "confidence": None}


def test_bag_without_camera_has_no_jacobian(record_of: Record, scene: Sequence[Constraint], tmp_path: Path) -> None:
    record = record_of(*scene)
    for row in record["rows"]:
        row["jacobian"] = None
    written(tmp_path, "ros2", None, record)
    assert set(read_bag(tmp_path / "error.mcap")) == {"/geoskill/error", "/geoskill/associations"}


# ------------------------------------------------------------------------------------------------ ViSP


def features_in(path: Path) -> list[dict[str, Any]]:
    contents = json.loads(path.read_text(encoding="utf-8"))
    assert contents["version"] == 1
    features: list[dict[str, Any]] = contents["frames"][0]["features"]
    return features


def law(jacobian: np.ndarray, error: np.ndarray, gain: float = 0.5) -> np.ndarray:
    """The velocity of vpServo::computeControlLaw."""
    return np.asarray(-gain * np.linalg.pinv(jacobian) @ error)


def test_visp_features_are_the_rows(
    record_of: Record, scene: Sequence[Constraint], motion: IntrinsicMotion, tmp_path: Path
) -> None:
    record = record_of(*scene)
    written(tmp_path, "visp", motion, record, record_of())
    contents = json.loads((tmp_path / "visp_features.json").read_text(encoding="utf-8"))
    assert contents["camera"] == {"fx": 600.0, "fy": 610.0, "cx": 318.0, "cy": 242.0}
    assert [len(frame["features"]) for frame in contents["frames"]] == [5, 0]
    assert contents["frames"][0]["twist_frame"] == "camera"
    for feature, row in zip(contents["frames"][0]["features"], record["rows"], strict=True):
        assert (feature["dim"], feature["s"], feature["L"]) == (len(row["error"]), row["error"], row["jacobian"])
    assert ["point" in feature for feature in contents["frames"][0]["features"]] == [True, True, True, True, False]


def test_visp_line_is_the_segment_and_its_desired_one_has_the_same_normal() -> None:
    rho, theta = polar_line(np.array([[1.0, 0.0], [0.0, 1.0]]))
    assert (abs(rho), abs(np.tan(theta))) == (pytest.approx(np.sqrt(0.5)), pytest.approx(1.0))
    for x, y in ((1.0, 0.0), (0.0, 1.0), (3.0, -2.0)):
        assert x * np.cos(theta) + y * np.sin(theta) == pytest.approx(rho)


def test_visp_lines_desired_normal_is_near(
    record_of: Record, scene: Sequence[Constraint], motion: IntrinsicMotion
) -> None:
    turned = Constraint(scene[4].kernel, (scene[4].nodes[0], np.roll(scene[4].nodes[1], 2)), (True, False))
    for own in (scene[4], turned):
        line = features_of(record_of(own), motion)["features"][0]["line"]
        assert abs(line["theta"] - line["theta_d"]) < 0.2
        assert line["plane"] == [0, 0, 1, -DEPTH_M]


def test_visp_of_records_without_jacobian(record_of: Record, scene: Sequence[Constraint], tmp_path: Path) -> None:
    record = record_of(*scene)
    for row in record["rows"]:
        row["jacobian"] = None
    written(tmp_path, "visp", None, record)
    assert all(
        feature["L"] is None and "point" not in feature for feature in features_in(tmp_path / "visp_features.json")
    )


@pytest.fixture(scope="session")
def visp_law(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], list[list[float]]]:
    """ViSP's C++ library, in a program that reads features and prints the velocities of its law."""
    flags = os.environ.get("GEOSKILL_VISP_FLAGS", "-lvisp_vs -lvisp_visual_features -lvisp_core")
    program = tmp_path_factory.mktemp("visp") / "law"
    source = Path(__file__).with_name("visp_law.cpp")
    compiler = shutil.which("g++")
    command = [compiler or "", "-std=c++17", str(source), *flags.split(), "-o", str(program)]
    made = subprocess.run(command, capture_output=True, text=True, check=False) if compiler else None
    if made is None or made.returncode != 0:
        pytest.skip("no ViSP in C++; expected g++ and Debian's libvisp-vs-dev, or GEOSKILL_VISP_FLAGS")

    def velocities(features: str) -> list[list[float]]:
        ended = subprocess.run([str(program)], input=features, capture_output=True, text=True, check=True)
        return [[float(word) for word in line.split() if word != "-"] for line in ended.stdout.splitlines()[-2:]]

    return velocities


@pytest.mark.slow
def test_visp_itself_reads_the_features(
    visp_law: Callable[[str], list[list[float]]],
    record_of: Record,
    scene: Sequence[Constraint],
    motion: IntrinsicMotion,
    tmp_path: Path,
) -> None:
    """Both ways to write a pair of points give the same velocity of the thing, and it brings it nearer."""
    written(tmp_path, "visp", motion, record_of(*scene[:4]))
    features = features_in(tmp_path / "visp_features.json")
    rows, points = [], []
    for own in features:
        rows.append(" ".join(map(str, ["generic", own["dim"], *own["s"], *np.ravel(own["L"])])))
        points.append(" ".join(map(str, ["point", *(own["point"][key] for key in ("x", "y", "xd", "yd", "Z"))])))
    generic, picture = visp_law("\n".join(rows + points))
    stacked, errors = (np.concatenate([np.array(own[key]) for own in features]) for key in ("L", "s"))
    np.testing.assert_allclose(generic, law(stacked, errors), rtol=1e-6, atol=1e-9)
    scales = np.tile(1 / np.array([600.0, 610.0]), 4)  # ViSP's points are normalized
    np.testing.assert_allclose(picture, law(scales[:, None] * stacked, scales * errors), rtol=1e-4, atol=1e-6)
    assert np.linalg.norm(errors + 0.2 * stacked @ np.array(picture)) < np.linalg.norm(errors)


@pytest.mark.slow
def test_visp_itself_reads_lines(
    visp_law: Callable[[str], list[list[float]]],
    record_of: Record,
    scene: Sequence[Constraint],
    motion: IntrinsicMotion,
) -> None:
    """The velocity that it finds turns and shifts the carried line toward the resting one."""
    line = features_of(record_of(scene[4]), motion)["features"][0]["line"]
    polar = ("rho", "theta", "rho_d", "theta_d")
    _, velocity = visp_law(" ".join(map(str, ["line", *(line[key] for key in polar), *line["plane"]])))
    ends = scene[4].nodes[0].reshape(2, 2)
    moved = ends + 0.2 * motion.jacobian(ends) @ np.array(velocity)
    after = features_of(
        record_of(Constraint(scene[4].kernel, (moved.ravel(), scene[4].nodes[1]), (True, False))), motion
    )
    left = after["features"][0]["line"]
    for key in ("rho", "theta"):
        assert abs(left[key] - left[f"{key}_d"]) < 0.95 * abs(line[key] - line[f"{key}_d"])


# ------------------------------------------------------------------------------------------------ all


@pytest.mark.parametrize("given", ["rviz", 3, ["ros2", "rviz"], {"a": 1}])
def test_unknown_export_is_refused(given: Any, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"export=.*: expected ros2, visp, mvtb, or several"):
        exporters_of(given, tmp_path)


def test_without_ros2_packages(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "mcap_ros2.writer", None)
    with pytest.raises(InputError, match=r"export=ros2: needs packages .* pip install 'geoskill\[ros2\]'"):
        exporters_of(["ros2"], tmp_path)


def test_failure_leaves_no_file(record_of: Record, scene: Sequence[Constraint], tmp_path: Path) -> None:
    with (
        pytest.raises(RuntimeError, match="out of memory"),
        open_exports(exporters_of(["ros2", "visp", "mvtb", "visp"], tmp_path)) as exports,
    ):
        exports.add(record_of(*scene))
        raise RuntimeError("out of memory")
    assert list(tmp_path.iterdir()) == []
