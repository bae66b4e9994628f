"""``treadline import``: a robot's URDF, SDF or MJCF as a vehicle's file."""

import re
import sys
import tomllib
from pathlib import Path

from treadline.cli._arguments import Force, claim
from treadline.cli._output import Answer
from treadline.core.errors import SettingsError
from treadline.core.printing import say

MOST_QUESTIONS = 8
"""Largest number of questions; a further value is its default."""


def import_(
    description: Path, /, *, belts: str | None = None, yes: bool = False, out: Path = Path("robot.toml"), force: Force = False
) -> Answer:
    """Write the file of a vehicle from a robot description: URDF, SDF or MJCF.

    Masses, inertias, joints, limits, axes and radii of the belts are those of the description. What it does not have is asked, at
    most eight times, and marked in the file with "not in the file". Joints of no belt are held at zero. Meshes are not read.

    Args:
        description: URDF, SDF or MJCF of a robot with belts; run xacro first.
        belts: Regular expression of the names of links, or of their shapes, that carry belts: 'flipper.*|track.*'. Default: what is
            round about y, left and right of the middle.
        yes: Take the default of each question.
        out: File to write. Default: robot.toml.
    """
    from treadline.core.files import write_whole
    from treadline.core.settings import settings_of
    from treadline.scenario.chair import ChairDescription
    from treadline.vehicle.described_belts import find_belts
    from treadline.vehicle.imported_file import MARK, vehicle_file
    from treadline.vehicle.xml_links import description_root, xml_links

    claim(out, force=force, kind="file")
    try:
        re.compile(belts or "")
    except re.error as error:
        raise SettingsError(f"--belts '{belts}' is no regular expression: {error}; write for example 'flipper.*|track.*'") from None
    root = description_root(description)
    if root.tag == "mujoco":
        from treadline.plant.mujoco.mjcf_links import mjcf_links

        name, links = mjcf_links(description)
    elif root.tag in ("robot", "sdf"):
        name, links = xml_links(description, root)
    else:
        raise SettingsError(f"{description}: <{root.tag}> is no robot description; give URDF, SDF or MJCF")
    questions = _Questions(yes=yes)
    text = vehicle_file(str(description), name, links, find_belts(str(description), links, belts), questions.answer)
    chair = settings_of(tomllib.loads(text), ChairDescription, where=str(description))
    write_whole(out, text)
    mass_kg = sum(link.mass_kg for link in links)
    marked = text.count(f"# {MARK}")
    return Answer(
        values={"path": str(out), "vehicle": chair.name, "mass_kg": mass_kg, "questions": questions.count, "marked": marked},
        summary=[
            f"{chair.name}, {mass_kg:g} kg, {len(links)} links, written to {out}; {marked} values are marked: not in the file"
        ],
    )


class _Questions:
    """Questions at the terminal."""

    def __init__(self, *, yes: bool) -> None:
        self._yes = yes
        self.count = 0

    def answer(self, question: str, default: float, reason: str) -> tuple[float, str]:
        """Return the answer to a question, and where it comes from.

        Raises:
            SettingsError: If there is nobody to ask, or the answer is no number.
        """
        if not self._yes and not sys.stdin.isatty():
            raise SettingsError(f"the description lacks the {question}; answer at a terminal, or give --yes for the defaults")
        self.count += 1
        if self._yes or self.count > MOST_QUESTIONS:
            return default, reason
        say(f"{question}, {default:g} ({reason}) if left empty:")
        line = sys.stdin.readline().strip()
        if not line:
            return default, reason
        try:
            return float(line), "answered at the import"
        except ValueError:
            raise SettingsError(f"{question}: '{line}' is not a number; write for example {default:g}") from None
