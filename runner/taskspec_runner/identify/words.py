"""Names of what a log has of a channel."""

from __future__ import annotations

from taskspec.geometry.axis import AXES


def channel_name(of: str, number: int) -> str:
    """Of a channel's number among those of a sensor, or of the joints, such as `force.z`."""
    if of == "joint":
        return f"joint.{number + 1}.torque"
    return f"{AXES[number].effort}.{AXES[number]}"


def channel_unit(of: str, number: int) -> str:
    """The SI unit of its values."""
    return "N" if of == "wrench" and number < 3 else "N*m"
