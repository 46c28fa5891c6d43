"""The files of a LeRobot dataset, format v3.0, written episode by episode.

LeRobot's own writer needs torch and Hugging Face's datasets, 5 GB and more, for tables that pyarrow
writes as well. Whether it reads these is found out by the package itself (`make lerobot`).
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from taskspec_runner.dataset.features import CAMERA, EPISODE, INDEX, TASK, Feature, FrameLayout
from taskspec_runner.dataset.statistics import Statistics, statistics

#: Of the format.
VERSION = "v3.0"
_CHUNK = "chunk-{chunk_index:03d}/file-{file_index:03d}"
_DATA, _VIDEO = f"data/{_CHUNK}.parquet", f"videos/{{video_key}}/{_CHUNK}.mp4"
_EPISODES = f"meta/episodes/{_CHUNK}.parquet"
#: Of LeRobot's own writer: files of a folder, and sizes that a file should not exceed [MB].
_FILES, _DATA_SIZE, _VIDEO_SIZE = 1000, 100, 200
#: Logs of all ticks, which LeRobot leaves alone.
LOGS = "log"

Columns = Mapping[str, NDArray[Any]]


class DatasetWriter:
    """Writes a dataset into an empty folder.

    Attributes:
        root: the folder.
        layout: of the frames.
        frames: that are written.
        tasks: what episodes do, in words.
    """

    def __init__(self, root: Path, layout: FrameLayout) -> None:
        self.root, self.layout, self.frames = root, layout, 0
        self.tasks: list[str] = []
        self._features = {feature.name: feature for feature in layout}
        stored = [pa.field(f.name, f.type) for f in layout if f.stored]
        self._schema = pa.schema(stored)
        self._episodes: list[dict[str, Any]] = []
        self._file, self._writer = 0, self._opened(0)

    @property
    def episodes(self) -> int:
        """How many are written."""
        return len(self._episodes)

    def video_path(self) -> Path:
        """Of the next episode's video, which has a file of its own."""
        path = self.root / _VIDEO.format(video_key=CAMERA, **_place(self.episodes))
        path.parent.mkdir(parents=True, exist_ok=True)
        return path

    def log_path(self) -> Path:
        """Of the next episode's log."""
        path = self.root / LOGS / f"episode-{self.episodes:06d}.parquet"
        path.parent.mkdir(exist_ok=True)
        return path

    def add(
        self,
        columns: Columns,
        task: str,
        facts: Mapping[str, Any],
        pictures: Statistics | None = None,
    ) -> None:
        """Writes the frames of the next episode.

        Args:
            columns: (n, ...) by the names of features, but for those that number tasks, episodes
                and the frames of all of them.
            task: what it does, in words.
            facts: further entries of its row in the table of episodes.
            pictures: statistics of its video; None without one.
        """
        if task not in self.tasks:
            self.tasks.append(task)
        number, count = self.episodes, len(next(iter(columns.values())))
        indices = {
            EPISODE: np.full(count, number),
            INDEX: self.frames + np.arange(count),
            TASK: np.full(count, self.tasks.index(task)),
        }
        whole = {**columns, **indices}
        self._writer.write_table(self._table(whole))
        found = {name: statistics(whole[name]) for name in self._numeric()}
        row: dict[str, Any] = {
            "episode_index": number,
            "tasks": [task],
            "length": count,
            **{f"data/{key}": value for key, value in _place(self._file).items()},
            "dataset_from_index": self.frames,
            "dataset_to_index": self.frames + count,
        }
        if pictures is not None:
            found[CAMERA] = pictures
            end = count / self.layout.fps
            video = {**_place(number), "from_timestamp": 0.0, "to_timestamp": end}
            row |= {f"videos/{CAMERA}/{key}": value for key, value in video.items()}
        row |= {
            f"stats/{name}/{each}": values
            for name, stats in found.items()
            for each, values in stats.items()
        }
        at = {f"meta/episodes/{key}": value for key, value in _place(0).items()}
        self._episodes.append({**row, **facts, **at})
        self.frames += count
        if self._path(self._file).stat().st_size >= _DATA_SIZE * 2**20:
            self._writer.close()
            self._file += 1
            self._writer = self._opened(self._file)

    def finish(self, pictures: Statistics | None) -> None:
        """Writes what is known of all episodes.

        Args:
            pictures: statistics of all videos; None without any.
        """
        self._writer.close()
        if self._file and not pq.read_metadata(self._path(self._file)).num_rows:
            self._path(self._file).unlink()
        stats = {name: statistics(values) for name, values in self._read_back()}
        if pictures is not None:
            stats[CAMERA] = pictures
        self._write_json("meta/stats.json", stats)
        self._write_json("meta/info.json", self._info())
        pq.write_table(_task_table(self.tasks), self.root / "meta/tasks.parquet")
        path = self.root / _EPISODES.format(**_place(0))
        path.parent.mkdir(parents=True)
        pq.write_table(_episode_table(self._episodes), path)
        (self.root / "README.md").write_text(self._card(), encoding="utf-8")

    def _numeric(self) -> Iterator[str]:
        for feature in self._features.values():
            if feature.numeric:
                yield feature.name

    def _path(self, file: int) -> Path:
        return self.root / _DATA.format(**_place(file))

    def _opened(self, file: int) -> pq.ParquetWriter:
        path = self._path(file)
        path.parent.mkdir(parents=True, exist_ok=True)
        return pq.ParquetWriter(path, self._schema)

    def _table(self, columns: Columns) -> pa.Table:
        """The frames of an episode, as a group of rows."""
        arrays = [_array(columns[field.name], self._features[field.name]) for field in self._schema]
        return pa.Table.from_arrays(arrays, schema=self._schema)

    def _read_back(self) -> Iterator[tuple[str, NDArray[Any]]]:
        """Each column of numbers of all frames; one at a time is in memory."""
        paths = [self._path(file) for file in range(self._file + 1)]
        for name in self._numeric():
            tables = [pq.read_table(path, columns=[name]) for path in paths if path.exists()]
            values = pa.concat_tables(tables).column(name).combine_chunks()
            while pa.types.is_list(values.type) or pa.types.is_fixed_size_list(values.type):
                values = values.flatten()
            shape = self._features[name].shape
            flat = values.to_numpy(zero_copy_only=False)
            yield name, flat.reshape(-1, *shape)

    def _info(self) -> dict[str, Any]:
        features = {name: feature.as_data() for name, feature in self._features.items()}
        if CAMERA in features:
            features[CAMERA]["info"] = self._video()
        return {
            "codebase_version": VERSION,
            "robot_type": self.layout.robot,
            "total_episodes": self.episodes,
            "total_frames": self.frames,
            "total_tasks": len(self.tasks),
            "chunks_size": _FILES,
            "data_files_size_in_mb": _DATA_SIZE,
            "video_files_size_in_mb": _VIDEO_SIZE,
            "fps": self.layout.fps,
            "splits": {"train": f"0:{self.episodes}"},
            "data_path": _DATA,
            "video_path": _VIDEO if CAMERA in features else None,
            "features": features,
        }

    def _video(self) -> dict[str, Any]:
        """What `info.json` says of the videos, which are those of `video.encoder`."""
        height, width, channels = self._features[CAMERA].shape
        return {
            "video.height": height,
            "video.width": width,
            "video.codec": "h264",
            "video.pix_fmt": "yuv420p",
            "video.fps": self.layout.fps,
            "video.channels": channels,
            "has_audio": False,
            "is_depth_map": False,
        }

    def _card(self) -> str:
        """A page for who finds the dataset alone."""
        layout = self.layout
        rows = [f"| `{each.name}` | {each.dtype} {_size(each)} | {each.meaning} |"
                for each in self._features.values()]  # fmt: skip
        return "\n".join(
            [
                "---",
                "task_categories: [robotics]",
                "tags: [LeRobot]",
                "configs: [{config_name: default, data_files: data/*/*.parquet}]",
                "---",
                f"Runs of taskspec on {layout.robot}: {self.episodes}, in {self.frames} frames at "
                f"{layout.fps} a second. Forces and moments are what the robot applies. "
                f"`{LOGS}/episode-NNNNNN.parquet` has every tick of an episode at {layout.rate:g} "
                f"Hz with units of its columns; `log_row` is the row of a frame there.",
                "",
                "| feature | numbers | what |",
                "| --- | --- | --- |",
                *rows,
                "",
            ]
        )

    def _write_json(self, name: str, content: Mapping[str, Any]) -> None:
        path = self.root / name
        path.parent.mkdir(exist_ok=True)
        path.write_text(json.dumps(content, indent=4) + "\n", encoding="utf-8")


def _place(file: int) -> dict[str, int]:
    """The number of a file as the format has it: a folder, and one in it."""
    return {"chunk_index": file // _FILES, "file_index": file % _FILES}


def _size(feature: Feature) -> str:
    return "x".join(map(str, feature.shape))


def _array(values: NDArray[Any], feature: Feature) -> pa.Array:
    """A column of frames."""
    flat = pa.array(values.reshape(-1))
    kind = feature.type
    if pa.types.is_fixed_size_list(kind):
        return pa.FixedSizeListArray.from_arrays(flat, kind.list_size)
    if pa.types.is_list(kind):
        n, rows, size = values.shape
        inner = pa.ListArray.from_arrays(np.arange(n * rows + 1, dtype=np.int32) * size, flat)
        return pa.ListArray.from_arrays(np.arange(n + 1, dtype=np.int32) * rows, inner)
    return flat.cast(kind)


def _episode_table(rows: Sequence[Mapping[str, Any]]) -> pa.Table:
    """A row an episode; a number that no episode has is a number all the same."""
    table = pa.Table.from_pylist(rows)
    kinds = [pa.int64() if pa.types.is_null(field.type) else field.type for field in table.schema]
    return table.cast(pa.schema([*zip(table.column_names, kinds, strict=True)]))


def _task_table(tasks: Sequence[str]) -> pa.Table:
    """The tasks with their numbers; pandas, by which LeRobot reads them, has the texts as index."""
    table = pa.table({TASK: pa.array(range(len(tasks)), pa.int64()), "task": pa.array(tasks)})
    entry = {"metadata": None}
    index = {"name": None, "field_name": None, "pandas_type": "unicode", "numpy_type": "object"}
    number = {"name": TASK, "field_name": TASK, "pandas_type": "int64", "numpy_type": "int64"}
    text = {"name": "task", "field_name": "task", "pandas_type": "unicode", "numpy_type": "object"}
    said = {
        "index_columns": ["task"],
        "column_indexes": [index | {"metadata": {"encoding": "UTF-8"}}],
        "columns": [number | entry, text | entry],
        "creator": {"library": "pyarrow", "version": pa.__version__},
        "pandas_version": "2.0.0",
    }
    return table.replace_schema_metadata({"pandas": json.dumps(said)})
