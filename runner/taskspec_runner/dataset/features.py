"""What a frame of a dataset holds: names, shapes and meanings of its features."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from taskspec.deferred import pa
from taskspec.deferred_methods import dataclass
from taskspec.geometry.axis import AXES

STATE, WRENCH, ACTION = "observation.state", "observation.wrench", "action"
DONE, SUCCESS = "next.done", "next.success"
STAGE, ROW = "stage", "log_row"
TIMESTAMP, FRAME, EPISODE, INDEX, TASK = (
    "timestamp",
    "frame_index",
    "episode_index",
    "index",
    "task_index",
)
CAMERA = "observation.images.camera"

#: Of a pose: place [m], then the first two columns of the rotation matrix. Where the tool points
#: straight down, which is the usual case, a rotation vector and Euler angles jump.
POSE = ("x", "y", "z", "r11", "r21", "r31", "r12", "r22", "r32")
EFFORT = tuple(f"{axis.effort}.{axis}" for axis in AXES)


@dataclass(frozen=True, slots=True)
class Feature:
    """A column of the frames.

    Attributes:
        name: of the column.
        dtype: of its numbers, or `string`, or `video`.
        shape: of one frame's.
        names: of its numbers, or of its axes; None without.
        meaning: in words, with units, for who reads the dataset alone.
    """

    name: str
    dtype: str
    shape: tuple[int, ...]
    names: tuple[str, ...] | None
    meaning: str

    @property
    def numeric(self) -> bool:
        """Whether it is a column of numbers, which has statistics."""
        return self.dtype not in ("string", "video")

    @property
    def stored(self) -> bool:
        """Whether it is a column of the table."""
        return self.dtype != "video"

    @property
    def type(self) -> pa.DataType:
        """The type of the column: as LeRobot writes it."""
        plain = getattr(pa, {"bool": "bool_"}.get(self.dtype, self.dtype))()
        if self.shape == (1,):
            return plain
        if len(self.shape) == 1:
            return pa.list_(plain, self.shape[0])
        return pa.list_(pa.list_(plain))

    def as_data(self) -> dict[str, Any]:
        """What `info.json` says of it."""
        names = None if self.names is None else [*self.names]
        return {"dtype": self.dtype, "shape": [*self.shape], "names": names}


@dataclass(frozen=True, slots=True)
class FrameLayout:
    """The frames of a dataset.

    Attributes:
        robot: its name.
        joints: how many.
        rate: of the log [Hz].
        fps: frames a second.
        live: columns of the params that may be set while a stage runs.
        camera: height and width of a picture [px]; None without.
    """

    robot: str
    joints: int
    rate: float
    fps: int
    live: tuple[str, ...] = ()
    camera: tuple[int, int] | None = None

    @property
    def window(self) -> int:
        """Samples of the wrench in a frame: so many that none between two frames is missing."""
        return -int(-(self.rate / self.fps - 1e-9) // 1)

    def __iter__(self) -> Iterator[Feature]:
        """Every feature, in the order of the columns."""
        joints = range(1, self.joints + 1)
        state = (
            *(f"joint.{i}.position" for i in joints),
            *(f"joint.{i}.velocity" for i in joints),
            *(f"tip.{each}" for each in POSE),
            *EFFORT,
        )
        action = (*(f"tip.{each}" for each in POSE), *EFFORT, *self.live)
        window = self.window
        yield Feature(
            STATE,
            "float32",
            (len(state),),
            state,
            "joint positions and velocities [rad, rad/s; m, m/s], the pose of the tool's tip in "
            "the world [m, first two columns of its rotation matrix], and the newest measured "
            "wrench [N, N*m]",
        )
        yield Feature(
            WRENCH,
            "float32",
            (window, len(EFFORT)),
            ("sample", "axis"),
            f"the newest {window} samples of the measured wrench at {self.rate:g} Hz, oldest "
            f"first, the last one of the frame itself: {', '.join(EFFORT)} [N, N*m], which the "
            "robot applies, about the tool's tip in the tool's axes; before the episode its first "
            "sample stands",
        )
        yield Feature(
            ACTION,
            "float32",
            (len(action),),
            action,
            "what was commanded at the frame: the reference pose of the tool's tip in the world, "
            "as in the state, the set point of the wrench in the tool's axes, 0 on axes that have "
            "none, and the values of live params in SI",
        )
        yield Feature(DONE, "bool", (1,), None, "the frame is the last one of its episode")
        yield Feature(
            SUCCESS, "bool", (1,), None, "it is, and the run met what its task file expects"
        )
        yield Feature(STAGE, "string", (1,), None, "the stage of the task")
        yield Feature(ROW, "int64", (1,), None, "the frame's row in the log of its episode")
        if self.camera is not None:
            shape, names = (*self.camera, 3), ("height", "width", "channels")
            yield Feature(CAMERA, "video", shape, names, "a camera that stands still")
        yield Feature(TIMESTAMP, "float32", (1,), None, "frame_index / fps [s]")
        for name, meaning in (
            (FRAME, "number of the frame in its episode"),
            (EPISODE, "number of the episode"),
            (INDEX, "number of the frame in the dataset"),
            (TASK, "number of the task in meta/tasks.parquet"),
        ):
            yield Feature(name, "int64", (1,), None, meaning)
