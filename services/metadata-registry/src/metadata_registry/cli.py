"""`sense4hri-assign [SENSOR HUMAN]`: who wears what, and who is to wear it from now on; over ROS."""

import argparse
import sys
from contextlib import closing
from typing import Any

from sense4hri.line import Line
from sense4hri.names import HUMAN_ID_FORM, SENSOR_ID_FORM, is_human_id, is_sensor_id
from sense4hri.plain_text import plain
from sense4hri_msgs.srv import AssignSensor, ListSensors

ANSWER_S = 15.0  # of a driver that has to be told first


def ask(kind: Any, name: str, **fields: Any) -> Any:
    """Return the registry's answer; ends the program with a sentence where none comes."""
    with closing(Line("sense4hri-assign", "metadata-registry")) as line:
        return line.ask(kind, name, kind.Request(**fields), ANSWER_S)


def tell() -> int:
    """Print every stream: sensor, type, who wears it, whether its driver is there."""
    for sensor in ask(ListSensors, "/study/list_sensors").sensors:
        there = "online" if sensor.online else "offline"
        print(plain(f"{sensor.sensor_id}  {sensor.sensor_type}  {sensor.human_id}  {there}"))
    return 0


def assign(sensor_id: str, human_id: str, person_id: str) -> int:
    """Put a sensor on a person and say what has become of it; 1 where its topics did not move."""
    answer = ask(AssignSensor, "/study/assign_sensor", sensor_id=sensor_id, human_id=human_id, person_id=person_id)
    print(plain(answer.message), file=sys.stdout if answer.success else sys.stderr)
    return 0 if answer.success else 1


def main(arguments: list[str] | None = None) -> int:
    """Assign, or tell who wears what; return the exit status."""
    parser = argparse.ArgumentParser(
        prog="sense4hri-assign",
        description="Say who wears a sensor from now on; its topics move while everything runs. Without arguments: "
        "say who wears what. Status 0: done, or its driver is away and will be told; 1: not done, and why.",
    )
    parser.add_argument("sensor", nargs="?", help="its sensor_id, such as h10_1")
    parser.add_argument("human", nargs="?", help="the participant's pseudonym, such as p7; `unassigned`: nobody")
    parser.add_argument("--person", default="", metavar="PERSON", help="the ROS4HRI person, where one is known")
    options = parser.parse_args(arguments)
    if options.sensor is None:
        return tell()
    if options.human is None:
        parser.error(f"who is to wear {options.sensor!r}? Name the participant too")
    if not is_sensor_id(options.sensor):
        parser.error(f"{options.sensor!r} is no sensor_id: {SENSOR_ID_FORM}")
    if not is_human_id(options.human):
        parser.error(f"{options.human!r} is no pseudonym: {HUMAN_ID_FORM}")
    return assign(options.sensor, options.human, options.person)


if __name__ == "__main__":
    sys.exit(main())
