"""Errors of the compiler, at their place in the task file."""

from __future__ import annotations

from taskspec.spec import LoadedTask
from taskspec.text.codes import register
from taskspec.text.diagnostic import Diagnostics, SpecError

register(
    {
        "TS220": "an axis that the arm does not have in this frame",
        "TS221": "a frame that is askew to the plane of a planar arm",
        "TS222": "a path that drives no axis",
        "TS223": "a table of points that cannot be used",
        "TS224": "a signal that this stage cannot evaluate",
        "TS226": "a frame placed in one that follows a surface",
        "TS227": "a path that only turns, at a speed of translation",
        "TS228": "Euler angles where the task frame turns or a rotation is not held to a motion",
        "TS214": "a limit that nothing keeps",
        "TS229": "Euler angles at their singularity at the start",
        "TS129": "a number that is hardly meant",
        "TS248": "a frame that does not go with its loose body",
        "TS326": "a tool that points away from its surface",
        "TS325": "an axis that nothing determines",
        "TS311": "an equation without a gradient",
        "TS312": "a start off a constraint",
        "TS313": "constraints that depend on each other",
        "TS314": "an equation on a joint that the arm does not have",
        "TS230": "an axis that does not follow from the mechanism's geometry",
        "TS231": "a frame that turns with a handle, and cannot be as the file says",
        "TS232": "a rotation held against the world on an object that turns",
        "TS233": "a goal in the null space that has no effect on this arm",
        "TS415": "a start away from the handle that the robot is to hold",
        "TS416": "a knob that the robot cannot turn",
        "TS306": "an open-loop force on an axis without a spring",
        "TS320": "a force that nothing resists",
        "TS321": "a motion into a surface",
        "TS322": "a motion that the mechanism does not allow",
        "TS323": "a motion that leaves a constraint",
        "TS324": "a motion to where a constraint has no gradient",
        "TS420": "lines that contradict each other",
        "TS421": "a motion that leads out of reach",
        "TS422": "a place close to a singularity",
        "TS423": "a position that jumps",
        "TS414": "values for joints that do not fit the robot",
        "TS308": "a pull on a surface that can only push",
        "TS610": "a limit below a set point",
        "TS307": "a contact stiffer than the plant's steps resolve",
        "TS225": "a following frame without an x axis at the start",
        "TS304": "an open-loop force that `vary` makes vague",
        "TS305": "a start inside an object",
        "TS303": "a force without a surface to press on",
        "TS245": "a measured frame that is used before it is measured",
        "TS246": "a measured frame that may be used before it is measured",
        "TS247": "an equation in a frame that is not fixed in the world",
        "TS430": "a force sensor too slow for a force loop",
        "TS431": "a sensor's rate that does not divide the controller's",
        "TS501": "a stage that is predicted to be unstable",
        "TS502": "a stage that is predicted to ring",
        "TS503": "a stage that is unstable in a world that `vary` allows",
        "TS504": "a stage that rings in a world that `vary` allows",
        "TS505": "a contact in which a motion would be unstable",
        "TS506": "a stage that is unstable while friction holds the tool",
        "TS611": "a guard that can never hold",
        "TS612": "a guard whose force has the wrong sign",
        "TS613": "a guard that holds before anything is touched",
        "TS614": "a guard finer than the sensor's noise",
        "TS615": "force control that begins off the surface",
        "TS616": "an impact beyond the limit on force",
        "TS617": "a bound that ends a stage before it comes to its surface",
        "TS618": "a failure that the set point brings about",
        "TS619": "a ramp that is longer than its stage",
        "TS620": "a tare while a force acts",
        "TS720": "an expectation of a stage that is not entered",
        "TS721": "an expectation of a signal that a stage does not have",
        "TS722": "an expectation that can never hold",
        "TS723": "an expectation that a set point contradicts",
        "TS724": "an expectation of a time finer than a tick",
    }
)


def spec_error(
    loaded: LoadedTask, place: tuple[str | int, ...], code: str, message: str, hint: str = ""
) -> SpecError:
    """One finding about one place of a loaded task, ready to be raised."""
    found = Diagnostics(loaded.source.name)
    found.error(code, message, loaded.span(place), hint)
    return SpecError(found.sorted(), loaded.sources)
