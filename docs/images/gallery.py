"""Makes the pictures of the gallery of tasks again: `python docs/images/gallery.py [NAME...]`.

Of each shipped task `tasks/NAME.svg`, the picture of `taskspec explain --picture`, and the small
`tasks/NAME.webp`, its scene alone. No OpenGL is needed.
"""

from __future__ import annotations

import io
import sys
from pathlib import Path

from PIL import Image

from taskspec.examination import examine
from taskspec.spec import load_task
from taskspec_runner.preview import TaskPicture

HERE = Path(__file__).resolve().parent
TASKS = HERE.parent.parent / "tasks"
#: Pixels for a unit of a picture on a page, and of a small one.
_FINE, _SMALL = 1.0, 0.75


def draw(name: str) -> None:
    """Writes the two pictures of a task."""
    examined = examine(load_task(TASKS / f"{name}.yaml"), stability=False)
    assert examined.plan is not None
    picture = TaskPicture(examined.plan)
    place = HERE / "tasks" / f"{name}.svg"
    place.write_bytes(picture.svg(fineness=_FINE))
    small = Image.open(io.BytesIO(picture.png(rows=False, fineness=_SMALL)))
    small.save(place.with_suffix(".webp"), quality=82, method=6)


if __name__ == "__main__":
    (HERE / "tasks").mkdir(exist_ok=True)
    for each in sys.argv[1:] or sorted(path.stem for path in TASKS.glob("*.yaml")):
        draw(each)
