"""A bag of ROS 2, written without ROS: ``error.mcap``.

=========================  ================================  ======================================================
topic                      type                              what
=========================  ================================  ======================================================
/geoskill/error            std_msgs/msg/Float64MultiArray    what is to become zero, the rows that are used one after
                                                             another; the label of the dimension names them
/geoskill/jacobian         std_msgs/msg/Float64MultiArray    their derivative, rows by degrees of freedom
/geoskill/twist            geometry_msgs/msg/TwistStamped    what is commanded, for moveit_servo's delta_twist_cmds
/geoskill/associations     std_msgs/msg/String               a line of associations.jsonl
=========================  ================================  ======================================================

Times count from 1970, so that the first frame of a recording is at 0. Source of the definitions: ROS 2's std_msgs,
geometry_msgs and builtin_interfaces.
"""

import json
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any, Final, final

from geoskill.errors import missing_extra
from geoskill.exports.exporter import Exporter, finite
from geoskill.exports.intrinsics import IntrinsicMotion
from geoskill.exports.record import CAMERA, NeutralRecord
from geoskill.io.atomic import atomic_open

FILE: Final = "error.mcap"
FRAME_IDS: Final = {CAMERA: "camera"}
"""Frame of a twist as ROS names it; that of the robot's base otherwise."""
ROBOT_BASE: Final = "base_link"
_RULE = "=" * 80
_ARRAY = f"""MultiArrayLayout layout
float64[] data
{_RULE}
MSG: std_msgs/MultiArrayLayout
MultiArrayDimension[] dim
uint32 data_offset
{_RULE}
MSG: std_msgs/MultiArrayDimension
string label
uint32 size
uint32 stride"""
_TWIST = f"""std_msgs/Header header
Twist twist
{_RULE}
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
{_RULE}
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
{_RULE}
MSG: geometry_msgs/Twist
Vector3 linear
Vector3 angular
{_RULE}
MSG: geometry_msgs/Vector3
float64 x
float64 y
float64 z"""
_STRING = "string data"


@final
class BagExporter(Exporter):
    """Writes the messages of each frame as they come.

    Args:
        folder: of the run.

    Raises:
        InputError: when the packages of the extra ``ros2`` are not installed.
    """

    def __init__(self, folder: Path) -> None:
        try:
            from mcap_ros2.writer import Writer
        except ImportError:
            raise missing_extra("export=ros2", "ros2") from None
        self._new_writer: Any = Writer
        self._path = folder / FILE
        self._stack = ExitStack()
        self._writer: Any = None
        self._schemas: dict[str, Any] = {}

    def __enter__(self) -> "BagExporter":
        """Begin the bag."""
        file = self._stack.enter_context(atomic_open(self._path, "wb"))
        self._writer = self._new_writer(file)
        self._schemas = {
            "array": self._writer.register_msgdef("std_msgs/msg/Float64MultiArray", _ARRAY),
            "twist": self._writer.register_msgdef("geometry_msgs/msg/TwistStamped", _TWIST),
            "string": self._writer.register_msgdef("std_msgs/msg/String", _STRING),
        }
        return self

    def add(
        self,
        record: NeutralRecord,
        associations: Sequence[Mapping[str, Any]] = (),
        motion: IntrinsicMotion | None = None,
    ) -> None:
        """See :meth:`Exporter.add`."""
        nanoseconds = round(record["time_s"] * 1e9)
        for topic, kind, message in messages_of(record, associations):
            self._writer.write_message(topic, self._schemas[kind], message, nanoseconds, nanoseconds, record["frame"])

    def __exit__(self, *error: Any) -> None:
        """End the bag, or leave nothing after an error."""
        if self._writer is not None and error[0] is None:
            self._writer.finish()
        self._stack.__exit__(*error)


def messages_of(
    record: NeutralRecord, associations: Sequence[Mapping[str, Any]] = ()
) -> list[tuple[str, str, dict[str, Any]]]:
    """Return the messages of a frame: topic, kind and content.

    Args:
        record: of the frame.
        associations: the frame's lines of ``associations.jsonl``.
    """
    rows = [row for row in record["rows"] if row["weight"] > 0]
    errors = [value for row in rows for value in row["error"]]
    label = ",".join(f"{row['member']}/{row['rank']}.{index}" for row in rows for index in range(len(row["error"])))
    found = [("/geoskill/error", "array", _array(errors, (label, len(errors))))]
    if rows and all(row["jacobian"] is not None for row in rows):
        values = [value for row in rows for line in row["jacobian"] for value in line]
        columns = (",".join(record["dof"]), len(record["dof"]))
        found.append(("/geoskill/jacobian", "array", _array(values, (label, len(errors)), columns)))
    if record["twist"] is not None:
        seconds, nanoseconds = divmod(round(record["time_s"] * 1e9), 10**9)
        header = {
            "stamp": {"sec": seconds, "nanosec": nanoseconds},
            "frame_id": FRAME_IDS.get(record["twist_frame"], ROBOT_BASE),
        }
        linear, angular = record["twist"][:3], record["twist"][3:]
        twist = {
            "linear": dict(zip("xyz", linear, strict=True)),
            "angular": dict(zip("xyz", angular, strict=True)),
        }
        found.append(("/geoskill/twist", "twist", {"header": header, "twist": twist}))
    lines = (json.dumps(finite(dict(line))) for line in associations)
    return [*found, *(("/geoskill/associations", "string", {"data": line}) for line in lines)]


def _array(values: Sequence[float], *dimensions: tuple[str, int]) -> dict[str, Any]:
    """Return a message of an array; each dimension has a label and a size, the last one is contiguous."""
    layout, stride = [], 1
    for label, size in reversed(dimensions):
        stride *= size
        layout.append({"label": label, "size": size, "stride": stride})
    return {"layout": {"dim": layout[::-1], "data_offset": 0}, "data": list(values)}
